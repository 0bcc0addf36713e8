"""The methods of leader/follower teleoperation: parameters in, the status out."""

import re
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from litegripd.control.engine import Engine
from litegripd.control.teleop.link import Links
from litegripd.control.teleop.teleoperation import Teleoperation
from litegripd.model.errors import Refusal
from litegripd.model.teleop import (
    DEFAULT_DQ_MAX_RAD_S,
    DEFAULT_GRIP_ID,
    DEFAULT_PORT,
    DEFAULT_WATCHDOG_S,
    LinkWish,
    TeleopSettings,
)
from litegripd.rpc.calls import Answer, Call, Function
from litegripd.rpc.reporter import Reporter

_GRIP_ID = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_HOST = re.compile(r"[A-Za-z0-9_.:%-]{1,253}")
"""Nothing that would mean more than a name in a key or an endpoint: no "/", "#", "?" and "*"."""


class Teleoperating:
    """Functions on the engine's teleoperation."""

    def __init__(self, engine: Engine, links: Links, reporter: Reporter) -> None:
        self._engine = engine
        self._reporter = reporter
        self._teleoperation = Teleoperation(engine, links)

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
        fake = params.get("fake_leader", False)
        wish = _wish(params, fake=fake)
        if isinstance(wish, Refusal):
            return wish
        job = self._teleoperation.start(
            wish, _settings(params), call.owner, config, fake_leader=fake, detached=call.detached
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
    )


def _wish(params: Mapping[str, Any], *, fake: bool) -> LinkWish | Refusal:
    """Find which link is wanted, or which parameters do not go together."""
    mode, kind, host = params["mode"], params.get("link", "zenoh"), params.get("host")
    grip_id = params.get("grip_id", DEFAULT_GRIP_ID)
    if not _GRIP_ID.fullmatch(grip_id):
        return _wrong("grip_id", f"is {grip_id!r}; it has letters, digits, _ . - (1 to 64)")
    if host is not None and not _HOST.fullmatch(host):
        return _wrong("host", f"is {host!r}; it must be a host's name or address, without a port")
    if mode == "master" and fake:
        return _wrong("fake_leader", "is for a slave: a master is a leader itself")
    if fake or kind == "none":
        if mode == "slave" and not fake:
            return _wrong("link", "none brings a slave no frames; for a try: fake_leader")
        return LinkWish(mode, "none", None, grip_id=grip_id)
    if kind == "zenoh" and mode == "slave" and host is None:
        return _wrong("host", "is missing: a slave connects to its leader and to nobody else")
    if kind == "zenoh" and mode == "master" and host is not None:
        return _wrong("host", "is for a slave: a master listens, on all its addresses")
    if kind == "udp" and mode == "master" and host is None:
        return _wrong("host", "is missing: a master sends its datagrams to its follower")
    return LinkWish(mode, kind, host, params.get("port", DEFAULT_PORT), grip_id)


def _wrong(parameter: str, problem: str) -> Refusal:
    text = f"teleop.start: {parameter} {problem}"
    return Refusal("invalid_params", text, {"parameter": parameter})
