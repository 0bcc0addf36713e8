"""The methods on trajectories: recording, replay, and what is kept of them."""

from collections.abc import Mapping
from typing import Any

from litegripd.control.actions.replay import ReplayRequest
from litegripd.control.capture import Capture
from litegripd.control.engine import Engine
from litegripd.control.trajectories import Trajectories
from litegripd.model.errors import Refusal
from litegripd.model.results import ReplayResult
from litegripd.model.trajectory import MAX_SAMPLES
from litegripd.rpc.answers import CaptureStatus, NoTrajectory, ReplayStatus
from litegripd.rpc.calls import Answer, Call, Deferred, Function, later
from litegripd.rpc.session import Session
from litegripd.rpc.trajectory_contents import TrajectoryContents, name_refusal
from litegripd.rpc.trajectory_table import DEFAULT_RATE_HZ, DEFAULT_TORQUE_NM


class TrajectoryMethods:
    """Functions on recordings, replays and the trajectories that are kept."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._trajectories = Trajectories(engine)
        self._contents = TrajectoryContents(engine)

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {
            "trajectory.record_start": self._record,
            "trajectory.record_stop": self._stop_recording,
            "trajectory.play": self._play,
            "trajectory.control": self._control,
            "trajectory.status": lambda _call: self._status(),
            **self._contents.functions(),
        }

    def session_ended(self, session: Session) -> None:
        """End what a connection leaves: its uploads, and a recording that it only watched."""
        self._trajectories.client_lost(session.identity)
        self._contents.session_ended(session)

    def _record(self, call: Call) -> Answer:
        params, slack = call.params, call.params.get("zero_gravity", True)
        refusal = self._engine.lease.refusal(call.owner) if slack else None
        started = refusal or self._trajectories.record(
            call.owner,
            rate_hz=params.get("rate_hz", DEFAULT_RATE_HZ),
            slack=slack,
            max_samples=params.get("max_samples", MAX_SAMPLES),
            detached=call.detached,
        )
        return started if isinstance(started, Refusal) else self._status()

    def _stop_recording(self, call: Call) -> Answer:
        name, capture = call.params.get("name"), self._trajectories.capture
        deferred = Deferred()

        def kept(answer: Mapping[str, Any] | Refusal) -> None:
            missed = 0 if capture is None else capture.missed
            partial = None if capture is None else capture.error
            left_out = 0 if capture is None else capture.notes.left_out
            own = {"missed": missed, "error": partial, "grips_left_out": left_out}
            deferred.resolve(answer if isinstance(answer, Refusal) else {**answer, **own})

        refusal = name_refusal(name) or self._trajectories.stop_recording(
            name,
            call.owner.uid,
            kept,
            allow_empty=call.params.get("allow_empty", False),
            allow_partial=call.params.get("allow_partial", False),
        )
        return refusal or deferred

    def _play(self, call: Call) -> Answer:
        params = call.params
        config = call.config(self._engine.config, self._engine.period_s)
        if isinstance(config, Refusal):
            return config
        source = self._contents.source("trajectory.play", call)
        if isinstance(source, Refusal):
            return source
        if "repeat" in params and params.get("loop"):
            text = "trajectory.play takes loop or repeat, not both"
            return Refusal("invalid_params", text, {"parameter": "repeat"})
        request = ReplayRequest(
            source=source,
            speed=params.get("speed", 1.0),
            torque_nm=params.get("torque_nm", DEFAULT_TORQUE_NM),
            repeat=0 if params.get("loop") else params.get("repeat", 1),
            align=params.get("align", True),
            force=params.get("force", "path"),
        )
        return later(
            self._trajectories.play(
                request,
                call.owner,
                config,
                kp_nm_rad=params.get("kp"),
                kd_nm_s_rad=params.get("kd"),
                detached=call.detached,
            )
        )

    def _control(self, call: Call) -> Answer:
        params, action = call.params, call.params["action"]
        replay = self._trajectories.playing(params.get("job"), call.owner)
        if isinstance(replay, Refusal):
            return replay
        if ("speed" in params) != (action == "speed"):
            text = "trajectory.control: speed goes with the action speed, and only with it"
            return Refusal("invalid_params", text, {"parameter": "speed"})
        if action == "speed":
            refusal = replay.change_speed(params["speed"])
            if refusal is not None:
                return refusal
        else:
            replay.is_paused = action == "pause"
        return self._status()

    def _status(self) -> NoTrajectory | CaptureStatus | ReplayStatus:
        """Tell of what runs, else of what came last."""
        trajectories = self._trajectories
        capture, job = trajectories.capture, trajectories.replay_job
        if capture is not None and (job is None or capture.began_s >= job.started_s):
            return _capture_status(capture)
        return self._replay_status()

    def _replay_status(self) -> NoTrajectory | ReplayStatus:
        replay, job = self._trajectories.replay, self._trajectories.replay_job
        if replay is None or job is None:
            return {"active": False, "kind": None, "job": None, "samples": 0, "error": None}
        result = job.result
        completed = isinstance(result, ReplayResult) and result.ok
        return {
            "active": job.is_running,
            "kind": "play",
            "job": job.number,
            "samples": replay.samples,
            "error": None if job.error is None else job.error.message,
            "frames": replay.frames,
            "speed": replay.speed,
            "openness": replay.openness,
            "completed": completed,
            "loops": replay.loops,
            "grips": replay.grips.done,
            "phase": "paused" if replay.is_paused else replay.phase,
        }


def _capture_status(capture: Capture) -> CaptureStatus:
    return {
        "active": not capture.is_over,
        "kind": "record",
        "job": None if capture.job is None else capture.job.number,
        "samples": capture.samples,
        "error": capture.error,
        "rate_hz": capture.rate_hz,
        "zero_gravity": capture.job is not None,
        "loop_hz": capture.loop_hz,
        "missed": capture.missed,
        "duration_s": capture.duration_s,
        "max_samples": capture.max_samples,
    }
