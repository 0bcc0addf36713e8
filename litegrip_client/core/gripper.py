"""A gripper at its daemon: the actions, and the connection, the lease, the stop, and what is read.

The session knows how to wait for the daemon. `threads/actions.py`, for threads, is partly generated
from this file: its docstrings are written for both.
"""

from __future__ import annotations

import os

from litegrip_client.core.actions import GripperActions, state_of
from litegrip_client.core.session import ACTION_TIMEOUT_S, DaemonSession, Lease
from litegrip_client.core.sockets import STOP_LEVELS
from litegrip_client.core.stop import stop, stop_params
from litegrip_client.values.checks import flag
from litegrip_client.values.errors import (
    BusyError,
    HardwareError,
    LiteGripError,
    NotPermittedError,
    ParameterError,
    StoppedError,
    from_error_object,
)
from litegrip_client.values.results import GripperState
from litegrip_client.values.tracebacks import STOPPED_ALL_THE_SAME
from litegrip_client.values.warn import leave, warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: what is seldom needed takes its time to import
    from typing import Any, Literal

    from litegrip_client.core.session import Wire
    from litegrip_client.values.calibration import GripperConfig
    from litegrip_client.values.motion_config import MotionConfig
    from litegrip_client.values.printed import HealthReport, JobTable


