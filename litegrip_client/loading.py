"""Load and save the gripper's calibration: which way closing is, and how far it is.

There is one calibration, the daemon's, for all its clients. Files are the client's, where a path
is given or LITEGRIP_CALIB names one; their contents travel.
"""

from __future__ import annotations

from litegrip_client.base import ActionBase
from litegrip_client.errors import BusyError, CommandError
from litegrip_client.link import ACTION_TIMEOUT_S
from litegrip_client.warn import warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    import os
    from typing import Any

    from litegrip_client.calibration import GripperConfig


class LoadingActions(ActionBase):
    """What concerns calibrations that were made before."""

    @property
    def config(self) -> GripperConfig:
        """Limits, gains and ids as the daemon has them now; not to be changed from here."""
        from litegrip_client.calibration import GripperConfig  # noqa: PLC0415 - see the package

        return GripperConfig.from_wire(self._link.connection.call("info.get"))

    def load_calibration(
        self, path: str | os.PathLike[str] | None = None, template: str | None = None
    ) -> bool:
        """Have the daemon use a calibration, for all its clients; false if none was found.

        `path` is a file of this program's; one of `CALIB_TEMPLATES` is that template. `template`
        is "normal" or "reverse". Without either: the file that LITEGRIP_CALIB of this program's
        environment names; else what the daemon finds for the channel (its own file, or the user's
        whom it runs as); else ~/.litegrip/<channel>_calibration.json and
        ~/.litegrip/litegrip_calibration.json of this program's user; else, for can0, the
        factory's. While somebody's motion runs, what the daemon has in use already will do.

        What was asked for by name and cannot be used is a `CommandError`, never another file.
        """
        from litegrip_client import calibration_files as files  # noqa: PLC0415 - see the package

        if template is not None:
            if path is not None:
                text = "either a path or a template can be loaded, not both"
                raise CommandError(text, reason="invalid_params")
            return self.load_template(template)
        asked = path if path is not None else files.environment_path()
        if asked is None:
            return self._load_found()
        name = files.template_at(asked)
        if name is not None:
            return self.load_template(name)
        return self._load({"content": files.read(asked)})

    def load_template(self, name: str) -> bool:
        """Have the daemon use the nominal geometry of a mount, "normal" or "reverse".

        Raises `CommandError` for another name, and when the daemon cannot use it.
        """
        from litegrip_client.calibration_files import check_template  # noqa: PLC0415 - see above

        return self._load({"template": check_template(name)})

    def save_calibration(self, path: str | os.PathLike[str] | None = None) -> str:
        """Save the calibration in use; return the path.

        With `path`, or LITEGRIP_CALIB, to that file of this program's; else the daemon saves it
        where it finds it at its next start. Raises `CommandError` when there is none, or when
        the file cannot be written.
        """
        from litegrip_client import calibration_files as files  # noqa: PLC0415 - see above

        target = path if path is not None else files.environment_path()
        if target is None:
            saved = self._link.connection.call("calibration.save", None, ACTION_TIMEOUT_S)
            return str(saved["path"])
        return files.write(target, self._content())

    def _load(self, params: dict[str, Any]) -> bool:
        return self._command("calibration.load", params, ACTION_TIMEOUT_S)["loaded"] is True

    def _load_found(self) -> bool:
        from litegrip_client.calibration_files import own_files  # noqa: PLC0415 - see above

        try:
            answer = self._command("calibration.load", {}, ACTION_TIMEOUT_S)
        except BusyError:
            if self._link.connection.call("calibration.get")["calibrated"] is True:
                return True
            raise
        if answer["loaded"] is True and answer["factory"] is not True:
            return True
        for reason in answer["skipped"]:
            warn(f"the daemon passed over: {reason}")
        found = next(own_files(self._link.channel), None)
        if found is None:
            return answer["loaded"] is True
        try:
            return self._load({"content": found[1]})
        except CommandError as error:
            error.message = f"{found[0]}: {error.message}"
            raise

    def _content(self) -> dict[str, Any]:
        """Return what a file of the calibration in use holds, other programs' keys included."""
        present = self._link.connection.call("calibration.get")
        if present["calibrated"] is not True:
            text = "there is no calibration to be saved"
            raise CommandError(text, reason="not_calibrated")
        content: dict[str, Any] = present["content"]
        return content
