"""The jaws in virtual time: how hard, how fast, what holds."""
