"""litegripd: one daemon owns the gripper's CAN bus, many processes use the gripper."""
