"""The methods of leader/follower teleoperation: parameters in, the status out."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from litegripd.control.engine import Engine
from litegripd.control.teleop.link import Links
from litegripd.control.teleop.teleoperation import Teleoperation
from litegripd.model.errors import Refusal
from litegripd.model.teleop import (
    DEFAULT_DQ_MAX_RAD_S,
    DEFAULT_REFLECT_GAIN,
    DEFAULT_WATCHDOG_S,
    TeleopSettings,
)
from litegripd.rpc.calls import Answer, Call, Function
from litegripd.rpc.reports import Reporter
from litegripd.rpc.teleop_wish import wish_of


class Teleoperating:
    """Functions on the engine's teleoperation."""

    def __init__(self, engine: Engine, links: Links, reporter: Reporter, epoch: str) -> None:
        """Take what others make; `epoch`, 16 hexadecimal digits, is the daemon's alone."""
        self._engine = engine
        self._reporter = reporter
        self._teleoperation = Teleoperation(engine, links, int(epoch, 16))

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {
            "teleop.start": self._start,
            "teleop.stop": self._stop,
            "teleop.status": self._status,
        }

    def _start(self, call: Call) -> Answer:
        engine, params = self._engine, call.params
        config = call.config(engine.config, engine.period_s)
        if isinstance(config, Refusal):
            return config
        wish = wish_of(params)
        if isinstance(wish, Refusal):
            return wish
        job = self._teleoperation.start(
            wish,
            _settings(params),
            call.owner,
            config,
            fake_leader=params.get("fake_leader", False),
            detached=call.detached,
        )
        self._reporter.refresh()
        return job if isinstance(job, Refusal) else self._status(call)

    def _stop(self, call: Call) -> Answer:
        self._teleoperation.stop()
        self._reporter.refresh()
        return self._status(call)

    def _status(self, call: Call) -> dict[str, Any]:
        return asdict(self._teleoperation.status(call.now_s))


def _settings(params: Mapping[str, Any]) -> TeleopSettings:
    return TeleopSettings(
        rate_hz=params.get("rate_hz"),
        watchdog_s=params.get("watchdog_s", DEFAULT_WATCHDOG_S),
        torque_limit_nm=params.get("torque_limit_nm", 0.0),
        force_limit_n=params.get("force_limit_n"),
        kp_nm_rad=params.get("kp"),
        kd_nm_s_rad=params.get("kd"),
        dq_max_rad_s=params.get("dq_max", DEFAULT_DQ_MAX_RAD_S),
        reflect_n=params.get("reflect_n", 0.0),
        reflect_gain=params.get("reflect_gain", DEFAULT_REFLECT_GAIN),
    )
