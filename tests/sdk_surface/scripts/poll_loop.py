import time

from litegrip import LiteGrip

with LiteGrip("can0") as gripper:
    gripper.load_calibration()
    gripper.enable()
    gripper.goto(40.0)
    began = time.time()
    rows = 0
    while time.time() - began < 2.0:
        gripper.poll(timeout_s=0.01)
        position, force = gripper.get_position(), gripper.get_force()
        state = gripper.get_state(wait=False)
        print(
            f"{position:6.1f} mm {force:+5.1f} N {state.temperature_coil:.0f} C {state.is_moving}"
        )
        rows += 1
        time.sleep(0.1)
    print("rows", rows)
