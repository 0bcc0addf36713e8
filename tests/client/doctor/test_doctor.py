"""litegripctl doctor as a command: with a daemon, without one, with a strange one."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

import litegrip_client
from litegrip_client.ctl.doctor import gather
from litegrip_client.ctl.doctor.facts import Configuration, System, User
from litegrip_client.ctl.doctor.link_checks import _IF_LOST
from litegrip_client.ctl.findings import as_text, error, ok, warning
from litegrip_client.ctl.main import main
from litegripd.model.sentence import sentence, with_terms
from tests.client.doctor.known import HEALTH, HELLO, INFO, STATE, changed, link
from tests.client.fake_daemon import FakeDaemon, Handler
from tests.client.helpers import Ctl

ADAPTER = System(link("healthy"), None, ("can0",), "peak_usb")


@pytest.fixture(autouse=True)
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return what the system is asked, on a machine that is as it should be."""
    asked: dict[str, Any] = {"system": ADAPTER}

    def system(interface: str, bus_channel: str, held_index: int | None = None) -> System:
        asked["bus"] = (interface, bus_channel)
        found = asked["system"]
        assert isinstance(found, System)
        return found

    monkeypatch.setattr(gather, "DIRECTORY", tmp_path / "etc")
    monkeypatch.setattr(gather, "system", system)
    monkeypatch.setattr(gather, "is_unit_installed", lambda: True)
    monkeypatch.setattr(gather, "is_can", lambda name: name in asked.get("links", ()))
    monkeypatch.setattr(gather, "user", lambda group: User("alice", 1000, group))
    return asked


@pytest.fixture
def well(daemon: FakeDaemon) -> FakeDaemon:
    """Return a daemon with which all is well."""
    hello = {**HELLO, "protocol": 1, "version": litegrip_client.__version__}
    answers = {"hello": hello, "info.get": INFO, "health": HEALTH, "state.get": STATE}
    for method, answer in answers.items():
        daemon.handlers[method] = answering(answer)
    return daemon


def answering(answer: dict[str, Any]) -> Handler:
    return lambda request: answer


def levels(out: str) -> dict[str, str]:
    return {row["check"]: row["level"] for row in json.loads(out)["findings"]}


def test_all_is_well(well: FakeDaemon, ctl: Ctl, machine: dict[str, Any]) -> None:
    code, out, err = ctl("doctor")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "OK       link          can0 is up"
    assert lines[-1] == "no errors, no warnings"
    assert {line.split()[0] for line in lines[:-2]} == {"OK"}
    assert machine["bus"] == ("socketcan", "can0")
    assert well.methods() == ["hello", "info.get", "health", "state.get"]


def test_what_is_not_well_is_told_and_ends_with_1(well: FakeDaemon, ctl: Ctl) -> None:
    silent = {**STATE, "motor": "silent", "stale": True}
    well.handlers["state.get"] = lambda request: silent
    well.handlers["info.get"] = lambda request: changed(INFO, "calibration.file", None)
    code, out, _ = ctl("doctor")
    assert code == 1
    assert "ERROR    motor         silent, last feedback 0.004 s ago\n         (switch" in out
    assert "lost at a restart\n         litegripctl -c can0 calibration save\n" in out
    assert out.endswith("\n1 error, 1 warning\n")


def test_a_check_that_cannot_read_an_answer_hides_no_other(well: FakeDaemon, ctl: Ctl) -> None:
    well.handlers["state.get"] = lambda request: {**STATE, "age_s": "soon"}
    code, out, err = ctl("doctor")
    assert (code, err) == (1, "")
    assert "ERROR    motor         this check failed: ValueError: " in out
    assert "\nOK       health " in out
    assert out.endswith("\n1 error, no warnings\n")


def test_a_scan_is_asked_for_and_never_by_itself(well: FakeDaemon, ctl: Ctl) -> None:
    found = {"asked": list(range(1, 17)), "found": [{"can_id": 9, "master_id": 25}]}
    well.handlers["motor.scan"] = lambda request: found
    assert "scan" not in levels(ctl("doctor", "--json")[1])
    assert "motor.scan" not in well.methods()
    code, out, _ = ctl("doctor", "--scan")
    assert code == 1
    assert "nothing answers at 0x08, but motors do at: 0x09 (answers on 0x19)\n" in out
    assert "(first set [motor] can_id = 0x09 in /etc/litegripd/can0.toml)" in out
    well.handlers["motor.scan"] = lambda request: request.fail("busy", -32020, "it is enabled")
    assert "no id was asked: it is enabled\n" in ctl("doctor", "--scan")[1]


def test_without_a_daemon_no_id_is_asked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["-c", "nodaemon7", "doctor", "--scan"]) == 1
    assert "no id was asked: no daemon answers" in capsys.readouterr().out


