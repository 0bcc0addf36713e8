"""Grippers of other machines: gateway, portal and router on a zenoh network (docs/fleet.md).

A client of the daemon, and of nothing else in it. Nothing here runs unless it is configured.
"""
