"""Clients' requests on trajectories: record, replay, pause and continue.

Recording and replay exclude each other. A finished recording is kept until the helper process has
it, or the next one begins.
"""

import base64
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

from litegrip_client.values.trajectory_format import MAX_SAMPLES
from litegripd.control.admission import (
    busy_with,
    conflict_refusal,
    trajectory_or_teleop_refusal,
)
from litegripd.control.calibration import Terms
from litegripd.control.controller import Controller
from litegripd.control.events import NOW, Turn
from litegripd.control.limiter import Gains
from litegripd.model.errors import Refusal
from litegripd.model.motion_config import fast_conflict, slow_conflict
from litegripd.model.sentence import joined, sentence
from litegripd.model.state import HelperTask, Job, Owner, TaskResult
from litegripd.trajectories.capture import Capture, Teach, result_of
from litegripd.trajectories.file_methods import Temporaries
from litegripd.trajectories.replay import Replay, ReplayRequest
from litegripd.trajectories.values import PIECE_BYTES, outcome_of

OnKept: TypeAlias = Callable[[Mapping[str, Any] | Refusal], None]


def keep(
    controller: Controller, capture: Capture, where: Mapping[str, object], on_kept: OnKept
) -> None:
    """Send a recording to the helper process in pieces: first the samples, then the grips.

    `where` says how it is kept there; `on_kept` is called once, with the facts.
    """
    grips = json.dumps(capture.grips()).encode()
    common = {
        **where,
        "total": capture.size + len(grips),
        "grip_bytes": len(grips),
        "sha256": None,
        "header": capture.header(controller.gripper_id.can_id),
    }

    def send(offset: int) -> None:
        if offset < capture.size:
            data = capture.piece(offset // PIECE_BYTES)
        else:
            data = memoryview(grips)[offset - capture.size :][:PIECE_BYTES]

        def answered(result: TaskResult) -> None:
            answer = outcome_of(result, "not_saved")
            if isinstance(answer, Refusal):
                on_kept(answer)
            elif answer["complete"]:
                own = ("received", "complete")
                on_kept({key: value for key, value in answer.items() if key not in own})
            else:
                send(offset + len(data))

        piece = {"offset": offset, "data": base64.b64encode(data).decode("ascii")}
        controller.tasks.append(HelperTask("trajectory.put", {**common, **piece}, answered))

    send(0)


STAYS = sentence(
    "the recording stays until the next one begins: end it again ({trajectory.record_stop}), under"
    " a name or, to fetch it ({trajectory.get}), without one"
)


class Trajectories:
    """Begins and ends recordings and replays on one controller."""

    NOT_CARRIED = ("capture", "replay", "replay_job", "_controller", "_is_keeping", "_temporaries")

    def __init__(self, controller: Controller, temporaries: Temporaries) -> None:
        self.replay: Replay | None = None
        self.replay_job: Job | None = None
        self.capture: Capture | None = None
        """The latest recording: under way, over, or stored by the helper process."""
        self._controller = controller
        self._temporaries = temporaries
        self._is_keeping = False

    def refusal(self, turn: Turn = NOW) -> Refusal | None:
        """Return a refusal if a recording, a replay or teleoperation is under way at its turn."""
        controller = self._controller
        refusal = (
            trajectory_or_teleop_refusal(controller.in_the_way(turn))
            or controller.recording_refusal()
        )
        if refusal is not None:
            return refusal
        if self._is_keeping:
            text = "a recording is being taken to the disk's process: try again in a moment"
            return Refusal("trajectory_busy", text)
        return None

    # Recording

    @property
    def unkept(self) -> Capture | None:
        """The recording that has ended and is stored nowhere, if it has samples."""
        capture = self.capture
        if capture is None or capture.is_taken or self._is_keeping:
            return None
        return capture if capture.is_over and capture.samples else None

    def record(
        self,
        owner: Owner,
        terms: Terms,
        *,
        rate_hz: float,
        slack: bool,
        max_samples: int,
        detached: bool,
    ) -> Job | Capture | Refusal:
        """Begin to record, or return a refusal; with `slack` a job makes the jaws slack."""
        controller = self._controller
        geometry = self.refusal() or controller.travel(terms)
        if isinstance(geometry, Refusal):
            return geometry
        refusal = self._rate_refusal(rate_hz) or (controller.why_busy() if slack else None)
        if refusal is not None:
            return refusal
        capture = Capture(
            geometry,
            rate_hz,
            min(max_samples, MAX_SAMPLES),
            controller.period_s,
            owner.client,
            controller.now_s,
            detached,
        )
        capture.basis = controller.geometry
        if slack:
            action = Teach(capture)
            capture.job = controller.begin("record", action, owner, detached, terms=terms)
        self.capture = controller.capture = capture
        return capture.job or capture

    def stop_recording(
        self,
        name: str | None,
        owner: Owner,
        on_kept: OnKept,
        *,
        allow_empty: bool,
        allow_partial: bool,
    ) -> Refusal | None:
        """End the recording, and let the helper process store it, under a name if there is one.

        With a name it belongs to the owner's user, else to this connection. Then `on_kept` gets the
        facts. A recording that is rejected or cannot be stored stays until the next one begins.
        """
        controller, capture = self._controller, self.capture
        if self._is_keeping:
            return self.refusal()
        if capture is None or capture.is_taken:
            text = sentence("no recording is under way: begin one ({trajectory.record_start})")
            return Refusal("recording_failed", text)
        capture.note_job()  # it may have ended since the last tick
        feedback = controller.motor.feedback
        if feedback is not None and not capture.is_over:
            capture.take_one(controller.now_s, feedback, controller.grip, controller.jobs)
        capture.finish()
        if capture.job is not None and capture.job is controller.jobs.running:
            controller.end(result_of(capture, "stopped"))
        refusal = _unusable(capture, allow_empty=allow_empty, allow_partial=allow_partial)
        if refusal is not None:
            return refusal
        temporary = self._temporaries.of_recording(owner.client)

        def kept(answer: Mapping[str, Any] | Refusal) -> None:
            self._is_keeping = False
            if isinstance(answer, Refusal):
                self._temporaries.forget(temporary.name)
                on_kept(replace(answer, data={**answer.data, "hint": STAYS}))
            else:
                capture.let_go()
                on_kept(self._temporaries.kept(temporary, answer))

        self._is_keeping = True
        where = {"key": temporary.name, "name": name, "uid": owner.uid}
        keep(controller, capture, where, kept)
        return None

    def client_lost(self, client: int) -> None:
        """End a lost client's recording while others drive, unless it is detached."""
        capture = self.capture
        if capture is None or capture.job is not None or capture.detached:
            return
        if capture.client == client:
            capture.fail("the client that recorded went away")

    def _rate_refusal(self, rate_hz: float) -> Refusal | None:
        most_hz = 1.0 / self._controller.period_s
        if rate_hz <= most_hz + 1e-6:
            return None
        text = sentence(
            "{.rate_hz} is {rate_hz:g}, at most the control rate of {most_hz:g} is measured",
            rate_hz=rate_hz,
            most_hz=most_hz,
        )
        data = {"field": "rate_hz", "requested": rate_hz, "limit": most_hz}
        return Refusal("out_of_limits", text, data)

    # Replay

    def play(
        self,
        request: ReplayRequest,
        owner: Owner,
        terms: Terms,
        gains: Gains,
        *,
        detached: bool,
        turn: Turn,
    ) -> Job | Refusal:
        """Begin to load and replay a trajectory."""
        controller, config = self._controller, terms.config
        geometry = self.refusal(turn) or controller.why_busy(turn) or controller.travel(terms)
        if isinstance(geometry, Refusal):
            return geometry
        if request.force == "replay":
            speed, field = config.grasp_speed_mm_s, "grasp_speed_mm_s"
            motor_type = controller.gripper_id.motor_type
            refusal = conflict_refusal(
                fast_conflict(speed, geometry, motor_type, field)
                or slow_conflict(config, speed, geometry, field)
            )
            if refusal is not None:
                return refusal
        action = Replay(
            request,
            geometry=geometry,
            config=config,
            gains=gains,
            period_s=controller.period_s,
            motor_type=controller.gripper_id.motor_type,
            idle=lambda: controller.idle,
        )
        self.replay_job = controller.begin("play", action, owner, detached, turn, terms=terms)
        self.replay = action
        return self.replay_job

    def playing(self, job: int | None, owner: Owner) -> Replay | Refusal:
        """Return the running replay if it is this job, and the owner's or detached."""
        running, action = self._controller.jobs.running, self._controller.action
        if running is None or not isinstance(action, Replay):
            return Refusal("unknown_job", "no replay is running")
        if job is not None and running.number != job:
            text = f"job {job} is not the replay that runs: that is job {running.number}"
            return Refusal("unknown_job", text, {"requested": job})
        if not running.detached and running.owner.client != owner.client:
            return busy_with(running)
        return action


def _unusable(capture: Capture, *, allow_empty: bool, allow_partial: bool) -> Refusal | None:
    """Return why a recording cannot be used, or None."""
    data: dict[str, Any] = {"samples": capture.samples, "error": capture.error}
    if capture.job is not None and capture.job.error is not None:
        data["cause"] = capture.job.error.reason
    if capture.error is not None and not allow_partial:
        text = sentence(
            "the recording was broken off after {samples} samples: {error}",
            samples=capture.samples,
            error=capture.error,
        )
        if capture.samples:
            remedy = sentence("{trajectory.record_stop with allow_partial}")
            text = joined("", (text, "; ", remedy, " takes what there is"))
            data["hint"] = remedy
        return Refusal("recording_failed", text, data)
    if capture.samples == 0 and not allow_empty:
        return Refusal("recording_failed", "the recording has no samples", data)
    return None
