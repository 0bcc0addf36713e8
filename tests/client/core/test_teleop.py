"""Teleoperation by both clients: what they send, return and refuse."""

from typing import Any

import pytest

from litegrip_client import BusyError, CommandError, LiteGrip, TeleopBusyError, TeleopNotReady
from tests.client.rig import Heard, Refuse

STATUS = {"active": True, "mode": "slave", "frames": 7}
EVERYTHING: dict[str, Any] = {
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


@pytest.fixture(autouse=True)
def _answers(daemon: Heard) -> None:
    """No link is opened here."""
    for method in ("teleop.start", "teleop.stop", "teleop.status"):
        daemon.instead[method] = STATUS


def test_only_what_was_given_is_sent(daemon: Heard, gripper: LiteGrip) -> None:
    assert gripper.teleop_start("master") == STATUS
    assert gripper.teleop_start("slave", "10.0.0.2") == STATUS
    gripper.teleop_start("slave", "0.0.0.0", only_from="h", **EVERYTHING)
    gripper.motion_config.force_n = 5.0
    gripper.teleop_start("master", "h", link="udp", align=True, require_ready=True)
    assert daemon.asked("teleop.start") == [
        {"mode": "master"},
        {"mode": "slave", "host": "10.0.0.2"},
        {"mode": "slave", "bind": "0.0.0.0", "host": "h", **EVERYTHING},
        {"mode": "master", "host": "h", "link": "udp", "config": {"force_n": 5.0}},
    ]


def test_stop_and_status_return_the_status(daemon: Heard, gripper: LiteGrip) -> None:
    assert gripper.teleop_stop() == gripper.teleop_status() == STATUS
    assert daemon.methods()[-2:] == ["teleop.stop", "teleop.status"]


def test_an_older_daemons_status_has_numbers_and_texts_as_scripts_print_them(
    daemon: Heard, gripper: LiteGrip
) -> None:
    figures = ("openness", "position_mm", "force_n", "torque_nm")
    older = {**STATUS, "fault": None, "job": None, **dict.fromkeys(figures)}
    for method in ("teleop.start", "teleop.stop", "teleop.status"):
        daemon.instead[method] = older
    told = {**older, "fault": "", **dict.fromkeys(figures, 0.0)}
    assert gripper.teleop_start("master") == gripper.teleop_status() == told
    assert gripper.teleop_stop() == told


def test_the_real_status_has_no_gaps_either(daemon: Heard, gripper: LiteGrip) -> None:
    daemon.instead.clear()
    assert gripper.enable()
    status = gripper.teleop_start("slave", fake_leader=True, align=False, align_speed_mm_s=40.0)
    assert (status["active"], status["fault"]) == (True, "")
    figures = ("openness", "position_mm", "force_n", "torque_nm")
    assert all(isinstance(status[name], float) for name in figures)
    assert gripper.teleop_stop()["fault"] == ""


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"transport": object()}, "the link is the daemon's"),
        ({"only_from": "h"}, 'only_from is for a slave with link="udp"'),
        ({"port": "17448"}, "port is '17448'"),
        ({"kp": float("nan")}, "kp is nan"),
        ({"rate_hz": "fast"}, "rate_hz is 'fast'"),
    ],
)
def test_what_cannot_be_sent_is_refused_here(
    daemon: Heard, gripper: LiteGrip, wrong: dict[str, Any], told: str
) -> None:
    with pytest.raises(CommandError, match=told) as caught:
        gripper.teleop_start("slave", **wrong)
    assert caught.value.data["parameter"] == next(iter(wrong))
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize(
    ("reason", "kinds"),
    [
        ("teleop_busy", (TeleopBusyError, BusyError)),
        ("teleop_not_ready", (TeleopNotReady, CommandError)),
    ],
)
def test_its_refusals_are_exceptions_with_the_sdks_names(
    daemon: Heard, gripper: LiteGrip, reason: str, kinds: tuple[type[Exception], ...]
) -> None:
    daemon.instead["teleop.start"] = Refuse(reason, -32050)
    for kind in kinds:
        with pytest.raises(kind):
            gripper.teleop_start("master")
