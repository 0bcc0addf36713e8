"""A second gripper, made without any code of the simulator: the judge of what the daemon does.

Motor, codec and mechanics are written from the facts of the field alone, and their figures vary.
`python -m tests.plants` tries the daemon on as many of them as wanted.
"""
