import sys

from litegrip import CommandError, LiteGrip

gripper = LiteGrip(channel="can0", can_id=0x08)
if not gripper.connect():
    sys.exit("no gripper")
try:
    gripper.load_calibration()
    gripper.enable()
    for width in range(3):
        gripper.open()
        result = gripper.grasp(force_n=10.0, hold_s=0.5)
        print(width, result.ok, result.stalled)
except CommandError as error:
    print("refused:", error)
finally:
    gripper.stop()
    gripper.disconnect()
