"""The side of the gripper: the gateway, its sessions with a daemon, the dead man's switch."""
