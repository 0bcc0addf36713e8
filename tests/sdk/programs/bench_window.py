"""The loop of a bench program: one worker at 200 Hz, commands from a queue, an emergency stop."""

import queue
import sys
import threading
import time

from litegrip import GripperConfig, LiteGrip, LiteGripError, describe_error

PERIOD_S = 0.005


class Worker:
    def __init__(self, channel: str) -> None:
        self.config = GripperConfig()
        self.config.can_channel = channel
        self.config.max_stroke_mm = 85.0
        self.config.can_id, self.config.mst_id, self.config.canfd_mode = 8, None, False
        self.gripper = LiteGrip(config=self.config)
        self.commands: queue.Queue[tuple[str, float]] = queue.Queue()
        self.stops = threading.Event()
        self.reports = 0
        self.failed_in_a_row = 0
        self.slowest_s = 0.0
        self.log: list[str] = []

    def begin(self) -> bool:
        assert self.gripper.connect()
        file = LiteGrip(self.config.can_channel)
        self.gripper.load_calibration()
        file.load_calibration()
        known = self.config
        self.config.pos_closed_rad, self.config.pos_open_rad = (
            known.pos_closed_rad,
            known.pos_open_rad,
        )
        self.config.rad_to_mm, self.config.max_stroke_mm = known.rad_to_mm, 85.0
        try:
            return bool(self.gripper.enable())
        except LiteGripError as error:
            self.log.append(describe_error(error.error_code or 0))
            return False

    def run(self) -> None:
        mode, value, ramp_nm = "release", 0.0, 0.0
        target_rad = self.gripper.get_state(wait=False).position_rad
        while self.failed_in_a_row < 20:
            began_s = time.monotonic()
            try:
                if self.stops.is_set():
                    self.gripper.stop()
                    self.gripper.disable()
                    return
                while not self.commands.empty():
                    mode, value = self.commands.get_nowait()
                    if mode == "quit":
                        return
                    target_rad = self.gripper.get_state(wait=False).position_rad
                self.reports += self.gripper.poll(timeout_s=0.0)
                self.gripper.get_state(wait=False)
                if mode == "move":
                    step_rad = 60.0 / self.config.rad_to_mm * PERIOD_S
                    target_rad += min(max(value - target_rad, -step_rad), step_rad)
                    sent = self.gripper.send_mit_frame(
                        q=target_rad, kp=100.0, kd=2.0, dq=0.0, tau=0.0
                    )
                elif mode == "force":
                    sign = self.config.close_sign
                    ramp_nm = min(value * 0.1, ramp_nm + 0.02)
                    tau = sign * ramp_nm
                    sent = self.gripper.send_mit_frame(q=0.0, kp=0.0, kd=0.0, dq=0.0, tau=tau)
                else:
                    sent = self.gripper.send_mit_frame(q=0.0, kp=0.0, kd=0.0, dq=0.0, tau=0.0)
                self.failed_in_a_row = 0 if sent else self.failed_in_a_row + 1
            except LiteGripError as error:
                self.failed_in_a_row += 1
                self.log.append(str(error))
            took_s = time.monotonic() - began_s
            self.slowest_s = max(self.slowest_s, took_s)
            time.sleep(max(PERIOD_S - took_s, 0.001))

    def end(self, path: str) -> None:
        self.gripper.clear_fault()
        print("saved", self.gripper.save_calibration(path) == path)
        self.gripper.disconnect()


def main() -> int:
    channel, path = sys.argv[1], sys.argv[2]
    worker = Worker(channel)
    if not worker.begin():
        print(worker.log)
        return 1
    thread = threading.Thread(target=worker.run)
    thread.start()
    closed_rad, open_rad = worker.config.pos_closed_rad, worker.config.pos_open_rad
    for share, seconds in ((0.7, 1.5), (0.3, 1.5)):
        target_rad = closed_rad + share * (open_rad - closed_rad)
        worker.commands.put(("move", target_rad))
        time.sleep(seconds)
        print(f"at {abs(worker.gripper.get_position_rad() - target_rad):.2f}")
    worker.commands.put(("release", 0.0))
    time.sleep(0.3)
    worker.commands.put(("force", 10.0))
    time.sleep(3.0)
    print("force", 8.0 < worker.gripper.get_force() < 12.0)
    worker.stops.set()
    thread.join()
    print("enabled", worker.gripper.get_state().is_enabled, "failed", worker.failed_in_a_row)
    print(f"{worker.reports} reports, slowest {1000.0 * worker.slowest_s:.1f} ms")
    worker.end(path)
    return 0 if not worker.log else 1


if __name__ == "__main__":
    sys.exit(main())
