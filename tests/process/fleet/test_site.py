"""A whole site: who is there and how, and a stop for all that says who has not confirmed it."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import (
    DEADLINE_S,
    SIMULATED,
    Client,
    DaemonProcess,
    begin_again,
    ran,
    wait_a_moment,
)
from tests.process.fleet.fleet_process import Fleet, Part, fleet


class Robot:
    """The second robot's daemon, which can be started again where it was."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        config = folder / "right.toml"
        config.write_text(SIMULATED, encoding="utf-8")
        socket_path = str(folder / "rpc.sock")
        self._arguments = ("--config", str(config), "--socket", socket_path)
        self.daemon = self._start()

    def _start(self) -> DaemonProcess:
        running = DaemonProcess(self._folder, f"right-{os.getpid()}", *self._arguments)
        running.connect().close()
        return running

    def again(self) -> DaemonProcess:
        """Have it be as at its beginning."""
        if self.daemon.process.poll() is not None:
            self.daemon = self._start()
        begin_again(self.daemon)
        return self.daemon


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    robot = Robot(tmp_path_factory.mktemp("right"))
    yield robot
    robot.daemon.kill()


@pytest.fixture
def right(robot: Robot) -> DaemonProcess:
    return robot.again()


@pytest.fixture(scope="module")
def site(
    tmp_path_factory: pytest.TempPathFactory,
    certificates: Path,
    shared: DaemonProcess,
    robot: Robot,
) -> Iterator[Fleet]:
    """A fleet of two grippers for all tests of this module."""
    shared.connect().close()
    sockets = {"left": shared.socket_path, "right": robot.daemon.socket_path}
    with fleet(tmp_path_factory.mktemp("site"), certificates, sockets) as running:
        yield running


@pytest.fixture
def lab(site: Fleet, gripper: DaemonProcess, right: DaemonProcess) -> Fleet:
    """Return the module's fleet; whatever a test has killed or frozen in it runs again."""
    site.mend()
    return site


def run(
    lab: Fleet, *arguments: str, config: Path | None = None
) -> "subprocess.CompletedProcess[str]":
    file = str(lab.portal.config_path if config is None else config)
    command = [sys.executable, "-m", "litegrip_fleet", "--config", file, *arguments]
    return ran(*command)


def test_all_grippers_are_listed_with_how_they_are(lab: Fleet, gripper: DaemonProcess) -> None:
    with gripper.connect() as client:
        client.result("hello", client="sorter")
        client.result("lease.acquire")
        listed = run(lab, "list", "lab", "--json")
        shown = run(lab, "list")
    assert listed.returncode == 0, listed.stderr
    left, right = json.loads(listed.stdout)
    assert (left["gripper"], right["gripper"]) == ("lab.left", "lab.right")
    assert (left["owner"], right["owner"]) == ("sorter", None)
    assert left["verdict"] in ("ok", "degraded", "error")
    assert left["age_s"] >= 0.0
    lines = shown.stdout.splitlines()
    assert lines[0].split() == ["GRIPPER", "VERSION", "VERDICT", "MODE", "AGE", "ANSWER", "OWNER"]
    assert [line.split()[0] for line in lines[1:]] == ["lab.left", "lab.right"]
    assert lines[1].endswith("sorter")
    assert run(lab, "list", "elsewhere").stdout == "no gripper was found\n"


def test_the_one_gripper_of_a_shell_is_not_that_of_all_names(
    tmp_path: Path,
    certificates: Path,
    gripper: DaemonProcess,
    right: DaemonProcess,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("LITEGRIPD_SOCKET", str(gripper.socket_path))
    sockets = {"left": gripper.socket_path, "right": right.socket_path}
    with fleet(tmp_path / "fleet", certificates, sockets) as lab:
        with Client(lab.socket_path("right")) as client:
            assert client.result("hello")["remote"]["channel"] == f"right-{os.getpid()}"
            client.result("stop", level="disable")
        with right.connect() as client:
            assert client.result("state.get")["stop"] is not None
        with gripper.connect() as client:
            assert client.result("state.get")["stop"] is None


def test_a_gripper_whose_daemon_is_gone_says_so(lab: Fleet, right: DaemonProcess) -> None:
    right.process.kill()
    right.process.wait()
    listed = run(lab, "list", "--json")
    assert listed.returncode == 1
    errors = {row["gripper"]: row.get("error") for row in json.loads(listed.stdout)}
    assert errors["lab.left"] is None
    assert "no daemon can be reached" in errors["lab.right"]


def test_when_a_daemon_is_gone_its_remote_clients_are_let_go(
    lab: Fleet, right: DaemonProcess
) -> None:
    with Client(lab.socket_path("right")) as client, Client(lab.socket_path("left")) as other:
        client.result("hello")
        right.process.kill()
        while client.read():
            pass  # whatever it had sent; then the connection ends
        assert other.result("hello")["channel"] == "lab.left"
    with Client(lab.socket_path("right")) as client:
        error = client.read()["error"]
    assert error["data"]["reason"] == "unreachable"
    assert "no daemon can be reached" in error["message"] or "has gone" in error["message"]
    assert "on the machine of lab.right: " in error["message"]  # the paths are that one's


def test_a_site_is_stopped_at_once(
    lab: Fleet, gripper: DaemonProcess, right: DaemonProcess
) -> None:
    why = "手が挟まった" * 40
    done = run(lab, "stop", "lab", "--level", "disable", "--why", why)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.split(" (")[0] for line in done.stdout.splitlines()] == [
        "lab.left: stopped",
        "lab.right: stopped",
    ]
    for running in (gripper, right):
        with running.connect() as client:
            stop = client.result("state.get")["stop"]
            assert (stop["by"], stop["why"]) == ("op1@lab via gateway", why[:80])
            assert stop["level"] == "disable"


