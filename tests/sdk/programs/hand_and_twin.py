"""A leader whose jaws a hand moves, and a follower, each with frames of its own at 50 Hz."""

import sys
import time

from litegrip import LiteGrip

HZ = 50.0


def lead(gripper: LiteGrip, seconds: float, sleep: object) -> list[float]:
    """Return what the hand did, as a share of the travel."""
    assert callable(sleep)
    config, taken = gripper.config, []
    for _ in range(int(seconds * HZ)):
        gripper.send_mit_frame(q=0.0, kp=0.0, kd=0.0)
        gripper.poll(timeout_s=0.0)
        state = gripper.get_state(wait=False)
        span = config.pos_open_rad - config.pos_closed_rad
        taken.append((state.position_rad - config.pos_closed_rad) / span)
        sleep(1.0 / HZ)
    gripper.exit_zero_gravity()
    return taken


def follow(gripper: LiteGrip, shares: list[float], sleep: object) -> float:
    """Follow them; return by how many mm the jaws were behind at most."""
    assert callable(sleep)
    config = gripper.config
    span = config.pos_open_rad - config.pos_closed_rad
    angles = [config.pos_closed_rad + share * span for share in shares]
    assert gripper.goto_rad(angles[0], kp=100.0, kd=2.0, duration=1.0)
    behind_mm = 0.0
    for q in angles:
        assert gripper.send_mit_frame(q, 100.0, 2.0, dq=0.0)
        sleep(1.0 / HZ)
        behind_rad = abs(gripper.get_state(wait=False).position_rad - q)
        behind_mm = max(behind_mm, behind_rad * config.rad_to_mm)
    gripper.send_mit_frame(angles[-1], 100.0, 2.0)
    return behind_mm


def made(channel: str) -> LiteGrip:
    gripper = LiteGrip(channel=channel, disable_on_disconnect=False)
    gripper.connect()
    gripper.load_calibration()
    gripper.enable()
    return gripper


def main() -> int:
    leader = made(sys.argv[1])
    moved = lead(leader, 2.0, time.sleep)
    leader.disconnect()
    twin = made(sys.argv[2])
    print(f"{len(moved)} frames, behind {follow(twin, moved, time.sleep):.1f} mm")
    twin.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
