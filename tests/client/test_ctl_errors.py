"""How litegripctl tells errors, and what Ctrl-C does."""

import json
from pathlib import Path

import pytest

from litegrip_client.ctl.main import main
from litegripd.model.errors import ERROR_TABLE, ErrorKind
from litegripd.model.sentence import sentence
from litegripd.motor.phases import implausible_refusal
from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.helpers import Ctl

IN_ITS_OWN_WORDS = {
    "stopped",
    "sent_before_stop",
    "not_enabled",
    "busy",
    "unknown_job",
    "lease_held",
    "unknown_trajectory",
    "trajectory_busy",
    "teleop_busy",
    "teleop_not_ready",
}


RAISED = [kind for kind in ERROR_TABLE if kind.reason != "unknown_method"]
"""All but what no command asks for: a method that its own version does not have."""


@pytest.mark.parametrize("kind", RAISED, ids=lambda kind: kind.reason)
def test_every_error_ends_with_its_exit_code(daemon: FakeDaemon, ctl: Ctl, kind: ErrorKind) -> None:
    daemon.handlers["state.get"] = lambda request: request.fail(
        kind.reason, kind.code, "what", retryable=kind.retryable, hint="do this"
    )
    code, out, err = ctl("state")
    hint = "litegripctl" if kind.reason in IN_ITS_OWN_WORDS else "do this"
    assert (code, out) == (kind.exit_code, "")
    assert err.startswith("litegripctl: what\n  ")
    assert hint in err.splitlines()[1]
    code, out, err = ctl("--json", "state")
    assert (code, err) == (kind.exit_code, "")
    data = {"reason": kind.reason, "retryable": kind.retryable, "hint": "do this"}
    assert json.loads(out) == {"error": {"code": kind.code, "message": "what", "data": data}}


