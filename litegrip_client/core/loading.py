"""Load and save the gripper's calibration: which way closing is, and how far it is.

There is one calibration, the daemon's, for all its clients. Files are the client's, where a path
is given or LITEGRIP_CALIB names one; their contents travel.
"""

from __future__ import annotations

from litegrip_client.core.base import ActionBase
from litegrip_client.core.link import ACTION_TIMEOUT_S
from litegrip_client.errors import BusyError, CommandError
from litegrip_client.warn import warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: files are seldom worked with
    import os
    from typing import Any

    from litegrip_client.calibration import GripperConfig


class LoadingActions(ActionBase):
    """What concerns calibrations that were made before."""

    async def config(self) -> GripperConfig:
        """Return limits, gains and ids as the daemon has them now; not to be changed from here."""
        from litegrip_client.calibration import GripperConfig  # noqa: PLC0415 - see above

        return GripperConfig.from_wire(await self._link.wire.call("info.get"))

    async def load_calibration(
        self, path: str | os.PathLike[str] | None = None, template: str | None = None
    ) -> bool:
        """Have the daemon use a calibration, for all its clients; false if none was found.

        `path` is a file of this program's; `template` "normal" or "reverse". Without either it is
        looked for as `litegrip_client.LiteGrip.load_calibration` says.
        """
        from litegrip_client import calibration_files as files  # noqa: PLC0415 - see above

        if template is not None:
            if path is not None:
                text = "either a path or a template can be loaded, not both"
                raise CommandError(text, reason="invalid_params")
            return await self.load_template(template)
        asked = path if path is not None else files.environment_path()
        if asked is None:
            return await self._load_found()
        name = files.template_at(asked)
        if name is not None:
            return await self.load_template(name)
        return await self._load({"content": await self._link.aside(files.read, asked)})

    async def load_template(self, name: str) -> bool:
        """Have the daemon use the nominal geometry of a mount, "normal" or "reverse"."""
        from litegrip_client.calibration_files import check_template  # noqa: PLC0415 - see above

        return await self._load({"template": check_template(name)})

    async def save_calibration(self, path: str | os.PathLike[str] | None = None) -> str:
        """Save the calibration in use; return the path.

        With `path`, or LITEGRIP_CALIB, to that file of this program's; else the daemon saves it
        where it finds it at its next start.
        """
        from litegrip_client import calibration_files as files  # noqa: PLC0415 - see above

        target = path if path is not None else files.environment_path()
        if target is None:
            saved = await self._link.wire.call("calibration.save", None, ACTION_TIMEOUT_S)
            return str(saved["path"])
        return await self._link.aside(files.write, target, await self._content())

    async def _load(self, params: dict[str, Any]) -> bool:
        answer = await self._command("calibration.load", params, ACTION_TIMEOUT_S)
        return answer["loaded"] is True

    async def _load_found(self) -> bool:
        from litegrip_client.calibration_files import own_files  # noqa: PLC0415 - see above

        try:
            answer = await self._command("calibration.load", {}, ACTION_TIMEOUT_S)
        except BusyError:
            if (await self._link.wire.call("calibration.get"))["calibrated"] is True:
                return True
            raise
        if answer["loaded"] is True and answer["factory"] is not True:
            return True
        for reason in answer["skipped"]:
            warn(f"the daemon passed over: {reason}")
        own = own_files(self._link.channel)
        found = await self._link.aside(next, own, None)
        if found is None:
            return answer["loaded"] is True
        try:
            return await self._load({"content": found[1]})
        except CommandError as error:
            error.message = f"{found[0]}: {error.message}"
            raise

    async def _content(self) -> dict[str, Any]:
        """Return what a file of the calibration in use holds, other programs' keys included."""
        present = await self._link.wire.call("calibration.get")
        if present["calibrated"] is not True:
            text = "there is no calibration to be saved"
            raise CommandError(text, reason="not_calibrated")
        content: dict[str, Any] = present["content"]
        return content