class Gripper(GripperActions):
    """The actions, the connection, the lease, the stop, and what can be asked."""

    def __init__(
        self,
        session: DaemonSession,
        mount: str | None,
        motion_config: MotionConfig | None,
        config: GripperConfig | None = None,
    ) -> None:
        """Raise `CommandError` for what cannot be a mount or a `MotionConfig`."""
        super().__init__(session, motion_config, config)
        session.connects_first(self.connect)
        self._template: str | None = None
        if mount is not None:
            from litegrip_client.values.calibration_files import check_template  # noqa: PLC0415 - see above

            self._template = check_template(mount)

    # Connection

    async def connect(self) -> bool:
        """Connect to the daemon, unless connected, and load the constructor's `mount`; true.

        Raises `ConnectError` when no daemon answers (its hint says how to start one). Raises
        `CommandError` when the daemon has another channel or CAN id, or cannot load the mount.
        While another client moves the gripper, or where this user may only watch, the mount is
        not loaded, and a warning is logged; `enable` loads it then.
        """
        await self._session.open(self._begin)
        return True

    async def _begin(self, wire: Wire) -> None:
        self._mount_due = self._template
        if self._template is None:
            return
        try:
            await self._load_mount(wire)
        except (BusyError, NotPermittedError) as error:
            warn(f"mount {self._template!r} is not loaded yet: {error.message}")

    async def disconnect(self) -> None:
        """Disconnect; first disable the motor if this object enabled it.

        The motor stays enabled if `disable_on_disconnect` is false. Raises the error of
        disabling, but closes the connection in any case.
        """
        await self._session.close()

    async def __aexit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        await leave(self.disconnect, error)

    @property
    def is_connected(self) -> bool:
        """True if calls can be made."""
        return self._session.is_open

    @property
    def channel(self) -> str:
        """The daemon's channel; where a socket alone is named, its path before `connect`."""
        return self._session.channel

    @property
    def socket_path(self) -> str | None:
        """The daemon's socket: of the connection, else what the constructor was given, or None."""
        session = self._session
        return session.wire.connection.socket_path if session.is_open else session.socket_path

    @property
    def disable_on_disconnect(self) -> bool:
        """True if the end of the connection disables the motor that this object enabled.

        `disconnect` uses the present value; after a crash the value at `enable` counts.
        """
        return self._session.disable_on_disconnect

    @disable_on_disconnect.setter
    def disable_on_disconnect(self, value: bool) -> None:
        self._session.disable_on_disconnect = flag("disable_on_disconnect", value)

    # The lease

    def lease(
        self,
        purpose: str | None = None,
        *,
        ttl_s: float | None = None,
        wait_s: float = 0.0,
        on_lost: str | None = None,
    ) -> Lease:
        """Take the lease, for exclusive control: `async with gripper.lease("sorting", wait_s=10):`.

        Without a block nothing is taken before `acquire` of what is returned, until its `release`.
        `enable` takes the lease automatically, until `disconnect`.
        `wait_s` is how long to wait for another owner. With `ttl_s` the lease is lost when no
        call is made for that time; a longer motion is ended. `on_lost` is what the jaws do when
        the lease is lost: "hold", "relax" or "disable" (default: what `enable` has said, before
        or after, which is "disable" with `disable_on_disconnect`; without it "hold"). In a
        take-over, the new owner decides.
        Raises `LeaseError`, which names the owner. After a loss, `disable` and every motion raise
        `LeaseError` (`lease_lost`) until `lease` or `enable` takes the lease again. The end of who
        had enabled before then disables the motor again, whoever has enabled it meanwhile.
        """
        options = {"purpose": purpose, "ttl_s": ttl_s, "wait_s": wait_s, "on_lost": on_lost}
        return Lease(self._session, options)

    async def take_lease(self, why: str = "no reason given", *, jaws: str = "hold") -> None:
        """Take the lease from its present owner; the owner is notified of the reason `why`.

        The motion that runs ends, also one without a lease, and nothing that others have queued
        begins. Who has lost by that gets `LeaseError` (`lease_lost`) until it takes the lease. The
        jaws then keep what they hold, or follow `jaws`: "relax" (no torque) or "disable". A motor
        that is enabled is this object's to disable at its end, as after its own `enable`.

        Raises `NotPermittedError` unless the owner is the same user, or this user is an admin in
        the daemon's configuration.
        """
        await self._session.take(why, jaws)

    # Stop

    async def cancel(self) -> bool:
        """Cancel this object's own motion: the jaws hold; true if one was cancelled.

        Who waits for the motion, or sends a stream of targets, gets `CancelledError`. What this
        object has begun in the background (a replay, a recording, teleoperation) ends as well.
        Any thread or task may call it, and a signal handler while its thread waits for the motion:
        there it returns at once, true, and the motion ends a moment later. Nothing is latched, and
        what other objects and programs move goes on.
        """
        return await self._session.cancel_own()

    async def stop(self) -> None:
        """Take the torque off the jaws at once; they are slack until the next motion.

        It ends this object's own motion and latches nothing: the next motion may begin. A motor
        that is disabled has no torque already.

        If the gripper is not this object's to move (another client has the lease, or moves it, or
        this user may not), it is stopped all the same, by `software_stop("relax")`, which is
        latched. A warning is logged then. The same happens in a signal handler whose thread waits
        for a motion.
        """
        try:
            await self._session.ask("motion.zero_gravity", {"if_busy": "replace"})
        except (BusyError, NotPermittedError, StoppedError) as error:
            await self.software_stop("relax", "stop() beside another call or client")
            warn(_stopped_for_all(error, self._session))
        except HardwareError:
            if (await self.get_state()).enabled is not False:
                raise

    async def software_stop(
        self, level: Literal["hold", "relax", "disable"] = "hold", why: str | None = None
    ) -> GripperState:
        """Stop the gripper, whichever client moves it, until `clear_stop`.

        `level` is "hold", "relax" or "disable". Any thread may call it, and also a signal
        handler while its thread waits for a motion. The stop uses the daemon's stop socket, which
        other requests cannot delay; there a reason is cut to 80 characters. Without that socket it
        is sent as a usual request; without a connection it connects by itself. This is a software
        stop: it does not replace the switch that cuts the power.

        Raises `CANTimeoutError` if the stop is latched, but the motor does not answer, enabled or
        not: then nothing reaches it, so cut its power. Raises `ConnectError` if none confirms the
        stop, after about 2 s on this machine, 5 s where this object must connect first: the stop
        may still act, so cut the power, too. Wrong arguments raise their error after the gripper
        was stopped ("hold").
        """
        levels = " or ".join(map(repr, STOP_LEVELS))
        wrong = [] if level in STOP_LEVELS else [f"level is {level!r:.60}, it must be {levels}"]
        reason: object = why
        if not isinstance(reason, str | None):
            wrong.append(f"why is {reason!r:.60}, it must be text")
        if not wrong:
            return state_of(await stop(self._session, stop_params(level, why)))
        await stop(self._session, stop_params("hold", None))
        text = "; ".join((*wrong, STOPPED_ALL_THE_SAME))
        raise ParameterError(text, reason="invalid_params")

    async def clear_stop(self) -> GripperState:
        """Clear a stop: the motor may then be enabled and moved again. Moves nothing.

        Raises `StoppedError` (`sent_before_stop`) for a stop that this object did not know of:
        look at the state, and clear again.
        """
        return state_of(await self._session.command("stop.clear", {}))

    # Reading

    async def get_state(self, wait: bool = True) -> GripperState:  # noqa: ARG002 - the vendor's
        """Return the daemon's newest state; it never waits for the bus. Look at `stale`.

        `wait` makes no difference: the daemon asks the motor in every period, also while nobody
        calls, so the state is as new as one that was waited for.
        """
        return GripperState.from_wire(await self._session.wire.call("state.get"))

    async def health(self) -> HealthReport:
        """Return the daemon's health: its verdict, the bus, the ticks, the clients.

        `reasons` say why the verdict is not "ok"; `notes` what is normal and worth knowing. It is
        a dictionary, which prints line by line.
        """
        from litegrip_client.values.printed import HealthReport  # noqa: PLC0415 - see above
        from litegrip_client.values.terms import told_all  # noqa: PLC0415 - see above

        figures = HealthReport(await self._session.wire.call("health"))
        for name in ("reasons", "notes"):
            if name in figures:
                figures[name] = told_all(figures, name, self._session.voice)
        figures.pop("terms", None)
        return figures

    async def info(self) -> dict[str, Any]:
        """Return what does not change: versions, the motor's registers, ranges, calibration."""
        return await self._session.wire.call("info.get")

    async def dump(self, note: str | None = None) -> str:
        """Write the last minute, tick by tick, to a file; return its path on the daemon's machine.

        `litegripctl plot` draws it, and so does the page in the browser; it is an MCAP file. `note`
        says in it what it is of. Raises `CommandError` when it cannot be written.
        """
        params = {} if note is None else {"note": str(note)}
        dumped = await self._session.wire.call("recorder.dump", params, ACTION_TIMEOUT_S)
        return str(dumped["path"])

    async def jobs(self) -> JobTable:
        """Return the running jobs and the ended ones that are still kept, of all clients.

        It is a list of dictionaries, which prints as a table.
        """
        from litegrip_client.values.printed import JobTable  # noqa: PLC0415 - see above

        rows = (await self._session.wire.call("job.list"))["jobs"]
        for row in rows:
            if row.get("error"):
                error = from_error_object(row["error"], voice=self._session.voice)
                row["error"] = {**row["error"], "message": error.message}
        return JobTable(rows)

    async def mount(self) -> str | None:
        """Return which way the motor is mounted, "normal" or "reverse"; None until calibrated.

        Before the first `connect` it connects.
        """
        await self._session.open_first()
        return (await self.get_state()).mount


