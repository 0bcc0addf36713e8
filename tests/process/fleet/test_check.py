"""litegripd-fleet check, litegripctl fleet and doctor: on a fleet that is lab, on broken ones."""

import contextlib
import io
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.ctl.doctor import gather
from litegrip_client.ctl.main import main
from litegrip_fleet.admin.check import examine
from litegrip_fleet.admin.main import main as fleet_main
from tests.process.daemon_process import DEADLINE_S, SIMULATED, Client, configured, ran
from tests.process.fleet.fleet_process import (
    HOST,
    SITE,
    Fleet,
    Part,
    _free_port,
    fleet,
    make_certificates,
)

DAY_S = 86_400.0


@pytest.fixture
def lab(site: Fleet) -> Fleet:
    """Return the module's fleet, whole; its daemon may be as it was left."""
    site.mend()
    return site


def run(lab: Fleet, *command: str) -> "subprocess.CompletedProcess[str]":
    return ran(
        sys.executable, "-m", *command, env={**os.environ, "XDG_RUNTIME_DIR": str(lab.short)}
    )


def check(lab: Fleet, config: Path) -> tuple[int, dict[str, list[dict[str, Any]]]]:
    """Return the exit code, and the findings by their names."""
    shown = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(shown):
        patch.setenv("XDG_RUNTIME_DIR", str(lab.short))
        code = fleet_main(["--config", str(config), "check", "--json"])
    data = json.loads(shown.getvalue())
    assert data["ok"] is (code == 0)
    named: dict[str, list[dict[str, Any]]] = {}
    for row in data["findings"]:
        named.setdefault(row["check"], []).append(row)
    return code, named


def problems(named: Mapping[str, list[dict[str, Any]]]) -> dict[str, str]:
    return {
        name: row["text"] for name, rows in named.items() for row in rows if row["level"] != "ok"
    }


def changed(lab: Fleet, tmp_path: Path, old: str, new: str, kind: str = "portal") -> Path:
    """Return a part's configuration with something else in it."""
    text = lab.parts[kind].config_path.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / f"{kind}.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


COMMON = {"configuration", "ca", "certificate", "key", "authority"}
REACHED = {"identity", "network", "clock"}
CHECKS = {
    "router": COMMON | {"router", "names"},
    "gateway": COMMON | REACHED | {"daemon", "offered"},
    "portal": COMMON | REACHED | {"gripper", "portal", "versions", "time"},
}


@pytest.mark.parametrize("kind", CHECKS)
def test_all_is_well(lab: Fleet, kind: str) -> None:
    code, named = check(lab, lab.parts[kind].config_path)
    assert (code, problems(named)) == (0, {})
    assert named.keys() == CHECKS[kind]


def test_a_person_reads_it(lab: Fleet, tmp_path: Path) -> None:
    config = changed(lab, tmp_path, 'user = "op1"', 'user = "op2"')
    done = run(lab, "litegrip_fleet", "--config", str(config), "check")
    assert (done.returncode, done.stderr) == (1, "")
    assert "ERROR    identity      [portal] user is 'op2'" in done.stdout
    assert done.stdout.endswith("\n1 error, no warnings\n")


@pytest.mark.parametrize(
    ("old", "new", "name", "says"),
    [
        ("ttl_s", "tttl_s", "configuration", "tttl_s is unknown"),
        ("tls/127.0.0.1:", "tls/localhost:", "network", "is not made for this name"),
        ("tls/127.0.0.1:", "tls/no-such.invalid:", "network", "is not known"),
        ("tls/127.0.0.1:", "tcp/127.0.0.1:", "network", "tcp/ is not encrypted"),
        ("tls/127.0.0.1:", "127.0.0.1:", "network", "is no endpoint"),
        ("own.key", "no.key", "key", "is not there"),
        ("op1/own.key", "op2/own.key", "certificate", "belongs to another key"),
    ],
)
def test_a_wrong_configuration_is_named(
    lab: Fleet, tmp_path: Path, old: str, new: str, name: str, says: str
) -> None:
    code, named = check(lab, changed(lab, tmp_path, old, new))
    assert code == 1
    found = problems(named)
    assert says in found[name]
    assert found.keys() <= {name}


