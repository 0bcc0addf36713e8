"""One motor by itself: its status, a release, a move by frames, its zero."""

import argparse
import sys

from litegrip import LiteGrip, LiteGripError
from litegrip.can import MotorType
from litegrip.protocols import LiteGripCAN


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("status", "release", "goto", "zero", "open", "close"))
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--can-id", type=lambda text: int(text, 0), default=0x08)
    parser.add_argument("--motor", default="DM4310")
    parser.add_argument("--rad", type=float, default=0.0)
    parser.add_argument("--duration", type=float, default=2.0)
    parser.add_argument("--interval", type=float, default=0.005)
    given = parser.parse_args()
    if given.what in ("open", "close"):
        with LiteGrip(given.channel) as gripper:
            gripper.load_calibration()
            print(gripper.config.work_stroke_mm, gripper.actions.config.stop_torque_nm)
            gripper.enable()
            act = gripper.open if given.what == "open" else gripper.close
            return 0 if act(60.0) else 1
    bus = LiteGripCAN(channel=given.channel, canfd_mode=False)
    try:
        bus.connect()
        print(f"mst {bus.register_gripper(given.can_id, None, MotorType[given.motor]):#x}")
        if given.what == "status":
            bus.update_state(0.2)
        elif given.what == "release":
            bus.initialize()
            bus.control_mit_stream(0.0, 0.0, 0.0, given.duration, interval_s=given.interval)
        elif given.what == "goto":
            bus.initialize()
            bus.control_mit_stream(given.rad, 100.0, 2.0, given.duration, interval_s=given.interval)
        else:
            bus.disable()
            print("zero", bus.set_zero())
            bus.initialize()
        bus.update_state(0.2)
        print(f"{bus.get_position():+.2f} {bus.get_error()} {bus.get_temperature()}")
    except LiteGripError as error:
        print(error)
        return 1
    finally:
        bus.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
