"""The gripper that ships, as a test expects it: figures of the vendor's newest sources, by hand."""

CLOSED_RAD, OPEN_RAD, MM_RAD = 0.0, -1.651026, 52.69
"""The template of a normal mount; a reverse one has the limits the other way round."""
TRAVEL_RAD = CLOSED_RAD - OPEN_RAD
TRAVEL_MM = TRAVEL_RAD * MM_RAD
"""86.99"""
WORK_MM = 80.0
"""The opening to which `open` goes with a template."""
STROKE_MM, SPAN_MM = 85.0, 86.0
"""How far the jaws open by a caliper, and what lies between the limits that a probe finds."""

OLD_CLOSED_RAD, OLD_OPEN_RAD, OLD_MM_RAD = 0.114, -1.491, 74.8
"""The template of earlier versions, on 120 mm."""
