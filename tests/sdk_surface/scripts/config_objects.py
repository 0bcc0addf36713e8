from litegrip import GripperConfig, LiteGrip, MotionConfig, UnitConversion

config = GripperConfig()
config.can_channel = "can0"
config.can_id = 0x08
gripper = LiteGrip(config=config, motion_config=MotionConfig(speed_mm_s=40.0, force_ramp_n_s=30.0))
gripper.connect()
gripper.enable()
print(gripper.config.max_stroke_mm, gripper.config.mount, gripper.config.nm_to_n)
print(10.0 * UnitConversion.N_TO_NM)
gripper.set_force(5.0, 0.5)
gripper.disconnect()