def test_without_a_configuration_it_says_what_brings_one(lab: Fleet, tmp_path: Path) -> None:
    code, named = check(lab, tmp_path / "none.toml")
    assert code == 1
    ((row,),) = named.values()
    assert row["command"] == "sudo litegripctl install-units --fleet"


def test_a_router_at_another_port_is_not_found(lab: Fleet, tmp_path: Path) -> None:
    other = f"tls/{HOST}:{_free_port()}"
    code, named = check(lab, changed(lab, tmp_path, lab.endpoint, other))
    assert code == 1
    assert problems(named) == {"network": f"{other}: connection refused"}
    assert "is the port right" in named["network"][0]["advice"]
    assert "gripper" not in named


def test_a_router_of_another_authority_is_not_believed_and_does_not_believe(
    lab: Fleet, tmp_path: Path
) -> None:
    other = make_certificates(tmp_path / "other", "user:op1")
    code, named = check(lab, changed(lab, tmp_path, str(lab.certificates), str(other)))
    assert code == 1
    assert "its certificate is signed by another authority" in problems(named)["network"]
    # The right authority, and a certificate that it has not signed.
    mixed = changed(lab, tmp_path, f'ca = "{lab.certificates}/op1', f'ca = "{other}')
    code, named = check(lab, mixed)
    assert code == 1
    assert "is signed by another authority" in problems(named)["certificate"]


def test_a_key_that_everybody_may_read_is_named(lab: Fleet, tmp_path: Path) -> None:
    key = tmp_path / "own.key"
    key.write_bytes((lab.certificates / "op1/own.key").read_bytes())
    key.chmod(0o644)
    code, named = check(lab, changed(lab, tmp_path, f"{lab.certificates}/op1/own.key", str(key)))
    assert (code, list(problems(named))) == (1, ["key"])
    assert named["key"][0]["command"] == f"sudo chmod o= {key}"


@pytest.mark.parametrize(
    ("days", "level", "says"),
    [(336, "warning", "for 28 days"), (366, "error", "has been over"), (-1, "error", "only from")],
)
def test_a_date_far_off_is_seen(lab: Fleet, days: float, level: str, says: str) -> None:
    now_s = time.time() + days * DAY_S
    found = dict(examine(str(lab.portal.config_path), now_s))
    assert found["certificate"].level == level
    assert says in " ".join(finding.text for finding in found.values())
    assert found["clock"].level == ("error" if days < 0 else "ok")


def test_a_name_that_no_table_has_is_seen_by_the_router_alone(lab: Fleet, tmp_path: Path) -> None:
    old, new = f"{lab.certificates}/op1/", f"{lab.certificates}/op2/"
    code, named = check(lab, changed(lab, tmp_path, old, new))
    assert code == 1
    assert "user is 'op1', the certificate is that of 'op2'" in problems(named)["identity"]


def test_a_router_that_has_an_older_certificate_is_to_be_restarted(
    lab: Fleet, tmp_path: Path
) -> None:
    for file in ("ca.key", "ca.pem"):
        (tmp_path / file).write_bytes((lab.certificates / file).read_bytes())
    renewed = make_certificates(tmp_path, HOST)
    config = changed(lab, tmp_path, str(lab.certificates), str(renewed), "router")
    code, named = check(lab, config)
    assert (code, list(problems(named))) == (0, ["router"])
    assert "systemctl restart litegripd-fleet@router" in named["router"][0]["command"]


