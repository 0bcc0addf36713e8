"""Lead, or follow a leader: a real one, or one of this program's own that sweeps to and fro."""

import argparse
import sys
import threading
import time

from litegrip import (
    DEFAULT_GRIP_ID,
    InProcTeleopTransport,
    LiteGrip,
    LiteGripError,
    encode_frame,
    teleop_topic,
)


def sweep(bus: InProcTeleopTransport, ends: threading.Event, rate_hz: float, per_s: float) -> None:
    began_s = time.monotonic()
    while not ends.wait(1.0 / rate_hz):
        phase = (time.monotonic() - began_s) * per_s % 2.0
        openness = abs(1.0 - phase)
        bus.pub(
            teleop_topic(DEFAULT_GRIP_ID), encode_frame(openness, 85.0 * openness, 0.0, time.time())
        )


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--mode", choices=("master", "slave"), required=True)
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--host")
    parser.add_argument("--port", type=int, default=17448)
    parser.add_argument("--link", default="zenoh")
    parser.add_argument("--mount")
    parser.add_argument("--no-align", action="store_true")
    parser.add_argument("--no-require-ready", action="store_true")
    parser.add_argument("--ready-timeout", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=50.0)
    parser.add_argument("--fake-leader", action="store_true")
    parser.add_argument("--openness-rate", type=float, default=0.3)
    parser.add_argument("--seconds", type=float, default=5.0)
    given = parser.parse_args()
    gripper = LiteGrip(given.channel)
    gripper.load_calibration(**({"template": given.mount} if given.mount else {}))
    config = gripper.config
    print(f"{gripper.mount}: {config.pos_closed_rad:+.3f} to {config.pos_open_rad:+.3f}")
    bus = InProcTeleopTransport() if given.fake_leader else None
    ends = threading.Event()
    try:
        gripper.connect()
        gripper.enable()
        status = gripper.teleop_start(
            given.mode,
            transport=bus,
            link=given.link,
            host=given.host,
            port=given.port,
            align=not given.no_align,
            require_ready=not given.no_require_ready,
            ready_timeout_s=given.ready_timeout,
            rate_hz=given.rate,
        )
        print(status["active"], status["mode"], status["topic"], gripper.session)
        if bus is not None:
            leads = (bus, ends, given.rate, given.openness_rate)
            threading.Thread(target=sweep, args=leads, daemon=True).start()
        until_s = time.monotonic() + given.seconds
        while time.monotonic() < until_s:
            time.sleep(1.0)
            status = gripper.teleop_status()
            print(
                f"{status.get('frames')} {status.get('openness'):.2f} {status.get('loop_hz'):.0f}",
                f"{status.get('torque_nm'):+.2f} {status.get('dq_cmd'):+.2f}",
                status.get("ready"),
                flush=True,
            )
        ends.set()
        final = gripper.teleop_stop()
        print("frames", final["frames"], "fault", repr(final["fault"]))
    except LiteGripError as error:
        print(error)
        return 1
    finally:
        ends.set()
        gripper.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
