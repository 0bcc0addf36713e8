"""The simulated DM4310 motor and gripper: frames in, frames out."""