def test_who_is_silent_is_named_and_the_stop_fails(
    lab: Fleet, gripper: DaemonProcess, right: DaemonProcess
) -> None:
    lab.gateway.freeze()
    done = run(lab, "stop", "lab")
    lab.gateway.thaw()
    assert done.returncode == 1
    rows = done.stdout.splitlines()
    assert [row.split(":")[0] for row in rows] == ["lab.left", "lab.right"]
    for row in rows:
        assert ": NOT confirmed: by the portal: the stop of " in row
        assert row.endswith(": silent")
    assert "switch that cuts the power" in done.stderr
    # Stops that the gateway found when it went on are in force before a newer one is confirmed.
    ends_s = time.monotonic() + DEADLINE_S
    while run(lab, "stop", "lab").returncode != 0:
        assert time.monotonic() < ends_s


def test_a_daemon_that_does_not_take_the_stop_is_named(lab: Fleet, right: DaemonProcess) -> None:
    right.process.send_signal(signal.SIGSTOP)
    done = run(lab, "stop", "lab")
    right.process.send_signal(signal.SIGCONT)
    assert done.returncode == 1
    first, second = done.stdout.splitlines()
    assert first.startswith("lab.left: stopped")
    assert second.startswith("lab.right: NOT confirmed: ")


def test_without_a_router_the_commands_say_so(lab: Fleet) -> None:
    for part in (lab.gateway, lab.portal):
        part.until_says("connected to a router (tls/")
    lab.router.kill()
    for part in (lab.gateway, lab.portal):
        part.until_says("the connection to the router is lost (tls/")
    for command in (["list"], ["stop", "elsewhere"]):  # the portal has no gripper there
        done = run(lab, *command)
        assert done.returncode == 3
        assert "no router answers at tls/" in done.stderr
        assert "litegripd-fleet check" in done.stderr
        assert ("no stop was sent" in done.stderr) is (command[0] == "stop")
    done = run(lab, "stop", "lab")
    assert done.returncode == 1
    assert "no router answers at tls/" in done.stderr
    assert done.stdout.count(": NOT confirmed: the stop of ") == 2
    assert "NOT stopped: other grippers of the site" in done.stdout
    lab.portal.restart()
    lab.portal.until_says("no router answers at tls/")


@pytest.fixture
def keyless(lab: Fleet, tmp_path: Path) -> Path:
    """The portal's configuration as one sees it who cannot read its key."""
    config = tmp_path / "portal.toml"
    text = lab.portal.config_path.read_text(encoding="utf-8")
    config.write_text(text.replace("own.key", "none.key"), encoding="utf-8")
    return config


CLOSED = "none.key cannot be read: No such file or directory"


def test_who_cannot_read_the_key_sees_the_portals_grippers(
    lab: Fleet, keyless: Path, gripper: DaemonProcess, right: DaemonProcess
) -> None:
    with gripper.connect() as client:
        client.result("hello", client="sorter")
        client.result("lease.acquire")
        listed = run(lab, "list", "lab", "--json", config=keyless)
    assert listed.returncode == 0
    assert CLOSED in listed.stderr
    left, other = json.loads(listed.stdout)
    assert (left["gripper"], left["owner"], left["mode"]) == ("lab.left", "sorter", "disabled")
    assert (other["gripper"], other["owner"]) == ("lab.right", None)
    right.process.kill()
    right.process.wait()
    listed = run(lab, "list", config=keyless)
    assert listed.returncode == 1
    assert "no daemon can be reached" in listed.stdout or "has gone" in listed.stdout
    assert run(lab, "list", "elsewhere", config=keyless).stdout == "no gripper was found\n"


