"""Lines and their answers over a real socket, at a daemon that a test scripts."""
