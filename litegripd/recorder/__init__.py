"""The flight recorder: every tick of the last minute, and when it is written to disk."""