def test_warnings_alone_end_with_0(well: FakeDaemon, ctl: Ctl, machine: dict[str, Any]) -> None:
    machine["system"] = System(link("long_queue"), None, ("can0",), "peak_usb")
    code, out, _ = ctl("doctor")
    assert (code, out.splitlines()[-1]) == (0, "no errors, 1 warning")


def test_as_json(well: FakeDaemon, ctl: Ctl, machine: dict[str, Any]) -> None:
    machine["system"] = System(link("wrong_bitrate"), None, ("can0",), "gs_usb")
    code, out, _ = ctl("doctor", "--json")
    data = json.loads(out)
    assert (code, data["ok"], data["channel"]) == (1, False, "can0")
    row = next(row for row in data["findings"] if row["check"] == "bit-rate")
    assert row == {
        "check": "bit-rate",
        "level": "error",
        "text": "0.5 Mbit/s, but the motor speaks at 1 Mbit/s",
        "command": "sudo ip link set can0 down"
        " && sudo ip link set can0 up type can bitrate 1000000",
        "advice": _IF_LOST,
    }


def test_without_a_daemon(capsys: pytest.CaptureFixture[str], machine: dict[str, Any]) -> None:
    assert main(["-c", "nodaemon7", "doctor"]) == 1
    captured = capsys.readouterr()
    assert captured.err == ""
    assert "ERROR    daemon        no daemon can be reached for channel nodaemon7" in captured.out
    assert "\n         sudo systemctl start litegripd@nodaemon7\n" in captured.out
    assert machine["bus"] == ("socketcan", "nodaemon7")
    assert main(["-c", "nodaemon7", "doctor", "--json"]) == 1
    found = levels(capsys.readouterr().out)
    assert (found["link"], found["daemon"], found["bit-rate"]) == ("ok", "error", "ok")
    assert "motor" not in found


