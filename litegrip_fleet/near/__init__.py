"""The side of the program: the portal, whose sockets look like those of a daemon."""
