import time

from litegrip import LiteGrip
from litegrip.teleop import DEFAULT_GRIP_PORT, TORQUE_TRIP_CYCLES, TeleopError

with LiteGrip("can0") as slave:
    slave.load_calibration()
    slave.enable()
    try:
        slave.teleop_start("slave", link="udp", host="0.0.0.0", port=DEFAULT_GRIP_PORT, align=True)
        for _ in range(3):
            s = slave.teleop_status()
            print(s["active"], s["stale"], f"{s['torque_nm']:+.2f}", TORQUE_TRIP_CYCLES)
            time.sleep(0.2)
    except TeleopError as error:
        print("failed", error)
    finally:
        slave.teleop_stop(timeout=2.0)
