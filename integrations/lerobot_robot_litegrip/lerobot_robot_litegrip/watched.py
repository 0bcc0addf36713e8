"""A gripper as its follower and its leader share it: what is known of it, and what is refused."""

from __future__ import annotations

import abc
import logging
from typing import NamedTuple

from lerobot_robot_litegrip.config import GripperSettings
from lerobot_robot_litegrip.mapping import Travel, clipped
from litegrip_client import (
    CommandError,
    ConnectError,
    GripperState,
    HardwareError,
    Latest,
    LiteGrip,
    LiteGripError,
    StoppedError,
    TeleopBusyError,
    TeleopNotActiveError,
)
from litegrip_client.values.voices import in_shell_of

_log = logging.getLogger(__name__)

_STATES_HZ = 200.0
_SILENCE_S = 0.5
_PATIENCE = 100
"""States that are waited for until one is fresh: half a second of them."""


class StaleFiguresError(HardwareError):
    """The motor has not reported for too long: nobody knows where the jaws are by now."""


class Fresh(NamedTuple):
    """A state whose figures are fresh: measured at `feedback_s`, `age_s` ago."""

    state: GripperState
    feedback_s: float
    age_s: float


class WatchedGripper(abc.ABC):
    """The connection to a gripper, its newest figures, and the question before a calibration."""

    def __init__(self, settings: GripperSettings) -> None:
        self._settings = settings
        self._gripper = LiteGrip(
            settings.channel,
            disable_on_disconnect=settings.disable_torque_on_disconnect,
            voice=in_shell_of(self._here),  # of who types LeRobot's commands
        )
        self._latest: Latest | None = None
        self._travel: Travel | None = None
        self._zero_s = 0.0
        self._last_s = 0.0

    @abc.abstractmethod
    def start(self) -> None:
        """Enable the motor for what this gripper is there for, and `begin`."""

    @property
    @abc.abstractmethod
    def action_features(self) -> dict[str, type]:
        """What an action has."""

    def _here(self, command: str) -> str:
        return command.replace("litegripctl", f"litegripctl -c {self._gripper.channel}")

    @property
    def name(self) -> str:
        """Which gripper it is, for messages."""
        return f"gripper {self._gripper.channel}"

    @property
    def is_connected(self) -> bool:
        """True if calls can be made."""
        return self._gripper.is_connected

    @property
    def is_calibrated(self) -> bool:
        """True if the daemon knows the travel."""
        return self._gripper.get_state().calibrated

    @property
    def latest(self) -> Latest:
        """The newest state; raises `ConnectError` before `connect`."""
        if self._latest is None:
            raise ConnectError(f"{self.name} is not connected", reason="not_connected")
        return self._latest

    @property
    def travel(self) -> Travel:
        """The travel in use since `begin`; raises `ConnectError` before."""
        if self._travel is None:
            raise ConnectError(f"{self.name} has not begun", reason="not_connected")
        return self._travel

    @property
    def zero_s(self) -> float:
        """What stamps count from, by the daemon's clock."""
        return self._zero_s

    def connect(self) -> None:
        """Connect, and begin to watch; nothing moves. Raises `ConnectError`."""
        self._gripper.connect()
        self._latest = self._gripper.latest(_STATES_HZ)

    def begin(self) -> None:
        """Read the travel, and count stamps from now on. Raises `CommandError` without a travel."""
        self._travel = Travel.from_info(self._gripper.info())
        self._zero_s = self._last_s = self.fresh().feedback_s
        _log.info("%s: stamps count from %.6f s of its daemon's clock", self.name, self._zero_s)

    def enable(self) -> None:
        """Take the lease and enable the motor.

        Raises `LeaseError`, which names the owner, `StoppedError` and `HardwareError`.
        """
        enabled = self._gripper.enable()
        if not enabled:
            raise HardwareError(enabled.message or f"{self.name}: the motor is not enabled")

    def disconnect(self) -> None:
        """Disconnect; the motor is then disabled, or goes on holding, as it is set.

        What fails of that is logged, not raised: LeRobot disconnects one device after the other.
        """
        self._latest = None
        try:
            self._gripper.disconnect()
        except LiteGripError as error:
            _log.error("%s, at its end: %s", self.name, error)

    def fresh(self) -> Fresh:
        """Return a state whose figures are fresh, and newer than those returned before.

        It waits for one half a second at most, and then raises `StaleFiguresError`, or
        `ConnectError` when the daemon says nothing at all.
        """
        latest, most_s = self.latest, self._settings.max_age_s
        for _ in range(_PATIENCE):
            state, age_s = latest.state, latest.feedback_age_s
            feedback_s = state.feedback_s
            is_fresh = age_s is not None and age_s <= most_s
            if (
                feedback_s is not None
                and age_s is not None
                and is_fresh
                and feedback_s > self._last_s
            ):
                self._last_s = feedback_s
                return Fresh(state, feedback_s, age_s)
            latest.wait_newer(_SILENCE_S)
        known = "there are none" if age_s is None else f"they are {age_s * 1000.0:.0f} ms old"
        raise StaleFiguresError(
            f"{self.name}: its figures are refused, {known} (max_age_s is {most_s:g}):"
            f" the bus is {state.bus}, the motor {state.motor}",
            reason="stale",
        )

    def refuse_stop(self) -> GripperState:
        """Return the newest state; raises `StoppedError` while a stop is latched."""
        state = self.latest.state
        if state.stop is not None:
            by, why = state.stop["by"] or "its daemon", state.stop["why"]
            raise StoppedError(
                f"{self.name} is stopped ({state.stop['level']}) by {by}"
                + (f": {why}" if why else ""),
                reason="stopped",
                data={"hint": self._here("clear it: litegripctl clear")},
            )
        return state

    def teleoperates(self, mode: str) -> bool:
        """Return whether its daemon teleoperates; raises `TeleopBusyError` if in another mode."""
        status = self._gripper.teleop_status()
        if status["active"] and status["mode"] != mode:
            raise TeleopBusyError(
                f"{self.name} is a {status['mode']} of teleoperation, not a {mode}",
                reason="teleop_busy",
            )
        return bool(status["active"])

    def refuse_end_of_teleoperation(self) -> None:
        """Raise `StoppedError` or `TeleopNotActiveError` unless its daemon still teleoperates."""
        state = self.refuse_stop()
        if state.job is None or state.job["kind"] != "teleop":
            raise TeleopNotActiveError(
                f"{self.name}: teleoperation has ended", reason="teleop_not_active"
            )

    def calibrate(self) -> None:
        """Ask at the terminal, and only then probe the travel; an empty answer changes nothing.

        Raises `CommandError` where nobody can answer, or for an answer that is no opening, and
        what `LiteGrip.zero` raises.
        """
        question = (
            f"{self.name}: its jaws will move to both stops and press on each of them. Take"
            " everything out of them.\nType how far they open, in mm, as a caliper measures it;"
            " ENTER alone changes nothing: "
        )
        try:
            answer = input(question).strip()
        except EOFError as error:
            raise CommandError(
                f"{self.name}: a calibration asks before it moves, and there is no terminal",
                reason="not_calibrated",
                data={"hint": self._here("calibrate it: litegripctl zero")},
            ) from error
        if not answer:
            return
        stroke_mm = clipped("the opening", answer, 0.0, 1000.0)
        self.enable()
        data = self._gripper.zero(mount=self._settings.mount, stroke_mm=stroke_mm)
        _log.info("%s is calibrated: it opens %.1f mm", self.name, data.stroke_mm)
