"""`litegripctl doctor`: what a gripper needs, from the CAN adapter to the calibration, checked.

`gather` asks the system and the daemon and gives `Facts`; the checks turn facts into findings,
without asking anybody. Nothing in here changes anything: a finding names the command that does.
`ctl/findings.py` runs the checks and shows what they find, here as for the fleet's `check`.
"""
