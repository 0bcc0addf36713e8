"""The core for threads: a blocking `LiteGrip`, its actions (generated), and the SDK's members."""
