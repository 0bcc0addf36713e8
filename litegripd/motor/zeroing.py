"""Setting the motor's zero to where the jaws are, confirmed by later measurements.

A motor takes the frame only while it is disabled, and does not report a lost one. So the frame is
sent once the jaws stand still and the motor reports that it is disabled. It is sent again if the
measured position shows that it was lost. The setting ends when the motor leaves the disabled state.
It sends nothing that energises.
"""

from litegripd.model.bus import CanFrame
from litegripd.model.errors import Refusal
from litegripd.model.motor import Feedback, Ranges, ZeroView
from litegripd.model.plain import Carried
from litegripd.motor import codec
from litegripd.motor.faults import SILENT
from litegripd.motor.registers import status_request

ZERO_TRIES = 3
"""The most tries; fewer if answers are lost as well, because the time is limited to that of
three."""
RETRY_S = 0.05
CONFIRM_AFTER_S = 0.01  # earlier answers may still be on their way when the frame is sent
ZERO_WITHIN_RAD = 0.01  # less than 1 mm
REST_S = 0.05
REST_WITHIN_RAD = 0.002
REST_GIVES_UP_S = 0.5  # springs have long relaxed by then: a hand moves the jaws
SILENT_AFTER_S = 0.05
NOISE_CODES = 4
"""Two measured positions of jaws at rest differ by less. In a wide range one code is much."""

NOT_DISABLED = Refusal(
    "not_confirmed", "the motor takes a new zero only while it is disabled: disable it first"
)
UNDER_WAY = Refusal("busy", "the motor's zero is being set: try again")
LEFT = "the motor did not stay disabled while its zero was being set"

_IDLE = ZeroView()
_MOVING = "the jaws do not rest, so the zero was not set: keep them still and try again"
_MOVED = "the jaws were moved while the zero was being set: keep them still and try again"
_UNCERTAIN = "; it may or may not be set: find out where the jaws are before they are moved"


class Zeroing:
    """One setting of the zero, from the request to its end; only a pending `view` acts."""

    view: Carried[ZeroView]
    NOT_CARRIED = (
        "_answered_s",
        "_before_rad",
        "_began_s",
        "_can_id",
        "_first_try_s",
        "_is_due",
        "_is_unchanged",
        "_last_try_s",
        "_position_rad",
        "_rest_rad",
        "_rest_within_rad",
        "_rests_since_s",
        "_tries",
        "_zero_within_rad",
    )  # they count only while it is pending

    def __init__(self, can_id: int, ranges: Ranges, now_s: float, view: ZeroView = _IDLE) -> None:
        self.view = view
        noise_rad = NOISE_CODES * 2.0 * ranges.position_rad / 65535
        self._zero_within_rad = max(ZERO_WITHIN_RAD, noise_rad)
        self._rest_within_rad = max(REST_WITHIN_RAD, noise_rad)
        self._can_id = can_id
        self._began_s = self._answered_s = now_s
        self._rest_rad = float("inf")
        self._rests_since_s = now_s
        self._position_rad = self._before_rad = 0.0
        self._is_due = False
        self._tries = 0
        self._first_try_s = self._last_try_s = now_s
        self._is_unchanged = False

    @property
    def is_pending(self) -> bool:
        """True if it has not ended."""
        return self.view.state == "pending"

    def take(self, feedback: Feedback, now_s: float) -> None:
        """Take feedback that reports "disabled"; call it before `step`."""
        if not self.is_pending:
            return
        self._answered_s = now_s
        self._position_rad = feedback.position_rad
        if self._tries == 0:
            self._is_due = self._rests(now_s)
        elif now_s - self._last_try_s >= CONFIRM_AFTER_S:
            self._judge()
            self._is_due = now_s - self._last_try_s >= RETRY_S

    def step(self, now_s: float) -> list[CanFrame]:
        """Return the frames of this tick; the zero is set only right after an answer."""
        if self.is_pending:
            self._watch_time(now_s)
        if not self.is_pending:
            return []
        frames = [status_request(self._can_id)]
        if self._is_due:
            self._note_try(now_s)
            frames.insert(0, CanFrame(self._can_id, codec.SET_ZERO))
        return frames

    def leave(self) -> None:
        """End it, because the motor is no longer disabled."""
        if self.is_pending:
            self._fail(LEFT)

    def _rests(self, now_s: float) -> bool:
        """Return True if the jaws have not moved for a while."""
        if abs(self._position_rad - self._rest_rad) > self._rest_within_rad:
            self._rest_rad, self._rests_since_s = self._position_rad, now_s
        return now_s - self._rests_since_s >= REST_S

    def _note_try(self, now_s: float) -> None:
        if self._tries == 0:
            self._before_rad = self._position_rad
            self._first_try_s = now_s
        self._tries += 1
        self._last_try_s = now_s
        self._is_due = self._is_unchanged = False
        self.view = ZeroView("pending", is_uncertain=True)

    def _judge(self) -> None:
        """Judge by the position what became of the frame: taken, lost, or unknown."""
        shift_rad = self._before_rad - self._position_rad
        self._is_unchanged = False
        if abs(self._position_rad) <= self._zero_within_rad:
            self.view = ZeroView("done", shift_rad, self._position_rad)
        elif abs(shift_rad) <= self._zero_within_rad:
            self._is_unchanged = True
        else:
            self._fail(_MOVED)

    def _watch_time(self, now_s: float) -> None:
        is_silent = now_s - self._answered_s >= SILENT_AFTER_S
        if self._tries == 0 and now_s - self._began_s >= REST_GIVES_UP_S:
            if is_silent:
                self.view = ZeroView("failed", failure=SILENT)
            else:
                self._fail(_MOVING)
        elif self._tries and now_s - self._first_try_s >= ZERO_TRIES * RETRY_S:
            says = "does not answer" if is_silent else f"says {self._position_rad:.3f} rad"
            self._fail(f"the motor did not confirm its new zero, it {says}: check the CAN wiring")

    def _fail(self, message: str) -> None:
        is_uncertain = self._tries > 0 and not self._is_unchanged
        refusal = Refusal(
            "not_confirmed",
            message + (_UNCERTAIN if is_uncertain else ""),
            {"tries": self._tries},
        )
        self.view = ZeroView("failed", failure=refusal, is_uncertain=is_uncertain)