def test_litegripctl_lists_and_stops_a_site(lab: Fleet) -> None:
    config = ["--config", str(lab.portal.config_path)]
    listed = run(lab, "litegrip_client.ctl.main", "fleet", *config)
    assert listed.returncode == 0, listed.stderr
    assert listed.stdout.splitlines()[1].startswith("lab.left")
    rows = json.loads(run(lab, "litegrip_client.ctl.main", "fleet", SITE, "--json", *config).stdout)
    assert [row["gripper"] for row in rows] == ["lab.left"]
    stopped = run(lab, "litegrip_client.ctl.main", "fleet", "stop", SITE, "--why", "lunch", *config)
    assert stopped.returncode == 0, stopped.stderr
    assert stopped.stdout.startswith("lab.left: stopped")
    with Client(lab.socket_path()) as client:
        assert client.result("state.get")["stop"]["why"] == "lunch"
    again = run(lab, "litegrip_client.ctl.main", "fleet", "stop", SITE, "--json", *config)
    assert json.loads(again.stdout)["confirmed"].keys() == {"lab.left"}


def test_the_doctor_shows_what_the_fleets_check_finds(
    lab: Fleet,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(gather, "DIRECTORY", tmp_path)
    changed(lab, tmp_path, 'user = "op1"', 'user = "op2"').rename(tmp_path / "fleet.toml")
    code = main(["--socket", str(lab.socket_path()), "doctor", "--json"])
    rows = {row["check"]: row for row in json.loads(capsys.readouterr().out)["findings"]}
    assert code == 1
    assert rows["fleet-identity"]["level"] == "error"
    assert rows["fleet-gripper"]["level"] == "ok"
    assert rows["protection"]["level"] == "ok"
    assert "on another machine" in rows["daemon"]["text"]
    assert {"link", "device", "bit-rate", "real-time"}.isdisjoint(rows)


# Broken ones --------------------------------------------------------------------------------------


def test_a_gateway_that_does_not_run(lab: Fleet) -> None:
    lab.gateway.kill()
    code, named = check(lab, lab.portal.config_path)
    assert (code, set(problems(named))) == (1, {"gripper", "portal"})
    assert "lab.left is not on the network" in problems(named)["gripper"]
    assert "its gateway is not connected" in problems(named)["portal"]
    code, named = check(lab, lab.gateway.config_path)
    assert (code, set(problems(named))) == (1, {"offered"})


def test_a_portal_that_does_not_run(lab: Fleet) -> None:
    lab.portal.kill()
    code, named = check(lab, lab.portal.config_path)
    assert (code, set(problems(named))) == (1, {"portal"})
    assert "enable --now litegripd-fleet@portal" in named["portal"][0]["command"]


def test_a_portal_is_looked_at_without_the_key(lab: Fleet, tmp_path: Path) -> None:
    config = changed(lab, tmp_path, "own.key", "no.key")
    code, named = check(lab, config)
    assert (code, set(problems(named))) == (1, {"key"})
    assert "answers" in named["portal"][0]["text"]
    lab.portal.kill()
    code, named = check(lab, config)
    assert (code, set(problems(named))) == (1, {"key", "portal"})


def test_a_user_who_is_shut_out_learns_where_to_look(lab: Fleet) -> None:
    file = lab.router.config_path
    text = file.read_text(encoding="utf-8")
    assert "\nop1 = " in text
    file.write_text(
        "\n".join(line for line in text.splitlines() if not line.startswith("op1 = ")),
        encoding="utf-8",
    )
    lab.router.restart()
    try:
        lab.router.until_says("listening at")
        ends_s = time.monotonic() + DEADLINE_S
        named: dict[str, list[dict[str, Any]]] = {}
        while "see nothing" not in problems(named).get("portal", ""):
            assert time.monotonic() < ends_s, problems(named)
            _code, named = check(lab, lab.portal.config_path)  # until the portal is connected again
    finally:
        file.write_text(text, encoding="utf-8")
        lab.router.kill()
    assert "[router.users]" in named["gripper"][0]["advice"]
    assert "the router lets op1 see nothing" in named["portal"][0]["text"]


def test_a_router_that_does_not_run(lab: Fleet) -> None:
    lab.router.kill()
    for kind, name in (("router", "router"), ("gateway", "network"), ("portal", "network")):
        code, named = check(lab, lab.parts[kind].config_path)
        assert code == 1
        assert "connection refused" in problems(named)[name]


def test_a_router_that_is_frozen(lab: Fleet) -> None:
    lab.router.freeze()
    code, named = check(lab, lab.gateway.config_path)
    lab.router.thaw()
    assert (code, list(problems(named))) == (1, ["network"])
    assert "no answer within" in problems(named)["network"]


def test_a_daemon_that_does_not_run(tmp_path: Path, certificates: Path) -> None:
    with configured(tmp_path / "left", f"own-{os.getpid()}") as running:
        running.connect().close()
        with fleet(tmp_path / "fleet", certificates, {"left": running.socket_path}) as lab:
            running.end()
            lab.gateway.until_says("has gone")
            code, named = check(lab, lab.gateway.config_path)
    assert (code, set(problems(named))) == (1, {"daemon", "offered"})
    assert "no daemon can be reached" in problems(named)["daemon"]


def test_a_daemon_that_does_not_trust_the_gateways_user(tmp_path: Path, certificates: Path) -> None:
    config = SIMULATED.replace("gateways", "# gateways")
    with configured(tmp_path / "left", f"own-{os.getpid()}", config) as running:
        running.connect().close()
        with fleet(tmp_path / "fleet", certificates, {"left": running.socket_path}) as lab:
            code, named = check(lab, lab.gateway.config_path)
    assert (code, set(problems(named))) == (1, {"daemon"})
    assert "gateways = [" in named["daemon"][0]["advice"]


def test_an_insecure_way_is_seen_by_everybody_who_asks(tmp_path: Path, lab: Fleet) -> None:
    endpoint = f"tcp/{HOST}:{_free_port()}"
    plain = f"[network]\ninsecure = true\nconnect = {[endpoint]}\n"
    sockets = lab.short / "plain"
    sockets.mkdir()
    gateway = lab.gateway.config_path.read_text(encoding="utf-8").partition("[gateway]")[2]
    listening = f'[network]\ninsecure = true\n[router]\nlisten = ["{endpoint}"]\n'
    portal = f'[portal]\nuser = "op1"\ngrippers = ["lab.left"]\ndirectory = "{sockets}"\n'
    folder = tmp_path / "plain"
    parts = [Part(folder, "router", "router", listening)]
    try:
        parts[0].until_says("listening at")
        runtime = str(lab.short)
        own = f"{plain}[gateway]{gateway}"
        parts.append(Part(folder, "gateway", "gateway", own, XDG_RUNTIME_DIR=runtime))
        parts.append(Part(folder, "portal", "portal", plain + portal))
        parts[1].until_says("can be reached")
        path = sockets / "lab.left.sock"
        parts[2].until_exists(path.with_suffix(".stop.sock"))
        for part in parts:
            assert "nothing is encrypted" in part.log
        _insecurity_is_seen(lab, path)
        code, named = check(lab, parts[2].config_path)
        assert (code, set(problems(named))) == (0, {"encryption"})
    finally:
        for part in parts:
            part.kill()


def _insecurity_is_seen(lab: Fleet, path: Path) -> None:
    with Client(path) as client:
        assert client.result("hello")["remote"]["insecure"] is True
        assert client.result("health")["remote"] == {
            "insecure": True,
            "certificate_expires_s": None,
        }
    ctl = ("litegrip_client.ctl.main", "--socket", str(path))
    assert "litegripd_portal_insecure{" in run(lab, *ctl, "metrics").stdout
    assert "remote.insecure" in run(lab, *ctl, "health").stdout
    assert "WARNING  protection    insecure = true" in run(lab, *ctl, "doctor").stdout


def test_a_secure_way_says_until_when(lab: Fleet) -> None:
    with Client(lab.socket_path()) as client:
        hello, health = client.result("hello")["remote"], client.result("health")["remote"]
    assert health == {name: hello[name] for name in ("insecure", "certificate_expires_s")}
    assert hello["insecure"] is False
    assert 363 * DAY_S < hello["certificate_expires_s"] - time.time() < 366 * DAY_S
