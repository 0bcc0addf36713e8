"""What the vendor's SDK has beyond its manual: further names for what is here, and refusals.

A call of the SDK that needs the bus in the program's own process, or an internal of it, exists as
a name and raises `CommandError`, reason "unsupported", with what to use instead.
"""
