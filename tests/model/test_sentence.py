"""Sentences whose names are known: of a template, never of what users have said."""

import ast
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_client.values.voices import CALLS
from litegripd.app.build import METHODS
from litegripd.model.errors import Refusal
from litegripd.model.plain import PlainError, plain_of, value_of
from litegripd.model.sentence import (
    Sentence,
    Term,
    joined,
    method_name,
    parameter_name,
    read_sentence,
    sentence,
    with_terms,
)
from litegripd.rpc.method import methods_of
from litegripd.sim.methods import SimMethods
from tests.properties import examples
from tests.users_words import any_words

DAEMON = Path(__file__).parents[2] / "litegripd"
ROWS = {method.name: method for method in (*METHODS, *methods_of(SimMethods))}
DOTTED = {name for name in ROWS if "." in name}
TABLES = {"Param", "config_param", "Method", "ErrorKind"}
"""What describes the protocol is for readers of the protocol."""


def test_a_gap_with_a_dot_is_a_name_and_any_other_is_filled_in() -> None:
    made = sentence("{who}: {calibration.zero with a mount}, {.force_n} {n:.1f} {{}}", who="a", n=2)
    assert made == "a: calibration.zero with a mount, force_n 2.0 {}"
    assert made.terms == (Term(3, 32, "calibration.zero", "mount"), Term(34, 41, None, "force_n"))


@given(any_words(), any_words())
@examples(200)
def test_nothing_that_is_filled_in_is_read(one: str, other: str) -> None:
    made = sentence("{one}: {stop.clear}{other} {one!r}", one=one, other=other)
    assert made == f"{one}: stop.clear{other} {one!r}"
    assert [made[term.start : term.end] for term in made.terms] == ["stop.clear"]
    assert made.terms[0].start == len(one) + 2


@given(
    st.lists(
        st.one_of(
            any_words(), any_words().map(lambda text: sentence("{stop.clear} {text}", text=text))
        )
    )
)
@examples(100)
def test_sentences_in_a_row_keep_their_names(texts: list[str]) -> None:
    row = joined("; ", texts)
    assert row == "; ".join(texts)
    assert {row[term.start : term.end] for term in row.terms} <= {"stop.clear"}
    assert len(row.terms) == sum(isinstance(text, Sentence) for text in texts)
    assert sentence("{row}", row=row).terms == row.terms


def test_a_list_has_the_terms_of_each_of_its_texts() -> None:
    members = with_terms({"reasons": [method_name("health"), "health"], "notes": ["health"]})
    term = {"start": 0, "end": 6, "method": "health", "parameter": None}
    assert members == {
        "reasons": ["health"] * 2,
        "notes": ["health"],
        "terms": {"reasons": [[term], []]},
    }
    assert with_terms({"message": "stop.clear"}) == {"message": "stop.clear"}


def test_it_reaches_a_successor_and_comes_from_the_helper_with_its_names() -> None:
    refusal = Refusal(
        "busy", sentence("end it: {stop.clear}"), {"hint": parameter_name("hz"), "n": 1}
    )
    back = value_of(json.loads(json.dumps(plain_of(refusal))), Refusal, "")
    assert back == refusal
    assert isinstance(refusal.message, Sentence)
    assert isinstance(back.message, Sentence)
    assert back.message.terms == refusal.message.terms
    assert with_terms(back.data)["terms"] == with_terms(refusal.data)["terms"]
    with pytest.raises(PlainError):
        value_of({"is": "Sentence", "text": 3, "terms": []}, Sentence, "")
    told = json.loads(json.dumps(with_terms({"message": refusal.message})))
    assert read_sentence(told["message"], told["terms"]["message"]).terms == back.message.terms
    assert read_sentence("stop.clear", None).terms == ()


# What the daemon says


@cache
def calls() -> tuple[tuple[str, ast.Call], ...]:
    """Return each sentence of the daemon's sources, and where it stands."""
    return tuple(
        (f"{path.relative_to(DAEMON)}:{node.lineno}", node)
        for path in sorted(DAEMON.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "sentence"
    )


def terms() -> Iterator[tuple[str, Term]]:
    for place, call in calls():
        values = {str(keyword.arg): Anything() for keyword in call.keywords}
        template = call.args[0]
        assert isinstance(template, ast.Constant), place
        for term in sentence(str(template.value), **values).terms:
            yield place, term


UNNAMED = {"teleop.receive", "trajectory.get", "trajectory.put", "trajectory.control"}
"""Methods that no call and no command does alone."""


class Anything:
    """A value of any form."""

    def __format__(self, _form: str) -> str:
        return "x"


def test_every_template_is_written_out() -> None:
    """Else a user's words could be in it."""
    assert len(calls()) > 50
    assert [place for place, call in calls() if not isinstance(call.args[0], ast.Constant)] == []


def test_every_name_is_one_of_the_protocol_and_every_voice_knows_it() -> None:
    declared = {name for row in ROWS.values() for name in row.declared}
    for place, term in terms():
        if term.method is None:
            assert term.parameter in declared, place
            continue
        assert term.method in {*CALLS, *UNNAMED}, place
        assert term.parameter is None or term.parameter in ROWS[term.method].declared, place


def is_called(node: ast.AST, *names: str) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in names


def plain_texts(tree: ast.Module) -> Iterator[str]:
    """Return the texts of a module that are neither templates nor descriptions."""
    left_out: set[int] = set()
    for node in ast.walk(tree):
        if is_called(node, *TABLES):
            left_out |= {id(inner) for inner in ast.walk(node)}
        elif is_called(node, "sentence"):
            left_out.add(id(node.args[0]))  # type: ignore[attr-defined]
        elif isinstance(node, ast.Expr):  # documentation
            left_out.add(id(node.value))
    for node in ast.walk(tree):
        is_told = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_told and id(node) not in left_out:
            yield node.value  # type: ignore[attr-defined]


NAMED = re.compile(rf"(?<![\w./])({'|'.join(map(re.escape, sorted(DOTTED)))})(?!\w|\.\w)")


@pytest.mark.parametrize(
    "path", sorted(DAEMON.rglob("*.py")), ids=lambda path: str(path.relative_to(DAEMON))
)
def test_no_other_text_names_a_method(path: Path) -> None:
    if path == DAEMON / "rpc" / "openrpc.py":
        return  # it describes the protocol
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for text in plain_texts(tree):
        assert NAMED.fullmatch(text) or not NAMED.search(text)
    for node in ast.walk(tree):
        rows = zip(node.keys, node.values, strict=True) if isinstance(node, ast.Dict) else ()
        for key, value in rows:
            if isinstance(key, ast.Constant) and key.value == "hint":
                assert not isinstance(value, ast.Constant), ast.unparse(value)
