"""How far jaws are open in a picture of MuJoCo's scene, and how far they should be there."""

from __future__ import annotations

import math
from collections.abc import Sequence

_CAMERA_Y_M, _CAMERA_Z_M, _FOVY_DEG = -0.42, 0.20, 30.0
_UP = (0.3 / math.hypot(0.3, 1.0), 1.0 / math.hypot(0.3, 1.0))
"""Upwards in the picture, in y and z: the camera `front` of `litegripd/sim/scene.xml`."""
_FACES_Y_M = -0.030
"""The fingers' faces towards the camera."""
ROW = 0.605
"""Of a picture's height: there the row meets both fingers, above the cube."""
_DARK = 84
"""Between the fingers' faces (126) and their dark inner sides (58 at most)."""


def seen_px(row: Sequence[int]) -> float | None:
    """Return how wide the jaws are open in that row of brightnesses, 0 to 255; None: not seen.

    Each finger's inner side is dark and its face is bright: looked for from the middle outwards.
    """
    middle = len(row) // 2
    left = _edge(row[:middle][::-1])
    right = _edge(row[middle:])
    return None if left is None or right is None else left + right


def _edge(outwards: Sequence[int]) -> float | None:
    """Return how far the end of the first dark stretch is."""
    dark = next((index for index, shade in enumerate(outwards) if shade < _DARK), None)
    if dark is None:
        return None
    for index in range(dark, len(outwards)):
        if outwards[index] > _DARK:
            before, after = outwards[index - 1], outwards[index]
            return index - 0.5 + (_DARK - before) / (after - before)
    return None


def expected_px(opening_mm: float, height_px: int) -> float:
    """Return how wide jaws that are open so far must be in that row of a picture."""
    focal_px = height_px / 2.0 / math.tan(math.radians(_FOVY_DEG / 2.0))
    up = (height_px / 2.0 - (int(ROW * height_px) + 0.5)) / focal_px
    # A ray through the row goes by (y, z) for each metre of depth, until it meets the faces.
    ray_y = _UP[1] + up * _UP[0]
    depth_m = (_FACES_Y_M - _CAMERA_Y_M) / ray_y
    return opening_mm / 1000.0 * focal_px / depth_m
