"""The client's calls, of both kinds, at the daemon's core in virtual time."""
