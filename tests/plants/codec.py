"""The frames of a DM4310 as its firmware reads and writes them, from the maker's table.

Every field is a linear map of its range onto all its codes. The maker truncates.
"""

from dataclasses import dataclass
from typing import NamedTuple

KP_MOST_NM_RAD, KD_MOST_NM_S_RAD = 500.0, 5.0


@dataclass(frozen=True, slots=True)
class Scale:
    """What a frame's full range stands for: rad, rad/s, N·m (registers 21, 22 and 23)."""

    position_rad: float = 12.5
    velocity_rad_s: float = 30.0
    torque_nm: float = 10.0


class Command(NamedTuple):
    """What a command frame says."""

    position_rad: float = 0.0
    velocity_rad_s: float = 0.0
    kp_nm_rad: float = 0.0
    kd_nm_s_rad: float = 0.0
    torque_nm: float = 0.0


def centred(code: int, bits: int, most: float) -> float:
    """Return the value of a code of a range from -most to +most."""
    return 2.0 * most * code / ((1 << bits) - 1) - most


def code_of(value: float, bits: int, most: float) -> int:
    """Return the code of a value of such a range; one beyond it has the code of its end."""
    top = (1 << bits) - 1
    return max(0, min(top, int((value + most) / (2.0 * most) * top)))


def wrapped_code(value: float, most: float) -> int:
    """Return the 16-bit code of a position: beyond the range it begins again at the other end."""
    return int((value + most) / (2.0 * most) * 0xFFFF // 1) % 0x10000


def read_command(data: bytes, scale: Scale) -> Command:
    """Read the 8 bytes of a command frame."""
    return Command(
        centred(data[0] << 8 | data[1], 16, scale.position_rad),
        centred(data[2] << 4 | data[3] >> 4, 12, scale.velocity_rad_s),
        ((data[3] & 15) << 8 | data[4]) / 4095.0 * KP_MOST_NM_RAD,
        (data[5] << 4 | data[6] >> 4) / 4095.0 * KD_MOST_NM_S_RAD,
        centred((data[6] & 15) << 8 | data[7], 12, scale.torque_nm),
    )


def write_command(command: Command, scale: Scale) -> bytes:
    """Write the 8 bytes of a command frame, as the maker's tool does."""
    q = code_of(command.position_rad, 16, scale.position_rad)
    dq = code_of(command.velocity_rad_s, 12, scale.velocity_rad_s)
    kp = int(command.kp_nm_rad / KP_MOST_NM_RAD * 4095)
    kd = int(command.kd_nm_s_rad / KD_MOST_NM_S_RAD * 4095)
    tau = code_of(command.torque_nm, 12, scale.torque_nm)
    middle = (dq & 15) << 4 | kp >> 8
    return bytes(
        (q >> 8, q & 255, dq >> 4, middle, kp & 255, kd >> 4, (kd & 15) << 4 | tau >> 8, tau & 255)
    )


def write_feedback(
    head: int, position_rad: float, velocity_rad_s: float, torque_nm: float, scale: Scale
) -> bytes:
    """Write the 8 bytes of a feedback frame; `head` is status and id. Both parts have 30 °C."""
    q = wrapped_code(position_rad, scale.position_rad)
    dq = code_of(velocity_rad_s, 12, scale.velocity_rad_s)
    tau = code_of(torque_nm, 12, scale.torque_nm)
    return bytes((head, q >> 8, q & 255, dq >> 4, (dq & 15) << 4 | tau >> 8, tau & 255, 30, 30))
