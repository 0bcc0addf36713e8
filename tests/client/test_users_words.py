"""What users have said comes back as they said it, by every way, also if it looks like a name.

A stop's reason, a lease's purpose, the reason of a take-over and a program's own name go to a whole
daemon in virtual time, and come back by the client and by `litegripctl`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given

from litegrip_client.line.feeds import Event
from litegrip_client.threads.blocking import connect
from litegrip_client.values.errors import LiteGripError, from_error_object
from litegrip_client.values.terms import Voice, told
from litegrip_client.values.voices import in_python, in_shell
from litegripd.control import events
from litegripd.model.sentence import sentence, with_terms
from tests.client.helpers import Ctl
from tests.client.rig import Bench, Heard, Refuse
from tests.properties import examples
from tests.users_words import any_words
from tests.world import World

WORST = "motion.move {stop.clear} /data/force_n.csv: force_n calibration.zero with a mount"
"""Of a person who writes what a program may say."""


class Scene:
    """A lease that was taken over while its motion ran, and then a stop; `words` are everywhere."""

    def __init__(self, words: str, world: World | None = None) -> None:
        self.words = words
        self.world = World() if world is None else world
        self.loser = self.world.enabled()
        self.taker, self.watcher = self.world.client(), self.world.client()
        for client in (self.loser, self.taker):
            client.result("hello", client=words)
        self.loser.result("lease.acquire", purpose=words)
        self.held = self.taker.call("motion.open")["error"]
        self.job = self.loser.result("motion.close", wait=False, detach=True)["job"]
        self.world.run(0.05)
        self.taker.result("lease.take", why=words, purpose=words)
        self.lost = self.loser.call("motion.open")["error"]
        self.running = self.taker.result("motion.close", wait=False, detach=True)["job"]
        self.world.run(0.05)
        self.taker.result("stop", why=words)
        self.stopped = self.taker.call("motion.open")["error"]
        self.world.run(0.05)

    def errors(self) -> Iterator[dict[str, Any]]:
        yield from (self.held, self.lost, self.stopped)
        for job in (self.job, self.running):
            yield self.watcher.result("job.get", job=job)["error"]

    def events(self, *kinds: str) -> list[dict[str, Any]]:
        told: list[dict[str, Any]] = self.watcher.result("events.subscribe", kinds=kinds)["events"]
        return told


WORLD = World()
VOICES = pytest.mark.parametrize("voice", [in_python, in_shell])
KINDS = ("lease", "lease_lost", "stop", "refused")


@VOICES
@given(words=any_words())
@examples(15)
def test_by_the_client(voice: Voice, words: str) -> None:
    scene = Scene(words)
    for error in scene.errors():
        assert words in from_error_object(error, "motion.open", voice).message
    stopped = from_error_object(scene.stopped, "motion.open", voice)
    call = voice("stop.clear", None, None)
    assert stopped.message.endswith(f" is latched: {words}; clear it with {call} first")
    assert stopped.hint == call
    history = scene.events(*KINDS)
    assert {event["kind"] for event in history} == set(KINDS)
    for event in history:
        assert words in Event.from_wire(event, voice).message
    state = scene.watcher.result("state.get")
    assert state["stop"]["why"] == words
    assert scene.watcher.result("lease.get")["owner"]["purpose"] == words
    (lost,) = [said for said in scene.loser.notifications if said["method"] == "lease.lost"]
    assert (lost["params"]["why"], lost["params"]["by"]["program"]) == (words, words)


@VOICES
@given(words=any_words())
@examples(60)
def test_a_path_beside_a_name(voice: Voice, words: str) -> None:
    doubt = sentence("measure again ({calibration.zero})")
    calibration = WORLD.controller.calibrated.calibration
    assert calibration is not None
    event = events.calibrated(calibration, words, [doubt])
    text = told(with_terms({"message": event.message}), "message", voice)
    assert text.startswith(f"calibration {words}: mount ")
    assert text.endswith(f"; measure again ({voice('calibration.zero', None, None)})")


COMMANDS = (
    *("state", "open", "lease", "clients", "jobs", "events"),
    *("--json state", "--json open", "--json jobs", "--json events", "--json lease"),
)


COMMAND = "litegripctl clear, litegripctl open"
"""Of a person who tells others what to type."""


@pytest.mark.parametrize("channel", ["", "-c can0 "])
@pytest.mark.parametrize(
    "words", [WORST, COMMAND, "{0} {} %s force_n", "clear it with stop.clear first"]
)
def test_by_litegripctl(
    site: Bench, heard: Heard, litegripctl: Ctl, words: str, channel: str
) -> None:
    scene = Scene(words, heard)
    site.now_s = heard.now_s
    for command in (*COMMANDS, f"job {scene.job}", f"job {scene.running}"):
        _, out, err = litegripctl(*channel.split(), *command.split())
        assert words in out + err, command


@pytest.mark.parametrize(("command", "own"), [("state", "clear"), ("open", "lease")])
def test_only_the_program_s_own_commands_name_the_gripper(
    site: Bench, heard: Heard, litegripctl: Ctl, command: str, own: str
) -> None:
    Scene(COMMAND, heard)
    site.now_s = heard.now_s
    _, out, err = litegripctl("-c", "can0", command)
    said = (out + err).replace(COMMAND, "")
    assert f"litegripctl -c can0 {own}" in said
    assert said.count("litegripctl -c can0 ") == said.count("litegripctl ") >= 1


def test_the_doctor_and_the_health_tell_a_reason_as_it_is(heard: Heard, litegripctl: Ctl) -> None:
    reasons = [sentence("{why}: {motor.clear_fault}", why=WORST), WORST]
    heard.instead["health"] = with_terms({"verdict": "down", "reasons": reasons, "notes": [WORST]})
    for command, call in (("health", "litegripctl"), ("doctor", "litegripctl -c can0")):
        out = litegripctl(command)[1]
        assert f"{WORST}: {call} clear-fault" in out
        assert out.count(WORST) >= 2


def test_by_a_subscription_to_events(heard: Heard) -> None:
    Scene(WORST, heard)
    message = sentence("{why}: {stop.clear}", why=WORST)
    one = with_terms({"seq": 1, "monotonic_s": 1.0, "kind": "pressing", "message": message})
    with connect("can0") as connection:
        with connection.subscribe_events() as feed:
            (told,) = [event.message for event in feed.recent if event.kind == "stop"]
        assert told.endswith(f": {WORST}")
        heard.instead["events.subscribe"] = {"subscription": 9, "state": {}, "events": [one]}
        heard.instead["events.unsubscribe"] = {"subscription": 9}
        with connection.subscribe_events() as feed:
            assert feed.recent[-1].message == f"{WORST}: gripper.clear_stop()"


def test_an_older_daemon_marks_nothing_and_its_sentence_stays(heard: Heard) -> None:
    text = "a stop is latched: motion.move; clear it with stop.clear first"
    heard.instead["motion.open"] = Refuse("stopped", -32021, text, hint="stop.clear")
    with connect("can0") as connection, pytest.raises(LiteGripError) as caught:
        connection.call("motion.open")
    assert str(caught.value) == text
