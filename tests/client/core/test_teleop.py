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
}
OWN = {"speed_mm_s": 20.0, "max_lead_mm": 2.0}


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
    gripper.teleop_start("master", "h", link="udp", align_speed_mm_s=20, lead_cap_mm=2)
    assert daemon.asked("teleop.start") == [
        {"mode": "master"},
        {"mode": "slave", "host": "10.0.0.2"},
        {"mode": "slave", "bind": "0.0.0.0", "host": "h", **EVERYTHING},
        {"mode": "master", "host": "h", "link": "udp", "config": {"force_n": 5.0, **OWN}},
    ]


def test_stop_and_status_return_the_status(daemon: Heard, gripper: LiteGrip) -> None:
    assert gripper.teleop_stop() == gripper.teleop_status() == STATUS
    assert daemon.methods()[-2:] == ["teleop.stop", "teleop.status"]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"transport": object()}, "the link is the daemon's"),
        ({"align": False}, "would jump to where its leader is"),
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
