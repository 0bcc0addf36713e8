"""What is read of iproute2's answers and of the kernel's files."""

import json

import pytest

from litegrip_client.socketcan.link import HARMFUL, HINDERING, Link, from_files, from_ip
from tests.client.doctor.known import LINKS, link

NOTHING = dict.fromkeys(
    ("restarts", "bus_error", "arbitration_lost", "error_warning", "error_passive", "bus_off"), 0
)


def test_a_healthy_adapter() -> None:
    assert link("healthy") == Link(
        name="can0",
        is_can=True,
        is_up=True,
        kind="can",
        queue_frames=10,
        bitrate=1_000_000,
        sample_point=0.75,
        restart_ms=100,
        state="ERROR-ACTIVE",
        tx_errors=0,
        rx_errors=0,
        history=NOTHING,
        index=2,
    )


@pytest.mark.parametrize("mode", [*HINDERING, *HARMFUL])
def test_each_mode_that_is_on_is_read_and_none_that_is_only_supported(mode: str) -> None:
    told = json.loads((LINKS / "healthy.json").read_text(encoding="utf-8"))
    assert from_ip(json.dumps(told)).modes == ()
    told[0]["linkinfo"]["info_data"]["ctrlmode"] = ["BERR-REPORTING", mode]
    found = from_ip(json.dumps(told))
    assert (found.modes, [*found.bad_modes]) == (("BERR-REPORTING", mode), [mode])


def test_an_interface_of_the_size_of_fd_frames_is_in_fd_mode() -> None:
    told = json.loads((LINKS / "healthy.json").read_text(encoding="utf-8"))
    told[0]["mtu"] = 72
    assert from_ip(json.dumps(told)).modes == ("FD",)
    assert link("vcan").modes == ()  # has that size too, and no controller


def test_a_bit_rate_of_nothing_is_none() -> None:
    told = json.loads((LINKS / "healthy.json").read_text(encoding="utf-8"))
    told[0]["linkinfo"]["info_data"]["bittiming"]["bitrate"] = 0
    assert from_ip(json.dumps(told)).bitrate is None


def test_a_virtual_bus_has_no_controller() -> None:
    assert link("vcan") == Link("vcan0", True, True, "vcan", 1000, index=4)
    assert link("vcan_down") == Link("vcan0", True, False, "vcan", 1000, index=4)


def test_an_adapter_that_was_never_set_up_has_no_bit_rate() -> None:
    found = link("unset")
    assert (found.is_up, found.bitrate, found.restart_ms) == (False, None, 0)
    assert found.state == "STOPPED"


def test_another_kind_of_interface_is_not_for_can() -> None:
    assert not link("dummy").is_can


@pytest.mark.parametrize("name", sorted(path.stem for path in LINKS.glob("*.json")))
def test_every_answer_can_be_read(name: str) -> None:
    assert link(name).name in ("can0", "can1", "can8", "vcan0")


@pytest.mark.parametrize("text", ["", "ip: unknown option", "[]", "{}", "[1]", "[{},{}]"])
def test_what_is_no_answer_of_iproute2(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        from_ip(text)


def test_what_iproute2_leaves_out_is_not_known() -> None:
    assert from_ip('[{"ifname":"can0","link_type":"can"}]') == Link("can0", True, False)


def test_the_kernels_files() -> None:
    files = {"type": "280", "flags": "0x40081", "tx_queue_len": "10"}
    assert from_files("can0", files) == Link("can0", True, True, queue_frames=10)
    files = {"type": "1", "flags": "0x80", "tx_queue_len": "1000"}
    assert from_files("eth0", files) == Link("eth0", False, False, queue_frames=1000)
