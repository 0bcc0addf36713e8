"""A robot's node: a background loop at 50 Hz; what it is asked for stands in a slot."""

import math
import sys
import time

from litegrip import LiteGrip

PERIOD_S = 0.02


class Node:
    def __init__(self, channel: str) -> None:
        self.gripper = LiteGrip(channel)
        self.target_rad: float | None = None
        self.fresh_s = 0.0
        self.latched = False
        if not callable(getattr(self.gripper, "refresh_status", None)):
            raise SystemExit("an SDK without refresh_status is not powered up")

    def power_up(self) -> bool:
        gripper = self.gripper
        assert gripper.connect()
        gripper.load_calibration()
        gripper.disable()  # as a question
        until_s = time.monotonic() + 0.5
        while not gripper.poll(0.0):
            if time.monotonic() > until_s:
                return False
            time.sleep(0.005)
        state = gripper.get_state(wait=False)
        good = math.isfinite(state.position_rad) and state.error_code in (0, 1)
        good = good and max(state.temperature_mos, state.temperature_coil) < 80
        self.fresh_s = time.monotonic()
        return good and bool(gripper.enable())

    def cycle(self) -> None:
        gripper = self.gripper
        now_s = time.monotonic()
        if gripper.poll(0.0):
            gripper.get_state(wait=False)
            self.fresh_s = now_s
        if now_s - self.fresh_s > 0.5:
            gripper.stop()
            self.latched = True
            return
        if self.target_rad is not None:
            sent = gripper.send_mit_frame(q=self.target_rad, kp=20.0, kd=0.5, dq=0.0, tau=0.0)
            self.latched = self.latched or not sent
        else:
            answer: object = gripper.stop()  # type: ignore[func-returns-value]
            self.latched = self.latched or answer is False
            gripper.refresh_status()

    def run(self, seconds: float) -> None:
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s and not self.latched:
            began_s = time.monotonic()
            self.cycle()
            time.sleep(max(PERIOD_S - (time.monotonic() - began_s), 0.001))


def main() -> int:
    node = Node(sys.argv[1])
    if not node.power_up():
        print("not powered up")
        return 1
    config = node.gripper.config
    node.run(1.0)
    print("idle", node.latched)
    node.target_rad = 0.5 * (config.pos_closed_rad + config.pos_open_rad)
    node.run(3.0)
    print("there", abs(node.gripper.get_position_rad() - node.target_rad) < 0.03, node.latched)
    node.target_rad = None
    node.run(1.0)
    print("slack", node.latched)
    node.gripper.disable()
    node.gripper.disconnect()
    return 0


if __name__ == "__main__":
    sys.exit(main())
