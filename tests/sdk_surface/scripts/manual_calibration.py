from litegrip import LiteGrip

with LiteGrip("can0", mount="normal") as gripper:
    gripper.enable()
    data = gripper.calibrate_manual(duration=6.0, settle_time=0.5, sample_interval=0.01)
    print("travel", round(data.travel_range, 1), round(data.travel_mm))
    gripper.save_calibration()
