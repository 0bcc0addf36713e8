"""Texts of the daemon in the words of the program's own user, by the constructor's `voice`."""

import os
import pwd
from typing import Any, NoReturn

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    LiteGrip,
    NotPermittedError,
    ParameterError,
    SetpointStream,
    StoppedError,
)
from litegripd.model.sentence import method_name, sentence, with_terms
from tests.client.rig import Heard, Kind, Refuse, run_ctl

WORDS = {"stop.clear": "~/clear", "lease.take": "the button TAKE", "motor.enable": "~/enable"}


def ros(method: str | None, parameter: str | None, _asked: str | None) -> str | None:
    """Name services, as an integration does."""
    return f"the field {parameter}" if method is None else WORDS.get(method)


def keep_sending(stream: SetpointStream, kind: Kind) -> None:
    for _ in range(9):
        stream.set_target(50.0)
        kind.pause(0.02)


def test_errors_name_what_the_programs_user_can_do(daemon: Heard, kind: Kind) -> None:
    daemon.client().result("stop", why="look at stop.clear")
    with kind.gripper(voice=ros) as gripper, pytest.raises(StoppedError) as caught:
        gripper.enable()
    assert "look at stop.clear; clear it with ~/clear first" in str(caught.value)
    assert caught.value.hint == "~/clear"


def test_the_refusals_of_a_stream_do_as_well(daemon: Heard, kind: Kind) -> None:
    with kind.gripper(voice=ros) as gripper:
        gripper.enable()
        with gripper.stream() as stream:
            stream.set_target(50.0)
            daemon.client().result("stop")
            with pytest.raises(StoppedError):
                keep_sending(stream, kind)
            with pytest.raises(StoppedError, match="clear it with ~/clear first"):
                stream.set_target(50.0)


def test_what_it_has_no_word_for_is_named_as_in_the_protocol(daemon: Heard, kind: Kind) -> None:
    with kind.gripper() as owner, kind.gripper(voice=ros) as gripper:
        owner.enable()
        with pytest.raises(BusyError) as caught:
            gripper.open()
    assert "the button TAKE" in caught.value.message
    assert "gripper." not in str(caught.value)
    assert "lease.acquire" in caught.value.message


def test_parameters_are_named_by_it(gripper: LiteGrip, kind: Kind) -> None:
    with kind.gripper(voice=ros) as speaking, pytest.raises(CommandError) as caught:
        speaking.grasp(400.0)
    assert caught.value.message.startswith("the field force_n is 400")
    with pytest.raises(CommandError) as caught:
        gripper.grasp(400.0)
    assert caught.value.message.startswith("force_n is 400")


def test_results_and_health_are_told_in_it(daemon: Heard, kind: Kind) -> None:
    message = method_name("motor.enable")
    told: dict[str, Any] = {"reason": "enable_failed", "message": message}
    failed = {"ok": False, "tries": 3, "state": daemon.wire_state, **told}
    daemon.instead["motor.enable"] = with_terms(failed)
    daemon.instead["health"] = with_terms({"verdict": "degraded", "reasons": [message]})
    with kind.gripper(voice=ros) as gripper:
        assert gripper.enable().message == "~/enable"
        assert gripper.health()["reasons"] == ["~/enable"]
    with kind.gripper() as gripper:
        assert gripper.health()["reasons"] == [f"{kind.awaits}gripper.enable()"]


def test_events_are_told_in_it(daemon: Heard, kind: Kind) -> None:
    message = sentence("it stands: {stop.clear}")
    one = with_terms({"seq": 1, "monotonic_s": 1.0, "kind": "pressing", "message": message})
    subscribed = {"subscription": 5, "state": daemon.wire_state, "events": [one]}
    daemon.instead["events.subscribe"] = subscribed
    daemon.instead["events.unsubscribe"] = {"subscription": 5}
    with kind.gripper(voice=ros) as gripper, gripper.events() as events:
        assert events.recent[-1].message == "it stands: ~/clear"


async def awaited(_method: str | None, _parameter: str | None, _asked: str | None) -> str | None:
    return None


@pytest.mark.parametrize(
    ("voice", "told"),
    [
        ("ros", "voice is 'ros', it must be a function of a method, a parameter and the method"),
        ("", "voice is '', it must be a function"),
        (awaited, "voice is an async function, it must be a plain one"),
        (lambda _method: None, "voice must be a function .* asked: too many positional arguments"),
    ],
)
def test_a_voice_that_cannot_speak_is_refused(kind: Kind, voice: Any, told: str) -> None:
    with pytest.raises(ParameterError, match=f"^{told}"):
        kind.gripper(voice=voice)


def fails(method: str | None, parameter: str | None, _asked: str | None) -> str | None:
    raise TypeError(f"no words for {method or parameter}")


@pytest.mark.parametrize(
    ("voice", "wrong"),
    [
        (fails, "has raised TypeError: no words for stop.clear"),
        (lambda *_: 3, "has returned 3, which is no text"),
    ],
)
def test_a_voice_that_fails_leaves_the_error_and_is_told_once(
    daemon: Heard, kind: Kind, voice: Any, wrong: str, caplog: pytest.LogCaptureFixture
) -> None:
    daemon.client().result("stop")
    with kind.gripper(voice=voice) as gripper:
        for call in (gripper.enable, gripper.open):
            with pytest.raises(StoppedError, match=r"clear it with stop\.clear first"):
                call()
    assert [record.getMessage() for record in caplog.records] == [
        f"voice('stop.clear', None, 'motor.enable') {wrong}; the protocol's name stays"
    ]


def test_a_hint_for_the_connection_is_told_in_it_before_the_daemon_is_known(
    daemon: Heard, kind: Kind
) -> None:
    daemon.instead["hello"] = Refuse("too_many", -32000, method_name("motor.enable"))
    with pytest.raises(Exception, match="~/enable"):
        kind.gripper(voice=ros).connect()


ME = f"{pwd.getpwuid(os.getuid()).pw_name} (uid {os.getuid()})"


@pytest.fixture
def observing(daemon: Heard, monkeypatch: pytest.MonkeyPatch) -> Heard:
    monkeypatch.setattr(daemon.service, "_role_of", lambda _peer: "observer")
    return daemon


def test_an_observer_is_told_who_may_do_more_and_who_opens_it(observing: Heard, kind: Kind) -> None:
    with kind.gripper() as gripper, pytest.raises(NotPermittedError) as caught:
        gripper.enable()
    assert observing.methods()[-1] == "lease.acquire"  # which the program has not called
    assert caught.value.message == (
        f"{ME} is an observer, who may read and stop; this needs an operator"
    )
    assert caught.value.hint == (
        f"an admin adds {ME.partition(' ')[0]} to operators in [access] of the daemon's"
        " configuration, then restarts the daemon"  # a simulated one, too
    )


def test_a_user_without_a_name_is_told_by_number(
    observing: Heard, kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nobody(uid: int) -> NoReturn:
        raise KeyError(uid)

    monkeypatch.setattr(pwd, "getpwuid", nobody)
    with kind.gripper() as gripper, pytest.raises(NotPermittedError) as caught:
        gripper.open()
    assert caught.value.message.startswith(f"uid {os.getuid()} is an observer, who may")
    assert str(caught.value.hint).startswith(f"an admin adds uid {os.getuid()} to operators in ")


def test_a_person_at_a_shell_is_told_the_same(
    observing: Heard, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, told = run_ctl(capsys)("enable")
    assert code == 9
    assert f"litegripctl: {ME} is an observer, who may read and stop; this needs" in told
    assert "to operators in [access] of" in told
    assert "--help" not in told
    assert observing.methods()
