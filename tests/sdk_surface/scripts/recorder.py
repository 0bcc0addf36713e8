from litegrip import CommandError, LiteGrip, TrajectoryRecorder

with LiteGrip("can0") as gripper:
    gripper.load_calibration()
    gripper.enable()
    try:
        recorder = TrajectoryRecorder(gripper, rate_hz=100.0)
        recorder.start()
    except CommandError as error:
        print("refused:", error)
        taught = gripper.record(2.0)
    print("samples", len(taught), round(taught.duration))
    taught.save("taught")
    status = gripper.play(taught)
    print("frames", status["frames"] > 0)