def test_a_daemon_without_a_method_is_older_than_the_command(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["job.list"] = lambda request: request.fail("unknown_method", -32601, "what")
    code, out, err = ctl("jobs")
    assert (code, out) == (4, "")
    first, second = err.splitlines()
    assert first.startswith("litegripctl: the daemon, litegripd ")
    assert first.endswith(" and lacks: litegripctl jobs")
    assert second == "  upgrade it as docs/installation.md says, then: litegripctl restart --hold"
    code, out, _ = ctl("--json", "jobs")
    assert (code, json.loads(out)["error"]["data"]["reason"]) == (4, "older_daemon")


@pytest.mark.parametrize(
    ("reason", "code", "hint"),
    [
        ("stopped", -32021, "litegripctl clear"),
        ("busy", -32020, "litegripctl jobs"),
        ("motor_silent", -32032, "try again"),
        ("unreachable", -32060, "litegripctl doctor"),
        ("internal_error", -32603, "journalctl -t litegripd"),
    ],
)
def test_there_is_always_a_hint(
    daemon: FakeDaemon, ctl: Ctl, reason: str, code: int, hint: str
) -> None:
    retryable = reason == "motor_silent"
    daemon.handlers["state.get"] = lambda request: request.fail(
        reason, code, "first\nsecond\x1b", retryable=retryable
    )
    _, _, err = ctl("state")
    what, then = err.splitlines()
    assert what == "litegripctl: first second "
    assert hint in then


def test_the_log_is_that_of_the_channel_where_that_is_known(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def told(*arguments: str) -> str:
        assert main([*arguments, "state"]) == 70
        return capsys.readouterr().err.splitlines()[-1]

    daemon.handlers["state.get"] = lambda request: request.fail("internal_error", -32603)
    monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.path)
    assert told() == "  see the daemon's log: journalctl -t litegripd"
    assert told("-c", "can0") == "  see the daemon's log: journalctl -u litegripd@can0"
    monkeypatch.delenv("LITEGRIPD_SOCKET")
    monkeypatch.setattr(
        "litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(Path(daemon.path).parent)
    )
    assert told() == "  see the daemon's log: journalctl -u litegripd@can0"


def test_the_log_of_a_gripper_of_another_machine_is_there(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    hello = daemon.handlers["hello"]
    daemon.handlers["hello"] = lambda request: {**hello(request), "channel": "lab.left"}
    daemon.handlers["state.get"] = lambda request: request.fail("internal_error", -32603)
    monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.path)
    assert main(["-c", "lab.left", "state"]) == 70
    hint = "  see the daemon's log on the gripper's machine: journalctl -t litegripd"
    assert capsys.readouterr().err.splitlines()[-1] == hint


def test_a_remedy_that_the_message_ends_with_is_not_told_twice(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    daemon.handlers["state.get"] = lambda request: request.fail(
        "bus_down", -32033, "no bus; mend it", hint="mend it"
    )
    code, _out, err = ctl("state")
    assert (code, err) == (5, "litegripctl: no bus; mend it\n")


def test_what_says_itself_that_it_may_be_tried_again_needs_no_hint(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    text = "the motor's registers are still being read: try again"
    daemon.handlers["state.get"] = lambda request: request.fail(
        "motor_silent", -32032, text, retryable=True
    )
    assert ctl("state")[2] == f"litegripctl: {text}\n"


def test_a_remedy_in_the_protocols_words_is_not_told_twice_either(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    refusal = implausible_refusal(6.283)
    daemon.handlers["state.get"] = lambda request: request.fail(
        refusal.reason, -32037, refusal.message, **refusal.data
    )
    (told,) = ctl("state")[2].splitlines()
    assert "if what is shown is wrong; then litegripctl clear-fault, and calibrate again" in told


@pytest.mark.parametrize(
    ("template", "shown"),
    [
        ("clear it with {stop.clear} first", "clear it with litegripctl clear first"),
        (
            "wait for it ({job.wait}), cancel it ({job.cancel}) or stop",
            "wait for it (see: litegripctl jobs), cancel it (litegripctl cancel JOB) or stop",
        ),
        (
            "wait for it ({lease.acquire with wait_s}), or take it over ({lease.take})",
            "wait for it (see: litegripctl lease), or take it over (litegripctl lease take REASON)",
        ),
        ("no 'x'; {trajectory.list} tells which", "no 'x'; litegripctl trajectories tells which"),
        ("motion.move and /a/stop.clear.json", "motion.move and /a/stop.clear.json"),
    ],
)
def test_remedies_are_commands_and_not_the_protocols_methods(
    daemon: FakeDaemon, ctl: Ctl, template: str, shown: str
) -> None:
    told = sentence(template)
    daemon.handlers["state.get"] = lambda request: request.fail("x", -1, "no", hint=told)
    assert ctl("state")[2] == f"litegripctl: no\n  {shown}\n"
    daemon.handlers["state.get"] = lambda request: request.fail("x", -1, told, hint="do so")
    assert ctl("state")[2] == f"litegripctl: {shown}\n  do so\n"
    assert json.loads(ctl("--json", "state")[1])["error"]["message"] == shown


def test_json_has_the_hint_too(ctl: Ctl) -> None:
    code, out, _ = ctl("--json", "zero")
    hint = "if that is safe: litegripctl zero --yes"
    assert (code, json.loads(out)["error"]["data"]["hint"]) == (2, hint)


@pytest.mark.parametrize(
    ("line", "meant"),
    [
        ("stae", "COMMAND: 'stae' is none of them; did you mean 'state'?"),
        ("lease tke", "ACTION: 'tke' is none of them; did you mean 'take'?"),
        ("lease x", "ACTION: 'x' is none of them: show, take"),
        ("xyzzy", "COMMAND: 'xyzzy' is none of them\n"),
        ("grasp --forse 10", "unrecognized arguments: --forse 10; did you mean '--force'?"),
        ("grasp --forse=10", "; did you mean '--force'?"),
        ("state --jsn", "; did you mean '--json'?"),
        ("state xyzzy", "unrecognized arguments: xyzzy\n"),
        ("stop --level relx", "did you mean 'relax'?"),
    ],
)
def test_what_comes_close_is_proposed(ctl: Ctl, line: str, meant: str) -> None:
    code, _, err = ctl(*line.split())
    assert code == 2
    assert meant in err
    assert "choose from" not in err


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("cancel abc", "'abc' is not a whole number of 1 or more"),
        ("grasp --width 48 --tolerance -1", "'-1' is not a number of 0 or more"),
        ("grasp --hold nan", "'nan' is not a number of 0 or more"),
        ("grasp --width 0 --tolerance 1", "'0' is not a number above 0"),
    ],
)
def test_a_wrong_value_is_met_with_what_is_allowed(ctl: Ctl, line: str, wrong: str) -> None:
    code, _, error = ctl(*line.split())
    assert code == 2
    assert wrong in error


def test_what_the_daemon_takes_as_zero_the_shell_takes_too(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["motion.grasp"] = lambda request: request.fail("busy", -32020, "later")
    ctl("grasp", "--width", "48", "--tolerance", "0", "--hold", "0")
    [request] = [asked for asked in daemon.requests if asked.method == "motion.grasp"]
    assert (request.params["tolerance_mm"], request.params["hold_s"]) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("line", "helps"),
    [
        ("grasp --force x", "litegripctl grasp"),
        ("grasp --width 4", "litegripctl grasp"),
        ("grasp --no-such-option", "litegripctl grasp"),
        ("teleop slave --no-such-option", "litegripctl teleop slave"),
        ("calibration load", "litegripctl calibration load"),
        ("nothing", "litegripctl"),
    ],
)
def test_wrong_usage_points_to_the_help_of_its_command(ctl: Ctl, line: str, helps: str) -> None:
    code, _, err = ctl(*line.split())
    assert (code, err.splitlines()[-1]) == (2, f"  see: {helps} --help")


def test_a_refused_value_points_to_the_help_of_its_command(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["motion.grasp"] = lambda request: request.fail("out_of_limits", -32011, "60")
    assert ctl("grasp", "--force", "60")[2].splitlines()[-1] == "  see: litegripctl grasp --help"


def refuse(request: Request) -> None:
    text = sentence("the motor is not enabled ({motor.enable})")
    request.fail("not_enabled", -32030, text)


def test_a_remedy_is_for_the_gripper_that_was_named(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]
) -> None:
    """Typed as printed, it must not enable, or stop, another gripper."""
    daemon.handlers["motion.open"] = refuse
    assert main(["--socket", daemon.path, "open"]) == 5
    ctl = f"litegripctl --socket {daemon.path}"
    told = f"litegripctl: the motor is not enabled ({ctl} enable)"
    assert capsys.readouterr().err.splitlines()[0] == told
