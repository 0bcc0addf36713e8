"""`litegripctl`: look at a gripper and drive it from the command line."""
