"""What `litegripctl install-units` puts into a system, so that systemd runs the daemons.

It writes and removes files, and says which commands come next; it runs none of them.
"""
