"""Warnings in place of errors that cannot be raised: another exception is under way already.

Not in `errors`, which the pure rooms of the daemon import: they must not import `logging`.
"""

from __future__ import annotations

from collections.abc import Callable

from litegrip_client.values.errors import ConnectError, HardwareError, LiteGripError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from collections.abc import Awaitable


def warn(text: str) -> None:
    """Log a warning under the name `litegrip_client`."""
    import logging  # noqa: PLC0415 - takes milliseconds to import, and is hardly ever needed

    logging.getLogger("litegrip_client").warning("%s", text)


async def leave(close: Callable[[], Awaitable[object]], error: BaseException | None) -> None:
    """Close at the end of a `with` block, which `error` ended, if any.

    An error of the closing is raised, but only logged where it would hide the block's own.
    """
    try:
        await close()
    except LiteGripError as second:
        if error is None:
            raise
        if second.is_told or second.text == getattr(error, "text", str(error)):
            return
        if second.data.get("motor_off") and getattr(error, "reason", None) == second.reason:
            return  # an orderly end: the block's own error has said it, and that the motor is off
        if isinstance(second, HardwareError | ConnectError):
            # The motor may be energised: that stands alone.
            why = error.message if isinstance(error, LiteGripError) else ""
            warn(second.message.removesuffix(f": {why}"))
        else:
            warn(f"on leaving after {type(error).__name__}: {second}")
