"""Leader/follower teleoperation: one gripper is moved by hand, another follows it."""
