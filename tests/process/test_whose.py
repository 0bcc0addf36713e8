"""Whose the gripper is, between processes of several users: a daemon, scripts and litegripctl."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.client.helpers import stopped
from tests.process.daemon_process import DEADLINE_S, DaemonProcess, begin_again, daemon_for_all

pytestmark = pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")

ALICE, BOB, CAROL = 30_001, 30_002, 30_003
CHANNEL, LONE = f"whose-{os.getpid()}", f"lone-{os.getpid()}"

AS_USER = """
import importlib, json, logging, os, pkgutil, socket, sys
import litegrip_client
for module in pkgutil.walk_packages(litegrip_client.__path__, "litegrip_client."):
    if not any(part in module.name for part in (".plot", ".live", ".metrics")):  # with libraries
        importlib.import_module(module.name)  # another user may not read them
from litegrip_client import LiteGrip, LeaseError
from litegrip_client.ctl.main import main
uid, code, path, channel = int(sys.argv[1]), *sys.argv[2:5]
os.setgroups([])
os.setgid(50_000)
os.setuid(uid)
def say(*words):
    print(*words, flush=True)
exec(code)
"""


@contextlib.contextmanager
def script(
    uid: int, code: str, path: Path, *arguments: str, channel: str = CHANNEL
) -> Iterator["subprocess.Popen[str]"]:
    """Run code as another user; `path` is the daemon's socket."""
    process = subprocess.Popen(
        [sys.executable, "-c", AS_USER, str(uid), code, str(path), channel, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def ctl(running: DaemonProcess, uid: int, *arguments: str) -> tuple[int, str, str]:
    """Run litegripctl as another user, at no terminal."""
    code = 'sys.exit(main(["--socket", path, *sys.argv[5:]]))'
    with script(uid, code, running.socket_path, *arguments) as process:
        out, err = process.communicate(timeout=DEADLINE_S)
    return process.returncode, out, err


@pytest.fixture(scope="module")
def one() -> Iterator[DaemonProcess]:
    with daemon_for_all(CHANNEL) as running:
        yield running


@pytest.fixture
def shared(one: DaemonProcess) -> DaemonProcess:
    """The module's daemon, to which everybody may connect, as operator; root is its admin."""
    begin_again(one)
    return one


@pytest.fixture
def lone() -> Iterator[DaemonProcess]:
    """Such a daemon for one test alone, whose log tells of nobody else; its channel is LONE."""
    with daemon_for_all(LONE) as running:
        yield running


SLEEPER = """
def attempt(what, function):
    try:
        function()
    except LeaseError as error:
        say(what, error.reason, error.data.get("by", {}).get("uid"), error.data.get("why"))
    else:
        say(what, "was done")

logging.basicConfig(stream=sys.stdout, format="%(message)s")
with LiteGrip(channel, socket_path=path) as gripper:
    gripper.enable()
    gripper.goto(80)
    say("asleep", os.getpid())
    sys.stdin.readline()
    attempt("close", gripper.close)
    attempt("hold", gripper.hold)
    attempt("disable", gripper.disable)
    attempt("set_force", lambda: gripper.set_force(5))
    say("awake")
    sys.stdin.readline()
say("left")
"""


def said(process: "subprocess.Popen[str]") -> str:
    """Return the next line of a script, which must not have ended."""
    assert process.stdout is not None
    line = process.stdout.readline()  # several may have come at once
    assert line or process.stderr is None, process.stderr.read()
    return line.strip()


def wake(process: "subprocess.Popen[str]") -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


@pytest.mark.parametrize("new_user", ["holds the lease", "has given it back"])
def test_a_script_that_slept_through_its_loss_leaves_the_gripper_to_its_new_user(
    lone: DaemonProcess, new_user: str
) -> None:
    with script(ALICE, SLEEPER, lone.socket_path, channel=LONE) as process:
        pid = said(process).removeprefix("asleep ")
        code, out, _ = ctl(lone, 0, "lease", "take", "my turn")
        assert code == 0
        taken = rf"taken from \S+ \(pid {pid}\); the jaws hold on; the lease is free now\n"
        assert re.fullmatch(taken, out), out
        with lone.connect() as client:
            assert client.result("state.get")["enabled"]  # the script would have had it disabled
            if new_user == "holds the lease":
                client.result("lease.acquire", purpose="my turn")
            assert client.result("motion.move", opening_mm=40)["ok"]
            jobs = client.result("job.list")["jobs"]
            wake(process)
            told = [said(process) for _ in range(5)]
            for what, line in zip(("close", "hold", "disable", "set_force"), told, strict=False):
                assert line == f"{what} lease_lost 0 my turn"
            wake(process)
            assert "leaves the motor as it is" in said(process)
            assert said(process) == "left"
            assert process.wait(DEADLINE_S) == 0
            state = client.result("state.get")
            assert (state["enabled"], state["mode"]) == (True, "holding")
            assert state["opening_mm"] == pytest.approx(40, abs=2)
            assert client.result("job.list")["jobs"] == jobs
        assert f"(pid {pid}, uid {ALICE}) is lost: it was taken over by" in lone.log
        assert "the gripper was taken over: the jaws keep their hold" in lone.log
        assert "is gone: the jaws" not in lone.log


HOLDER = """
with LiteGrip(channel, socket_path=path) as gripper, gripper.lease("sorting") as lease:
    gripper.enable()
    gripper.goto(80)
    say(lease.token)
    sys.stdin.readline()
    gripper.get_state()  # and so knows of the stops that there were
    gripper.goto(60)
    say("moved")
"""

THIEF = """
s = socket.socket(socket.AF_UNIX); s.connect(path); f = s.makefile("rb")
def call(method, **params):
    line = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
    s.sendall(json.dumps(line).encode() + b"\\n")
    return json.loads(f.readline())
epoch = call("hello")["result"]["epoch"]
number = call("lease.get")["result"]["owner"]["number"]
for token in (f"{epoch}:{number}", f"0:{number}", str(number), epoch, ""):
    for method in ("motion.close", "motor.disable", "lease.renew", "lease.release"):
        say(call(method, lease=token)["error"]["data"]["reason"])
    say(call("lease.resume", lease=token)["error"]["data"]["reason"])
say(call("lease.take", why="I want it")["error"]["data"]["reason"])
if len(sys.argv) > 5:
    say(call("motion.hold", lease=sys.argv[5])["result"]["job"])
    say(call("lease.release", lease=sys.argv[5])["result"]["released"])
"""


def test_the_token_of_a_lease_is_its_holders_secret_and_the_log_names_who_acted(
    shared: DaemonProcess,
) -> None:
    with script(ALICE, HOLDER, shared.socket_path) as holder:
        token = said(holder)
        with script(BOB, THIEF, shared.socket_path) as thief:
            out, err = thief.communicate(timeout=DEADLINE_S)
        assert thief.returncode == 0, err
        *refused, take = out.split()
        assert (set(refused), len(refused), take) == ({"lease_lost"}, 25, "not_permitted")
        with shared.connect() as client:
            assert client.result("lease.get")["owner"]["uid"] == ALICE
            state = client.result("state.get")
            assert (state["enabled"], state["mode"]) == (True, "holding")
            assert state["opening_mm"] == pytest.approx(80, abs=2)
        wake(holder)
        assert said(holder) == "moved"
        assert holder.wait(DEADLINE_S) == 0
        assert token not in shared.log


def test_who_acts_by_a_token_that_it_was_given_is_named_in_the_log(lone: DaemonProcess) -> None:
    with script(ALICE, HOLDER, lone.socket_path, channel=LONE) as holder:
        with script(BOB, THIEF, lone.socket_path, said(holder)) as friend:
            out, err = friend.communicate(timeout=DEADLINE_S)
        assert friend.returncode == 0, err
        assert out.split()[-1] == "True"
        actor = rf"given back by \S+ \(pid {friend.pid}, uid {BOB}\)"
        assert re.search(
            rf"{actor}, in the place of \S+ \(pid {holder.pid}, uid {ALICE}\)", lone.log
        )
        assert re.search(rf"hold by \S+ \(pid {friend.pid}, uid {BOB}\)", lone.log)


def test_who_stops_may_clear_though_a_script_has_the_lease_and_others_are_told_who(
    shared: DaemonProcess,
) -> None:
    with script(ALICE, HOLDER, shared.socket_path) as holder:
        assert said(holder)
        done = stopped("hold", f"litegripctl --socket {shared.socket_path}")
        assert ctl(shared, BOB, "stop", "--why", "a hand") == (0, done, "")
        code, out, err = ctl(shared, CAROL, "clear")
        assert (code, out) == (6, "")
        assert (
            f"(pid {holder.pid}), who has the lease, uid {BOB}, who stopped it, or an admin" in err
        )
        assert "lease take" not in err
        with shared.connect() as client:
            assert client.result("state.get")["stop"]["level"] == "hold"
        assert ctl(shared, BOB, "clear") == (0, "cleared: motions are allowed\n", "")
        wake(holder)
        assert said(holder) == "moved"
        assert ctl(shared, BOB, "stop")[0] == 0
        assert ctl(shared, 0, "clear")[0] == 0


HEIR = """
s = socket.socket(socket.AF_UNIX); s.connect(path); f = s.makefile("rb")
if os.fork():
    os._exit(0)
parent = os.getppid()
say(os.getpid())
sys.stdin.readline()
for method in ("lease.acquire", "motor.enable", "motion.open", "state.get", "stop"):
    s.sendall(json.dumps({"jsonrpc": "2.0", "id": 1, "method": method}).encode() + b"\\n")
    answer = json.loads(f.readline())
    say(answer["error"]["data"]["reason"] if "error" in answer else "done")
sys.stdin.readline()
"""


@pytest.mark.parametrize("ends", ["before it was let in", "later"])
def test_who_has_inherited_the_connection_of_a_dead_process_gets_no_lease(
    shared: DaemonProcess, ends: str
) -> None:
    with shared.connect() as client:
        if ends == "before it was let in":
            shared.process.send_signal(signal.SIGSTOP)
        with script(ALICE, HEIR, shared.socket_path) as process:
            assert int(said(process)) != process.pid
            assert process.wait(DEADLINE_S) == 0  # the opener
            shared.process.send_signal(signal.SIGCONT)
            client.result("hello")
            wake(process)
            told = [said(process) for _ in range(5)]
            assert told == [*["client_lost"] * 3, "done", "done"]
            assert client.result("lease.get")["owner"] is None
            assert not client.result("state.get")["enabled"]
            wake(process)