def test_a_socket_without_a_daemon_is_of_no_known_channel(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    machine: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = str(tmp_path / "x.sock")
    assert main(["--socket", path, "doctor", "--json"]) == 1
    by_option = json.loads(capsys.readouterr().out)
    monkeypatch.setenv("LITEGRIPD_SOCKET", path)
    assert main(["doctor", "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == by_option
    assert by_option["channel"] is None
    assert {"link", "device", "bit-rate"}.isdisjoint(row["check"] for row in by_option["findings"])
    assert "can0" not in json.dumps(by_option)
    assert "bus" not in machine
    assert main(["-c", "can3", "doctor"]) == 1
    assert "sudo systemctl start litegripd@can3" in capsys.readouterr().out


def test_on_a_robot_with_stable_names_those_are_named_and_not_can0(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    machine: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("LITEGRIPD_SOCKET", raising=False)
    monkeypatch.delenv("LITEGRIP_CHANNEL", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path / "run"))
    monkeypatch.setattr("litegrip_client.core.discovery.ENABLED_DIRECTORY", str(tmp_path / "wants"))
    for path in ("run/left.sock", "run/left.stop.sock", "wants/litegripd@right.service"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).touch()
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "there are: left, right\n         litegripctl -c left doctor\n" in out
    assert "litegripd@can0" not in out
    assert "bus" not in machine
    assert main(["-c", "can0", "doctor"]) == 1  # who names it means it
    assert "litegripd@can0" in capsys.readouterr().out
    machine["links"] = ["can0"]
    assert main(["doctor"]) == 1
    assert "litegripd@can0" in capsys.readouterr().out


def test_a_daemon_that_hangs_is_to_be_restarted(
    well: FakeDaemon,
    ctl: Ctl,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(gather, "ANSWER_WITHIN_S", 0.05)
    del well.handlers["hello"]
    code, out, _ = ctl("doctor")
    assert code == 1
    assert f"ERROR    daemon        pid {os.getpid()} listens, but the daemon did not answer" in out
    assert "systemctl start" not in out
    assert "systemctl restart" not in out  # of which channel it is, is not known
    monkeypatch.setenv("LITEGRIPD_SOCKET", well.path)
    assert main(["-c", "can3", "doctor"]) == 1
    assert "\n         sudo systemctl restart litegripd@can3\n" in capsys.readouterr().out


def test_a_configuration_tells_the_bus_of_a_daemon_that_does_not_run(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    machine: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bus = {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": 1_000_000}
    told = Configuration("/x.toml", content={"bus": bus, "rpc": {"group": "robots"}})
    monkeypatch.setattr(gather, "configuration_file", lambda channel: told)
    machine["system"] = System()
    assert main(["-c", "nodaemon7", "doctor", "--json"]) == 1
    found = levels(capsys.readouterr().out)
    assert machine["bus"] == ("slcan", "/dev/ttyACM0")
    assert (found["configuration"], found["device"], "link" in found) == ("ok", "ok", False)
    told = Configuration("/x.toml", error="/x.toml: [bus] bitrate is 3")
    machine.pop("bus")
    assert main(["-c", "nodaemon7", "doctor", "--json"]) == 1
    found = levels(capsys.readouterr().out)
    assert (found["configuration"], "link" in found, "bus" in machine) == ("error", False, False)


def test_a_configuration_that_was_not_checked_hides_no_interface_of_the_channels_name(
    capsys: pytest.CaptureFixture[str], machine: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    told = Configuration("/x.toml", unchecked="it takes too long")
    monkeypatch.setattr(gather, "configuration_file", lambda channel: told)
    assert main(["-c", "nodaemon7", "doctor", "--json"]) == 1
    assert "link" not in levels(capsys.readouterr().out)
    machine["links"] = ["nodaemon7"]
    assert main(["-c", "nodaemon7", "doctor", "--json"]) == 1
    found = levels(capsys.readouterr().out)
    assert (found["configuration"], found["link"], found["bit-rate"]) == ("warning", "ok", "ok")
    assert machine["bus"] == ("socketcan", "nodaemon7")


def test_before_the_installation_no_unit_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gather, "is_unit_installed", lambda: False)
    assert main(["-c", "nodaemon7", "doctor"]) == 1
    out = capsys.readouterr().out
    assert "systemctl" not in out
    assert "\n         litegripd nodaemon7\n" in out
    assert "litegripctl install-units --can nodaemon7" in out


def test_a_bus_that_the_daemon_names(well: FakeDaemon, ctl: Ctl, machine: dict[str, Any]) -> None:
    bus = {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": 1_000_000}
    well.handlers["info.get"] = lambda request: changed(INFO, "configuration.bus", bus)
    machine["system"] = System()
    assert {"device", "bit-rate"} <= levels(ctl("doctor", "--json")[1]).keys()
    assert machine["bus"] == ("slcan", "/dev/ttyACM0")


def test_the_daemon_of_another_channel(
    well: FakeDaemon, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("LITEGRIPD_SOCKET", well.path)
    assert main(["-c", "can1", "doctor"]) == 1
    assert "has channel can0, not can1\n         unset LITEGRIPD_SOCKET" in capsys.readouterr().out
    assert main(["doctor"]) == 0


def test_a_daemon_of_another_protocol_or_that_refuses(well: FakeDaemon, ctl: Ctl) -> None:
    well.handlers["health"] = lambda request: request.fail("internal_error", -32603, "a defect")
    code, out, _ = ctl("doctor")
    assert (code, "ERROR    daemon        a defect" in out) == (1, True)
    well.handlers["hello"] = lambda request: {**HELLO, "protocol": 2}
    code, out, _ = ctl("doctor")
    assert (code, "the daemon speaks protocol 2, this client 1" in out) == (1, True)


def test_an_older_daemon_that_tells_less(well: FakeDaemon, ctl: Ctl) -> None:
    for method in ("info.get", "health", "state.get"):
        well.handlers[method] = lambda request: {"stop_generation": 1}
    well.handlers["hello"] = lambda request: {"protocol": 1, "channel": "can0", "version": "0.0.1"}
    code, out, err = ctl("doctor", "--json")
    assert (code, err) == (1, "")
    found = levels(out)
    assert (found["daemon"], found["version"], found["motor"]) == ("ok", "warning", "error")
    assert "ranges" not in found


def test_texts_from_elsewhere_do_not_steer_the_terminal() -> None:
    findings = [("a", error("x\x1b[2J\ny", "c\td", "e\r")), ("b", warning("w")), ("c", ok("o"))]
    assert as_text(findings) == (
        "ERROR    a             x?[2J?y\n         c?d\n         (e?)\n"
        "WARNING  b             w\nOK       c             o\n\n1 error, 1 warning"
    )


def test_what_the_daemon_says_is_told_in_commands(well: FakeDaemon, ctl: Ctl) -> None:
    reasons = [sentence("it jumped; then {motor.clear_fault}")]
    verdict = with_terms({**HEALTH, "verdict": "down", "reasons": reasons})
    well.handlers["health"] = lambda request: verdict
    out = ctl("doctor")[1]
    assert "ERROR    health        down: it jumped; then litegripctl clear-fault\n" in out


def test_an_interrupt_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(interface: str, bus_channel: str, held_index: int | None) -> System:
        raise KeyboardInterrupt

    monkeypatch.setattr(gather, "system", interrupted)
    assert main(["-c", "nodaemon7", "doctor"]) == 130
