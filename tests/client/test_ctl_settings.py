"""The commands of litegripctl for the daemon's configuration and the motor's registers."""

import json
from typing import Any

import pytest

from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.helpers import Ctl

CONFIG: dict[str, Any] = {
    "config": {"speed_mm_s": 50.0, "force_n": 20.0, "stall_cycles": 5, "frame_interval": 0.005},
    "ranges": {"speed_mm_s": [0.1, 500], "force_n": [0.5, 30.0], "stall_cycles": [1, 1000]},
    "kept": False,
}


def test_config_shows_all_fields(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["config.get"] = lambda request: CONFIG
    shown = (
        "speed_mm_s      50.0   0.1 to 500\n"
        "force_n         20.0   0.5 to 30\n"
        "stall_cycles    5      1 to 1000\n"
        "frame_interval  0.005\n"
    )
    assert ctl("config") == (0, shown, "")
    assert ctl("config", "get") == (0, shown, "")
    assert json.loads(ctl("config", "--json")[1]) == CONFIG


def test_config_shows_one_field(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["config.get"] = lambda request: CONFIG
    assert ctl("config", "get", "force_n") == (0, "20.0\n", "")
    assert json.loads(ctl("config", "get", "force_n", "--json")[1]) == {
        "config": {"force_n": 20.0},
        "ranges": {"force_n": [0.5, 30.0]},
        "kept": False,
    }
    assert ctl("config", "get", "frame_interval")[1] == "0.005\n"


def test_a_field_that_is_none(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["config.get"] = lambda request: CONFIG
    text = "litegripctl: there is no field 'force'\n  all fields: litegripctl config\n"
    assert ctl("config", "get", "force") == (4, "", text)


def changed(request: Request) -> dict[str, Any]:
    fields = {**CONFIG["config"], **request.params["config"]}
    return {**CONFIG, "config": fields, "kept": request.params["keep"]}


def test_config_changes_fields(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["config.set"] = changed
    arguments = ("config", "set", "stall_cycles=7", "force_n=1.5e1")
    shown = "stall_cycles  7     1 to 1000\nforce_n       15.0  0.5 to 30\n"
    hint = "until the daemon restarts; for longer: --keep\n"
    assert ctl(*arguments) == (0, shown + hint, "")
    fields = daemon.requests[-1].params["config"]
    assert json.dumps(fields) == '{"stall_cycles": 7, "force_n": 15.0}'
    assert ctl(*arguments, "--keep") == (0, shown, "")
    assert [request.params["keep"] for request in daemon.wait_for("config.set")] == [False, True]
    assert json.loads(ctl(*arguments, "--json")[1])["config"]["speed_mm_s"] == 50.0


def test_a_field_takes_one_value(daemon: FakeDaemon, ctl: Ctl) -> None:
    code, _, err = ctl("config", "set", "force_n=1", "force_n=2")
    assert (code, "a field is given twice" in err) == (2, True)
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize("as_json", [False, True])
def test_registers(daemon: FakeDaemon, ctl: Ctl, as_json: bool) -> None:
    rows = {
        "PMAX": {"number": 21, "name": "PMAX", "value": 12.5},
        "0x0A": {"number": 10, "name": "CTRL_MODE", "value": 1},
    }
    daemon.handlers["motor.read_register"] = lambda request: rows[request.params["register"]]
    code, out, _ = ctl("register", *rows, *(["--json"] if as_json else []))
    assert code == 0
    if as_json:
        assert json.loads(out) == {"registers": list(rows.values())}
    else:
        assert out == " 21  PMAX       12.5\n 10  CTRL_MODE  1\n"
