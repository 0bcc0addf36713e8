"""What a member is called that users look for by another name."""

from __future__ import annotations

MEANT = {
    "move": "goto(opening_mm=...)",
    "move_to": "goto(opening_mm=...)",
    "set_position": "goto(opening_mm=...)",
    "state": "get_state()",
    "status": "get_state()",
    "position": "get_state().position_rad, or get_state().opening_mm",
    "width": "get_state().opening_mm, or width_mm of what grasp() returns",
    "opening": "get_state().opening_mm",
    "force": "get_state().force_n, or set_force(newtons)",
    "torque": "get_state().torque_nm",
    "temperature": "get_state().coil_temperature_c",
    "grip": "grasp(force_n=...)",
    "release": "open(), or zero_gravity() for slack jaws",
    "grasped": "get_state().is_grasped",
    "enabled": "get_state().enabled",
}
"""By the name that hands type: what does that here."""


def no_attribute(owner: object, name: str) -> AttributeError:
    """Return the error for a member that is not there; it names the one that was meant."""
    kind = type(owner)
    text = f"{kind.__name__!r} object has no attribute {name!r}"
    meant = MEANT.get(name)
    if meant is not None and not hasattr(kind, name):
        text += f"; use {meant}"
    return AttributeError(text, name=name, obj=owner)
