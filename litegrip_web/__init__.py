"""The page in the browser: one process that shows the grippers of a machine, and lets them be used.

It is a client of the daemons like any other. `litegrip_client` is all that it knows of them.
"""
