"""What client and daemon share: formats that travel. Pure, and of the standard library alone.

The daemon imports this package, and nothing else of the client.
"""
