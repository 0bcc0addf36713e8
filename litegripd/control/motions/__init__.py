"""The motions: small state machines, stepped once per tick, that never wait and never loop."""
