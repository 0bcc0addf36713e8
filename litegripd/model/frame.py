"""A classic CAN frame as a value, the only form in which the pure rooms know the bus."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One classic CAN data frame with an 11-bit identifier.

    `can_id` is 0 to 0x7FF and `data` at most 8 bytes. Error, remote and extended frames never
    become a `CanFrame`: the bus drops and counts them, for the masked id of an error frame can
    equal the feedback id (0x08 | 0x10 = 0x18).
    """

    can_id: int
    data: bytes
