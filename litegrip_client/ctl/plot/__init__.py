"""The picture of a dump; imported by the command `plot` alone.

The only part of the client that needs libraries: those of the extra `plot`.
"""
