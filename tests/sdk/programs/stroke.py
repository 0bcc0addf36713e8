"""Open and close in cycles, and print what each stroke measured."""

import argparse
import sys

from litegrip import LiteGrip, LiteGripError, default_calib_path
from litegrip.can import MotorType


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--can-id", type=lambda text: int(text, 0), default=0x08)
    parser.add_argument("--mst-id", type=lambda text: int(text, 0))
    parser.add_argument("--motor", choices=[kind.name for kind in MotorType], default="DM4310")
    parser.add_argument("--canfd", action="store_true")
    parser.add_argument("--speed", type=float, default=20.0)
    parser.add_argument("--kp", type=float)
    parser.add_argument("--cycles", type=int, default=1)
    parser.add_argument("--calib")
    parser.add_argument("--template")
    parser.add_argument("--dry-run", action="store_true")
    given = parser.parse_args()
    gripper = LiteGrip(
        channel=given.channel,
        can_id=given.can_id,
        mst_id=given.mst_id,
        canfd_mode=given.canfd or None,
        motor_type=MotorType[given.motor],
    )
    if not gripper.load_calibration(path=given.calib, template=given.template):
        print(f"no calibration; looked at {default_calib_path(given.channel)}")
        return 1
    config, tunables = gripper.config, gripper.actions.config
    assert config.calibrated
    if given.kp is not None:
        config.kp = given.kp
    print(f"{config.pos_closed_rad:+.4f} {config.pos_open_rad:+.4f} {config.rad_to_mm:.2f}")
    print(f"work {getattr(config, 'work_stroke_mm'):.1f} mm, kp {config.kp:.1f}, {gripper.mount}")
    print(f"guard {getattr(tunables, 'stop_torque_nm')} {tunables.stop_torque_cycles}")
    print(f"{tunables.sample_interval / tunables.frame_interval:.0f} frames a sample")
    if given.dry_run:
        return 0
    try:
        assert gripper.connect()
        enabled = gripper.enable()
        if not enabled.ok:
            print(
                f"not enabled after {enabled.tries}: {getattr(enabled.state, 'error_code', None)}"
            )
            return 1
        print(str(gripper))
        peak = 0.0

        def watch(sample: object) -> None:
            nonlocal peak
            peak = max(peak, abs(sample.torque_nm))  # type: ignore[attr-defined]

        for _ in range(given.cycles):
            opened = gripper.open(given.speed, progress=watch)
            closed = gripper.close(given.speed, progress=watch)
            for result in (opened, closed):
                print(
                    result.ok,
                    result.reached,
                    result.stalled,
                    result.protected,
                    f"{result.state.position_mm:.1f} {result.state.position_rad:+.3f}",
                    f"{result.state.torque_nm:+.2f} {result.state.error_code} {result.steps}",
                )
            if not (opened and closed):
                return 1
        print(f"peak {peak:.2f}")
    except KeyboardInterrupt:
        return 130
    except LiteGripError as error:
        print(error)
        return 1
    finally:
        gripper.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
