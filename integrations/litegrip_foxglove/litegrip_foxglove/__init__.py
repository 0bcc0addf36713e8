"""LiteGrip grippers live in Foxglove, through their daemon: docs/foxglove.md describes it."""
