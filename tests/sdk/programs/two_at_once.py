"""Two grippers in one process, each from its own thread; one is read at 200 Hz meanwhile."""

import sys
import threading
import time

from litegrip import LiteGrip


def stroke(gripper: LiteGrip, answers: list[bool]) -> None:
    answers.append(bool(gripper.open(100.0)) and bool(gripper.close(100.0)))


def main() -> int:
    grippers = [LiteGrip(channel=name, can_id=8) for name in sys.argv[1:3]]
    answers: list[bool] = []
    for gripper in grippers:
        gripper.connect()
        gripper.load_calibration()
        gripper.enable()
    threads = [threading.Thread(target=stroke, args=(one, answers)) for one in grippers]
    for thread in threads:
        thread.start()
    reads, moving = 0, False
    while any(thread.is_alive() for thread in threads):
        reads += 1
        moving = moving or grippers[0].get_state().is_moving
        time.sleep(0.005)
    print(answers, moving, reads)
    for gripper in grippers:
        gripper.disconnect()
    return 0 if answers == [True, True] else 1


if __name__ == "__main__":
    sys.exit(main())
