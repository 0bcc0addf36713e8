"""`litegripctl doctor`: what a gripper needs, from the CAN adapter to the calibration, checked.

`gather` asks the system and the daemon and gives `Facts`; the checks of `table` turn facts into
findings, without asking anybody. Nothing in here changes anything: a finding names the command
that does. How findings are shown is litegripctl's to know.
"""
