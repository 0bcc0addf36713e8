from litegrip import LiteGrip

with LiteGrip("can0") as gripper:
    if not gripper.wait_for_ready(timeout=5.0):
        raise SystemExit("not ready")
    if not gripper.enable():
        raise SystemExit("not enabled")
    print("enabled", gripper.is_enabled)
    gripper.move_at_speed(20.0)
    print("at", round(gripper.get_position()))
