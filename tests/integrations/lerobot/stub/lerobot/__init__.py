"""LeRobot's base classes as far as the plug-in meets them, for `make check`.

LeRobot is 5 GB: `make lerobot` tries the plug-in with the real one. What is abstract there is
abstract here.
"""

import importlib
from typing import Any


def made(config: Any) -> Any:
    """Make the device of a configuration, found as LeRobot finds it: by the class's name."""
    of = type(config)
    package = importlib.import_module(of.__module__.rpartition(".")[0] or of.__module__)
    return getattr(package, of.__name__.removesuffix("Config"))(config)
