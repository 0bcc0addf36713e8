"""litegripctl doctor as a command: with a daemon, without one, with a strange one."""

import json
import socket
from pathlib import Path

import pytest

import litegrip_client
from litegrip_client.core.discovery import channels_with_socket
from litegrip_client.core.sockets import SYSTEM_DIRECTORY
from litegrip_client.ctl.doctor import gather
from litegrip_client.ctl.doctor.facts import Configuration, System, User
from litegrip_client.ctl.doctor.link_checks import _IF_LOST
from litegrip_client.ctl.findings import as_text, error, ok, warning
from litegripd.model.sentence import sentence, with_terms
from tests.client.doctor.known import HEALTH, HELLO, INFO, changed, link
from tests.client.rig import SILENT, Ctl, Heard, Line, Refuse

SLCAN = {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": 1_000_000}
NOBODY = ("-c", "nodaemon7")
"""A channel without a daemon."""


class Machine:
    """One that is as it should be but for what a test changes, with a daemon for can0."""

    def __init__(self, daemon: Heard, ctl: Ctl, patch: pytest.MonkeyPatch) -> None:
        self.daemon = daemon
        self.system = System(link("healthy"), None, ("can0",), "peak_usb")
        self.bus: tuple[str, str] | None = None
        """About which bus the system was asked."""
        self.links: list[str] = []
        self._ctl = ctl
        self._patch = patch
        for name, value in (
            ("system", self._system),
            ("is_unit_installed", lambda: True),
            ("channels_with_socket", list),  # not those of the machine that this runs on
            ("is_can", lambda name: name in self.links),
            ("user", lambda group: User("alice", 1000, group)),
            ("shortages", lambda _written: ()),
        ):
            patch.setattr(gather, name, value)
        own = {"protocol": 1, "version": litegrip_client.__version__}
        daemon.instead |= {"hello": {**HELLO, **own}, "info.get": INFO, "health": HEALTH}
        self.says = daemon.instead

    def _system(self, interface: str, bus_channel: str, held_index: int | None = None) -> System:
        self.bus = (interface, bus_channel)
        return self.system

    def configured(self, told: Configuration) -> None:
        """Have the configuration of every channel judged so."""
        self._patch.setattr(gather, "configuration_file", lambda _channel: told)

    def doctor(self, *words: str) -> tuple[int, str]:
        """Return with what the doctor ends, and what it shows."""
        code, out, err = self._ctl("doctor", *words)
        assert err == ""
        return code, out

    def levels(self, *words: str) -> dict[str, str]:
        """Return the level of each check, as the doctor tells a program."""
        code, out = self.doctor("--json", *words)
        data = json.loads(out)
        assert data["ok"] is (code == 0)
        return {row["check"]: row["level"] for row in data["findings"]}


@pytest.fixture
def machine(
    heard: Heard, litegripctl: Ctl, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> Machine:
    return Machine(heard, litegripctl, monkeypatch)


def test_all_is_well(machine: Machine) -> None:
    code, out = machine.doctor()
    assert code == 0
    lines = out.splitlines()
    assert lines[0] == "OK       link          can0 is up"
    assert lines[-1] == "no errors, no warnings"
    assert {line.split()[0] for line in lines[:-2]} == {"OK"}
    assert machine.bus == ("socketcan", "can0")
    assert machine.daemon.methods() == ["hello", "info.get", "health", "state.get"]


def test_what_is_not_well_is_told_and_ends_with_1(machine: Machine) -> None:
    machine.says["state.get"] = {**machine.daemon.wire_state, "motor": "silent", "stale": True}
    machine.says["info.get"] = changed(INFO, "calibration.file", None)
    code, out = machine.doctor()
    assert code == 1
    assert "ERROR    motor         silent, last feedback 0.0" in out
    assert " s ago\n         (switch" in out
    assert "lost at a restart\n         litegripctl -c can0 calibration save\n" in out
    assert out.endswith("\n1 error, 1 warning\n")


def test_a_check_that_cannot_read_an_answer_hides_no_other(machine: Machine) -> None:
    machine.says["state.get"] = {**machine.daemon.wire_state, "age_s": "soon"}
    code, out = machine.doctor()
    assert code == 1
    assert "ERROR    motor         this check failed: ValueError: " in out
    assert "\nOK       health " in out
    assert out.endswith("\n1 error, no warnings\n")


def test_a_scan_is_asked_for_and_never_by_itself(machine: Machine) -> None:
    found = {"asked": list(range(1, 17)), "found": [{"can_id": 9, "master_id": 25}]}
    machine.says["motor.scan"] = found
    assert "scan" not in machine.levels()
    assert "motor.scan" not in machine.daemon.methods()
    code, out = machine.doctor("--scan")
    assert code == 1
    assert "nothing answers at 0x08, but motors do at: 0x09 (answers on 0x19)\n" in out
    assert "(first set [motor] can_id = 0x09 in /etc/litegripd/can0.toml)" in out
    machine.says["motor.scan"] = Refuse("busy", -32020, "it is enabled")
    assert "no id was asked: it is enabled\n" in machine.doctor("--scan")[1]


def test_without_a_daemon_no_id_is_asked(machine: Machine) -> None:
    code, out = machine.doctor(*NOBODY, "--scan")
    assert code == 1
    assert "no id was asked: no daemon answers" in out


def test_warnings_alone_end_with_0(machine: Machine) -> None:
    machine.system = System(link("long_queue"), None, ("can0",), "peak_usb")
    code, out = machine.doctor()
    assert (code, out.splitlines()[-1]) == (0, "no errors, 1 warning")


def test_as_json(machine: Machine) -> None:
    machine.system = System(link("wrong_bitrate"), None, ("can0",), "gs_usb")
    code, out = machine.doctor("--json")
    data = json.loads(out)
    assert (code, data["ok"], data["channel"]) == (1, False, "can0")
    assert {
        "check": "bit-rate",
        "level": "error",
        "text": "0.5 Mbit/s, but the motor speaks at 1 Mbit/s",
        "command": "sudo ip link set can0 down"
        " && sudo ip link set can0 up type can bitrate 1000000",
        "advice": _IF_LOST,
    } in data["findings"]


def test_without_a_daemon(machine: Machine) -> None:
    code, out = machine.doctor(*NOBODY)
    assert code == 1
    assert "ERROR    daemon        no daemon can be reached for channel nodaemon7" in out
    assert "\n         sudo systemctl start litegripd@nodaemon7\n" in out
    assert machine.bus == ("socketcan", "nodaemon7")
    found = machine.levels(*NOBODY)
    assert (found["link"], found["daemon"], found["bit-rate"]) == ("ok", "error", "ok")
    assert "motor" not in found


def test_a_socket_without_a_daemon_is_of_no_known_channel(
    tmp_path: Path, machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(tmp_path / "x.sock")
    code, by_option = machine.doctor("--socket", path, "--json")
    monkeypatch.setenv("LITEGRIPD_SOCKET", path)
    assert machine.doctor("--json") == (code, by_option) == (1, by_option)
    told = json.loads(by_option)
    assert told["channel"] is None
    assert {"link", "device", "bit-rate"}.isdisjoint(row["check"] for row in told["findings"])
    assert "can0" not in by_option
    assert machine.bus is None
    assert "sudo systemctl start litegripd@can3" in machine.doctor("-c", "can3")[1]


def test_a_daemon_that_was_started_by_hand_may_be_of_any_bus(
    tmp_path: Path, machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "litegripd").mkdir()
    with socket.socket(socket.AF_UNIX) as left_behind:
        left_behind.bind(str(tmp_path / "litegripd" / "sim0.sock"))
    found = machine.levels("-c", "sim0")
    assert found["daemon"] == "error"
    assert {"link", "device", "bit-rate"}.isdisjoint(found)
    machine.links = ["sim0"]
    assert "link" in machine.levels("-c", "sim0")


def test_on_a_robot_with_stable_names_those_are_named_and_not_can0(
    tmp_path: Path, machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gather, "channels_with_socket", channels_with_socket)
    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path / "run"))
    monkeypatch.setattr("litegrip_client.core.discovery.ENABLED_DIRECTORY", str(tmp_path / "wants"))
    for path in ("run/left.sock", "run/left.stop.sock", "wants/litegripd@right.service"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).touch()
    code, out = machine.doctor()
    assert code == 1
    assert "there are: left, right\n         litegripctl -c left doctor\n" in out
    assert "litegripd@can0" not in out
    assert machine.bus is None
    assert "litegripd@can0" in machine.doctor("-c", "can0")[1]  # who names it means it
    machine.links = ["can0"]
    assert "litegripd@can0" in machine.doctor()[1]


def test_a_daemon_that_hangs_is_to_be_restarted(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Line, "peer_pid", 78)
    monkeypatch.setenv("LITEGRIPD_SOCKET", f"{SYSTEM_DIRECTORY}/can0.sock")
    machine.says["hello"] = SILENT
    code, out = machine.doctor()
    assert code == 1
    assert "ERROR    daemon        pid 78 listens, but the daemon did not answer" in out
    assert "systemctl start" not in out
    assert "systemctl restart" not in out  # of which channel it is, is not known
    code, out = machine.doctor("-c", "can3")
    assert "\n         sudo systemctl restart litegripd@can3\n" in out


def test_a_configuration_tells_the_bus_of_a_daemon_that_does_not_run(machine: Machine) -> None:
    machine.configured(Configuration("/x.toml", content={"bus": SLCAN, "rpc": {"group": "robots"}}))
    machine.system = System()
    found = machine.levels(*NOBODY)
    assert machine.bus == ("slcan", "/dev/ttyACM0")
    assert (found["configuration"], found["device"], "link" in found) == ("ok", "ok", False)
    machine.configured(Configuration("/x.toml", error="/x.toml: [bus] bitrate is 3"))
    machine.bus = None
    found = machine.levels(*NOBODY)
    assert (found["configuration"], "link" in found, machine.bus) == ("error", False, None)


def test_a_configuration_that_was_not_checked_hides_no_interface_of_the_channels_name(
    machine: Machine,
) -> None:
    machine.configured(Configuration("/x.toml", unchecked="it takes too long"))
    assert "link" not in machine.levels(*NOBODY)
    machine.links = ["nodaemon7"]
    found = machine.levels(*NOBODY)
    assert (found["configuration"], found["link"], found["bit-rate"]) == ("warning", "ok", "ok")
    assert machine.bus == ("socketcan", "nodaemon7")


def test_before_the_installation_no_unit_is_named(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gather, "is_unit_installed", lambda: False)
    out = machine.doctor(*NOBODY)[1]
    assert "systemctl" not in out
    assert "\n         litegripd nodaemon7\n" in out
    assert "litegripctl install-units --can nodaemon7" in out


def test_a_bus_that_the_daemon_names(machine: Machine) -> None:
    machine.says["info.get"] = changed(INFO, "configuration.bus", SLCAN)
    machine.system = System()
    assert {"device", "bit-rate"} <= machine.levels().keys()
    assert machine.bus == ("slcan", "/dev/ttyACM0")


def test_the_daemon_of_another_channel(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LITEGRIPD_SOCKET", f"{SYSTEM_DIRECTORY}/can0.sock")
    code, out = machine.doctor("-c", "can1")
    assert code == 1
    assert "has channel can0, not can1\n         unset LITEGRIPD_SOCKET" in out
    assert machine.doctor()[0] == 0


def test_a_daemon_of_another_protocol_or_that_refuses(machine: Machine) -> None:
    machine.says["health"] = Refuse("internal_error", -32603, "a defect")
    code, out = machine.doctor()
    assert (code, "ERROR    daemon        a defect" in out) == (1, True)
    machine.says["hello"] = {**HELLO, "protocol": 2}
    code, out = machine.doctor()
    assert (code, "the daemon speaks protocol 2, this client 1" in out) == (1, True)


def test_an_older_daemon_that_tells_less(machine: Machine) -> None:
    for method in ("info.get", "health", "state.get"):
        machine.says[method] = {"stop_generation": 1}
    machine.says["hello"] = {"protocol": 1, "channel": "can0", "version": "0.0.1"}
    found = machine.levels()
    assert (found["daemon"], found["version"], found["motor"]) == ("ok", "warning", "error")
    assert "ranges" not in found


def test_texts_from_elsewhere_do_not_steer_the_terminal() -> None:
    findings = [("a", error("x\x1b[2J\ny", "c\td", "e\r")), ("b", warning("w")), ("c", ok("o"))]
    assert as_text(findings) == (
        "ERROR    a             x?[2J?y\n         c?d\n         (e?)\n"
        "WARNING  b             w\nOK       c             o\n\n1 error, 1 warning"
    )


def test_what_the_daemon_says_is_told_in_commands(machine: Machine) -> None:
    reasons = [sentence("it jumped; then {motor.clear_fault}")]
    machine.says["health"] = with_terms({**HEALTH, "verdict": "down", "reasons": reasons})
    told = "ERROR    health        down: it jumped; then litegripctl -c can0 clear-fault\n"
    assert told in machine.doctor()[1]


def test_an_interrupt_ends_it(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(interface: str, bus_channel: str, held_index: int | None) -> System:
        raise KeyboardInterrupt

    monkeypatch.setattr(gather, "system", interrupted)
    assert machine.doctor(*NOBODY)[0] == 130
