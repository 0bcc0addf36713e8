"""Teleoperation by the clients: what they send, return and refuse."""

from typing import Any

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    LiteGrip,
    MotionConfig,
    TeleopBusyError,
    TeleopNotReady,
    aio,
)
from tests.client.aio_helpers import run
from tests.client.fake_daemon import FakeDaemon, Request

STATUS = {"active": True, "mode": "slave", "frames": 7}
GUARDS = ("sent_s", "stop_generation")


@pytest.fixture
def asked(daemon: FakeDaemon) -> list[tuple[str, dict[str, Any]]]:
    """Answer as a daemon does, and give what was asked for, without the guards."""
    asked: list[tuple[str, dict[str, Any]]] = []

    def handler(method: str) -> Any:
        def answer(request: Request) -> dict[str, Any]:
            params = {key: val for key, val in request.params.items() if key not in GUARDS}
            asked.append((method, params))
            return STATUS

        return answer

    for method in ("teleop.start", "teleop.stop", "teleop.status"):
        daemon.handlers[method] = handler(method)
    return asked


def test_only_what_was_given_is_sent(
    gripper: LiteGrip, asked: list[tuple[str, dict[str, Any]]]
) -> None:
    assert gripper.teleop_start("master") == STATUS
    assert gripper.teleop_start("slave", "10.0.0.2") == STATUS
    everything: dict[str, Any] = {
        "port": 5000,
        "grip_id": "gripB",
        "link": "udp",
        "rate_hz": 50.0,
        "watchdog_s": 0.1,
        "torque_limit_nm": 1.0,
        "force_limit_n": 9.0,
        "kp": 80.0,
        "kd": 1.5,
        "dq_max": 0.0,
        "reflect": True,
        "reflect_n": 4.0,
        "reflect_gain": 0.25,
        "fake_leader": True,
        "align": False,
        "align_speed_mm_s": 20.0,
        "lead_cap_mm": 0.0,
        "require_ready": False,
        "ready_timeout_s": 0.0,
        "ready_tolerance_mm": 1.0,
        "ready_period_s": 0.05,
    }
    gripper.teleop_start("slave", "0.0.0.0", only_from="h", **everything)
    gripper.teleop_start("master", "h", link="udp", align=True, require_ready=True)
    assert [params for _, params in asked] == [
        {"mode": "master"},
        {"mode": "slave", "host": "10.0.0.2"},
        {"mode": "slave", "bind": "0.0.0.0", "host": "h", **everything},
        {"mode": "master", "host": "h", "link": "udp"},
    ]


def test_stop_and_status_return_the_status(
    gripper: LiteGrip, asked: list[tuple[str, dict[str, Any]]]
) -> None:
    assert gripper.teleop_stop() == STATUS
    assert gripper.teleop_status() == STATUS
    assert asked == [("teleop.stop", {}), ("teleop.status", {})]


def test_an_older_daemons_status_has_numbers_and_texts_as_scripts_print_them(
    gripper: LiteGrip, daemon: FakeDaemon
) -> None:
    names = ("openness", "position_mm", "force_n", "torque_nm")
    older = {**STATUS, "fault": None, "job": None, **dict.fromkeys(names)}
    daemon.handlers["teleop.status"] = lambda _request: older
    assert gripper.teleop_status() == {**older, "fault": "", **dict.fromkeys(names, 0.0)}


def test_tunables_that_were_set_travel_with_it(
    daemon: FakeDaemon, asked: list[tuple[str, dict[str, Any]]]
) -> None:
    config = MotionConfig(speed_mm_s=80)
    with LiteGrip(socket_path=daemon.path, motion_config=config) as gripper:
        gripper.teleop_start("slave", host="h")
    assert asked[-1][1]["config"] == {"speed_mm_s": 80}


def test_a_transport_of_the_callers_is_refused_with_the_reason(
    gripper: LiteGrip, asked: list[tuple[str, dict[str, Any]]]
) -> None:
    with pytest.raises(CommandError, match="the link is the daemon's") as caught:
        gripper.teleop_start("slave", transport=object())
    assert caught.value.reason == "unsupported"
    assert 'link="udp"' in (caught.value.hint or "")
    assert asked == []


@pytest.mark.parametrize("wrong", [{"port": "17448"}, {"kp": float("nan")}, {"rate_hz": "fast"}])
def test_values_that_cannot_be_sent_are_refused_here(
    gripper: LiteGrip, asked: list[tuple[str, dict[str, Any]]], wrong: dict[str, Any]
) -> None:
    with pytest.raises(CommandError):
        gripper.teleop_start("slave", **wrong)
    assert asked == []


def test_its_refusals_are_exceptions_with_the_sdks_names(
    gripper: LiteGrip, daemon: FakeDaemon
) -> None:
    daemon.handlers["teleop.start"] = lambda request: request.fail("teleop_busy", -32050, "runs")
    with pytest.raises(TeleopBusyError) as busy:
        gripper.teleop_start("master")
    assert isinstance(busy.value, BusyError)
    daemon.handlers["teleop.start"] = lambda request: request.fail(
        "teleop_not_ready", -32051, "not calibrated"
    )
    with pytest.raises(TeleopNotReady) as unready:
        gripper.teleop_start("master")
    assert isinstance(unready.value, CommandError)


def test_the_same_on_asyncio(daemon: FakeDaemon, asked: list[tuple[str, dict[str, Any]]]) -> None:
    async def script() -> None:
        async with aio.LiteGrip(socket_path=daemon.path) as gripper:
            assert await gripper.teleop_start("slave", host="h") == STATUS
            assert await gripper.teleop_status() == STATUS
            assert await gripper.teleop_stop() == STATUS
            with pytest.raises(CommandError):
                await gripper.teleop_start("master", transport=1)

    run(script())
    methods = [method for method, _ in asked]
    assert methods == ["teleop.start", "teleop.status", "teleop.stop"]
