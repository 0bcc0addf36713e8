"""Golden runs: what a change of the code's shape must leave as it is, byte for byte."""