def test_without_a_portal_a_key_that_cannot_be_read_ends_it(lab: Fleet, tmp_path: Path) -> None:
    config = tmp_path / "gateway.toml"
    text = lab.gateway.config_path.read_text(encoding="utf-8")
    config.write_text(text.replace("own.key", "none.key"), encoding="utf-8")
    done = run(lab, "list", config=config)
    assert (done.returncode, done.stdout) == (3, "")
    assert CLOSED in done.stderr


def test_who_cannot_read_the_key_stops_the_portals_grippers(
    lab: Fleet, keyless: Path, gripper: DaemonProcess, right: DaemonProcess
) -> None:
    done = run(lab, "stop", "lab", "--why", "a hand", config=keyless)
    assert done.returncode == 0, done.stdout + done.stderr
    assert CLOSED in done.stderr
    assert done.stdout.count(": stopped (") == 2
    for running in (gripper, right):
        with running.connect() as client:
            stop = client.result("state.get")["stop"]
            assert (stop["by"], stop["why"]) == ("op1@lab via gateway", "a hand")
    lab.gateway.freeze()
    done = run(lab, "stop", "lab", config=keyless)
    lab.gateway.thaw()
    assert done.returncode == 1
    assert done.stdout.count(" is not confirmed within 2 s") == 2
    assert "switch that cuts the power" in done.stderr
    lab.portal.kill()
    done = run(lab, "stop", "lab", config=keyless)
    assert done.returncode == 1
    assert done.stdout.count("NOT confirmed: the portal does not answer: ") == 2


def test_a_gripper_that_two_gateways_offer_is_nobodys_until_one_ends(
    lab: Fleet, gripper: DaemonProcess
) -> None:
    first = lab.gateway
    text = first.config_path.read_text(encoding="utf-8")
    with Client(lab.socket_path("left")) as early, gripper.connect() as local:
        early.result("motor.enable")
        lab.parts["second"] = second = Part(
            lab.folder, "gateway", "second", text, XDG_RUNTIME_DIR=str(lab.short)
        )
        second.until_says("lab.left: two gateways offer it")
        while "error" not in (message := early.read()):
            assert message
        assert "lab.left: two gateways offer it" in message["error"]["message"]
        newest = max(job["job"] for job in local.result("job.list")["jobs"])
        with Client(lab.socket_path("left")) as late:
            late.send("motion.open")
            error = late.read()["error"]
        assert error["data"]["reason"] == "unreachable"
        assert "lab.left: two gateways offer it" in error["message"]
        jobs = local.result("job.list")["jobs"]
        later = [job["kind"] for job in jobs if job["job"] > newest]
        assert set(later) <= {"disable"}  # of the client that was cut off
        listed = run(lab, "list", "lab", "--json")
        assert [row["error"][:12] for row in json.loads(listed.stdout)] == ["two gateways"] * 2
        assert run(lab, "stop", "lab").returncode == 0
        assert local.result("state.get")["stop"] is not None
        while len(local.result("clients.list")["clients"]) > 3:  # each gateway has its own
            wait_a_moment(second.process)
        lab.parts.pop("second").end()
        with Client(lab.socket_path("left")) as late:
            assert late.result("hello")["channel"] == "lab.left"


NOBODY = "tls/127.0.0.1:9"
"""The port of discard, at which nobody listens."""


@pytest.mark.parametrize("is_beside", [False, True], ids=["alone", "beside one that answers"])
def test_a_router_that_lets_nobody_in_keeps_no_stop_from_the_portals_grippers(
    lab: Fleet, gripper: DaemonProcess, right: DaemonProcess, tmp_path: Path, is_beside: bool
) -> None:
    """The portal's sessions go on where a new one is kept out."""
    for name in ("left", "right"):
        with Client(lab.socket_path(name)) as client:
            client.result("hello")
    config = tmp_path / "portal.toml"
    text = lab.portal.config_path.read_text(encoding="utf-8")
    assert text.count(f"'{lab.endpoint}'") == 1
    more = f", '{lab.endpoint}'" if is_beside else ""
    config.write_text(text.replace(f"'{lab.endpoint}'", f"'{NOBODY}'{more}"), encoding="utf-8")
    done = run(lab, "stop", "lab", "--level", "relax", config=config)
    assert done.stdout.count(": stopped (") == 2, done.stdout + done.stderr
    for running in (gripper, right):
        with running.connect() as client:
            assert client.result("state.get")["stop"]["level"] == "relax"
    assert f"no router answers at {NOBODY}" in done.stderr
    assert done.returncode == (0 if is_beside else 1)
    assert ("NOT stopped: other grippers of the site" in done.stdout) is not is_beside
