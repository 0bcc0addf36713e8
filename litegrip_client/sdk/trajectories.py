"""Where trajectories lie, by the SDK's names."""

from __future__ import annotations

import os

from litegrip_client.trajectory_files import directory, path_of

DEFAULT_RATE_HZ = 100.0
"""Samples a second of a recording."""


def trajectory_dir() -> str:
    """Return the directory of this user's trajectories; LITEGRIP_TRAJ_DIR names another one."""
    return str(directory())


def resolve_path(name: str | os.PathLike[str]) -> str:
    """Return the file that a trajectory's name means; one with a path separator is used as it is.

    Raises `ParameterError` for what cannot be a name.
    """
    return str(path_of(name))
