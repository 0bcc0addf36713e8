"""What one gripper's machine says is read to the last member, and spoils nothing but its row."""

import asyncio
import json
from argparse import Namespace
from typing import Any

import pytest

from litegrip_fleet.admin import main as program
from litegrip_fleet.wire import site
from litegrip_fleet.wire.foreign import facts_in, stop_problem
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.network import Answered

LEFT, RIGHT = Place("lab", "left"), Place("lab", "right")
FACTS = {"version": "0.1.0", "verdict": "ok", "mode": "idle", "age_s": 0.004, "owner": None}
STOPPED = b'{"jsonrpc":"2.0","id":1,"result":{"level":"hold","generation":1}}\n'
DEEP = b"[" * 60_000
SESSION: Any = object()

NO_CONFIRMATIONS = (
    DEEP,
    b'"result"',
    b'["result"]',
    b'{"result":null}',
    b'{"result":{}}',
    b'{"result":{"level":"later"}}',
    b'{"result":{"level":["hold"]}}',
    b'{"result":{"level":"hold","generation":1,"motor":"silent"}}',
    b'{"result":{"level":"hold"},"error":{"message":"no"}}',
    b'{"error":{"message":7}}',
    b'{"error":[]}',
    b"\xff",
    b"",
)


@pytest.mark.parametrize("payload", NO_CONFIRMATIONS, ids=range(len(NO_CONFIRMATIONS)))
def test_nothing_but_a_level_that_is_in_force_confirms_a_stop(payload: bytes) -> None:
    assert stop_problem(payload)
    assert stop_problem(STOPPED) is None


WRONG: tuple[tuple[str, object], ...] = (
    *((name, 7) for name in ("version", "gateway", "verdict", "mode", "owner", "error")),
    *(("age_s", value) for value in ("now", True, [0.1], float("nan"), 1e300)),
    *(("silent", value) for value in ("op1", {"op1": 1}, [7])),
    *(("kept_out", value) for value in ("2", True, -1, 10**9, 0.5, None)),
    ("version", {"a": {"b": [[[]]]}}),
)


@pytest.mark.parametrize(("name", "value"), WRONG, ids=str)
def test_a_member_of_another_type_is_an_error_of_its_row(name: str, value: object) -> None:
    facts = facts_in(json.dumps({**FACTS, name: value}).encode())
    assert list(facts) == ["error"]
    assert f"wrong {name}" in facts["error"]


@pytest.mark.parametrize("payload", [DEEP, b"[]", b"7", b"", b"{}", b'{"owner":"x"}'])
def test_what_is_no_answer_is_an_error_of_its_row(payload: bytes) -> None:
    assert list(facts_in(payload)) == ["error"]


def test_what_is_known_is_told_and_nothing_else() -> None:
    more = {"gripper": "lab.right", "after_s": 0.0, "silent": ["op1"], "gateway": "0.2.0"}
    told = facts_in(json.dumps({**FACTS, **more}).encode())
    assert told == {**FACTS, "silent": ["op1"], "gateway": "0.2.0"}


ESCAPE = "ok\x1b[2J\rlab.right: stopped (1 ms)\n" + "x" * 100_000


def found(monkeypatch: pytest.MonkeyPatch, payloads: dict[Place, bytes]) -> list[site.About]:
    """Return what a look at the site finds where the grippers answer with these."""

    async def ask(*_arguments: object, **_options: object) -> list[Answered]:
        return [Answered(place.about, said, None, 0.0) for place, said in payloads.items()]

    monkeypatch.setattr(site, "ask", ask)
    monkeypatch.setattr(site, "alive", lambda *_: list(payloads))
    return asyncio.run(site.look(SESSION, "lab"))


@pytest.mark.parametrize("bad", [DEEP, json.dumps({**FACTS, "age_s": "soon"}).encode()])
def test_a_list_shows_the_others_as_they_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], bad: bytes
) -> None:
    program._print_table(found(monkeypatch, {LEFT: bad, RIGHT: json.dumps(FACTS).encode()}))
    rows = capsys.readouterr().out.splitlines()
    assert rows[1].startswith("lab.left")
    assert rows[1].split()[1:2] == ["an"]
    assert rows[2].split()[:4] == ["lab.right", "0.1.0", "ok", "idle"]


@pytest.mark.parametrize("name", ["version", "verdict", "mode", "owner", "error"])
def test_no_text_leaves_its_row_or_reaches_the_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    said = json.dumps({**FACTS, name: ESCAPE, "silent": [ESCAPE]}).encode()
    program._print_table(found(monkeypatch, {LEFT: said}))
    out = capsys.readouterr().out
    assert out.replace("\n", "").isprintable()
    assert len(out.splitlines()) == 3  # the head, who is silent, and the gripper
    assert max(map(len, out.splitlines())) < 500


def test_a_stop_of_a_site_is_reported_of_each_gripper(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = 0

    async def ask(*_arguments: object, **_options: object) -> list[Answered]:
        nonlocal asked
        asked += 1
        refused = json.dumps({"error": {"message": ESCAPE}}).encode()
        said = {LEFT: DEEP, RIGHT: STOPPED, Place("lab", "third"): refused}
        return [Answered(place.stop("op1"), one, None, 0.0) for place, one in said.items()]

    monkeypatch.setattr(site, "ask", ask)
    monkeypatch.setattr(site, "STOP_WITHIN_S", 0.2)
    stopped = asyncio.run(site.stop_all(SESSION, "lab", "op1", [LEFT, RIGHT], b"hold\n"))
    assert program._report(stopped, Namespace(json=False)) == 1
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(":")[0] for row in rows] == ["lab.right", "lab.left", "lab.third"]
    assert rows[0].startswith("lab.right: stopped (")
    assert all("NOT confirmed" in row and row.isprintable() for row in rows[1:])
    assert asked > 1  # who has not confirmed it is asked again
