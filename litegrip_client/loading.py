"""Load and save the gripper's calibration: which way closing is, and how far it is.

There is one calibration, the daemon's, for all its clients. Files are the client's, where a path
is given or LITEGRIP_CALIB names one; their contents travel.
"""

from __future__ import annotations

from litegrip_client.base import ActionBase
from litegrip_client.blocking import wait

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    import os

    from litegrip_client.calibration import GripperConfig


class LoadingActions(ActionBase):
    """The actions for existing calibrations."""

    @property
    def config(self) -> GripperConfig:
        """Limits, gains and ids as the daemon has them now; not to be changed from here."""
        return wait(self._core.config())

    def load_calibration(
        self, path: str | os.PathLike[str] | None = None, template: str | None = None
    ) -> bool:
        """Have the daemon use a calibration, for all its clients; false if none was found.

        `path` is a file of this program's; one of `CALIB_TEMPLATES` is that template. `template`
        is "normal" or "reverse". Without either: the file that LITEGRIP_CALIB of this program's
        environment names; else what the daemon finds for the channel (its own file, or the user's
        whom it runs as); else ~/.litegrip/<channel>_calibration.json and
        ~/.litegrip/litegrip_calibration.json of this program's user; else, for can0, the
        factory's. While any client's motion runs, only the calibration already in use is accepted.

        Raises `CommandError` when a named calibration cannot be used; never takes another file.
        The daemon logs the closing direction; `mount` returns it, too.
        """
        return wait(self._core.load_calibration(path, template))

    def load_template(self, name: str) -> bool:
        """Have the daemon use the nominal geometry of a mount, "normal" or "reverse".

        The daemon logs the closing direction; `mount` returns it, too. Raises `CommandError` for
        another name, and when the daemon cannot use it.
        """
        return wait(self._core.load_template(name))

    def save_calibration(self, path: str | os.PathLike[str] | None = None) -> str:
        """Save the calibration in use; return the path.

        With `path`, or LITEGRIP_CALIB, to that file of this program's; else the daemon saves it
        where it finds it at its next start. Raises `CommandError` when there is none, or when
        the file cannot be written.
        """
        return wait(self._core.save_calibration(path))
