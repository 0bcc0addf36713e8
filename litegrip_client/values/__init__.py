"""What travels, and how it is checked: errors, results, names, calibrations, trajectories, texts.

Of the standard library alone, and nothing here asks a daemon. The daemon imports this room, too.
"""