def _stopped_for_all(error: LiteGripError, session: DaemonSession) -> str:
    """Say what `stop` has done to a gripper that was not its object's to move, and why."""
    owner, connection = error.owner, session.wire.connection
    if isinstance(error, NotPermittedError):
        why = "this user may not move it"
    elif isinstance(error, StoppedError):
        why = "a stop was latched already"
    elif owner is None:
        why = error.message
    elif connection.has_clock and owner.get("pid") == os.getpid():
        why = "another call or object of this program has it"
    else:
        verb = "has taken it" if error.reason == "lease_lost" else "has it"
        why = f"{owner.get('program')} (pid {owner.get('pid')}) {verb}"
    clear = session.voice("stop.clear", None, None) or "stop.clear"
    return f"stop(): the gripper is stopped for every client, until {clear}: {why}"


_AWAITED = "(await gripper.get_state())."


def no_member(owner: object, name: str, *, is_assigned: bool = False) -> AttributeError:
    """Return the error for a member that no gripper has; it names the one that was meant."""
    from litegrip_client.values.motion_config import MotionConfig  # noqa: PLC0415 - an error
    from litegrip_client.values.voices import no_attribute  # noqa: PLC0415 - an error

    read: dict[str, type] = {"get_state().": GripperState}
    assigned: dict[str, type] = {"motion_config.": MotionConfig}
    error = no_attribute(owner, name, assigned if is_assigned else read | assigned)
    if isinstance(owner, Gripper):  # that of asyncio: the other one only has such a gripper
        error.args = tuple(str(text).replace("get_state().", _AWAITED) for text in error.args)
    if is_assigned and error.obj is owner:  # nothing like it was found
        error.args = (f"{error}: only a subclass may have attributes of its own",)
    return error
