"""litegripctl at the daemon's core in virtual time, by what was typed and shown."""
