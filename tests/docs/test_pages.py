"""The pages: their links, the commands and names that they tell, and the code that they show."""

import re
import shlex
from pathlib import Path
from typing import get_args

import pytest

import litegrip_client
from docs.generate import GENERATED, page_motions
from litegrip_client.ctl.commands import COMMANDS
from litegrip_client.ctl.parser import parse
from litegripd.model.errors import ERROR_TABLE
from litegripd.model.motor import Status, status_name
from litegripd.model.state import GraspOutcome, MoveOutcome

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path
    for path in (*ROOT.glob("*.md"), *ROOT.glob("[!.]*/**/*.md"))
    if not {"node_modules", "build"} & set(path.parts)
)
NAMES = [str(path.relative_to(ROOT)) for path in PAGES]
AWAITED: set[str] = set()
"""Pages that may be linked before they are here."""

LINK = re.compile(r"\[[^]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def prose_of(name: str) -> str:
    return FENCE.sub("", text_of(name))


def anchors_of(name: str) -> set[str]:
    """Return what `#...` of a link may be: headings, as GitHub writes them."""
    heads = re.findall(r"^#+ (.+)$", prose_of(name), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", head.replace("`", "").lower()) for head in heads)
    return {head.replace(" ", "-") for head in plain}


def commands_of(name: str) -> list[str]:
    """Return every line for a shell that begins with `litegripctl`, in fences and between ticks."""
    fenced = [
        line.strip() for _, _, body in FENCE.findall(text_of(name)) for line in body.split("\n")
    ]
    ticked = re.findall(r"`(litegripctl [^`]+)`", prose_of(name).replace("\n", " "))
    lines = [part.strip() for line in (*fenced, *ticked) for part in re.split(r"&&|\|", line)]
    return [line for line in lines if line.startswith("litegripctl ")]


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str) -> None:
    for target in LINK.findall(prose_of(name)):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (ROOT / name).parent / path if path else ROOT / name
        if file.name in AWAITED:
            continue
        assert file.exists(), target
        if anchor:
            assert anchor in anchors_of(str(file.resolve().relative_to(ROOT))), target


@pytest.mark.parametrize("name", NAMES)
def test_commands_are_ones_that_litegripctl_takes(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for line in commands_of(name):
        words = shlex.split(line.removesuffix(" &"), comments=True)[1:]
        if {"...", "COMMAND"} & set(words):
            continue
        is_name = len(words) == 1  # the name of a command, in a sentence
        try:
            parse([*words, "--help"] if is_name else words, COMMANDS)
        except SystemExit as ended:
            if ended.code != 0:
                pytest.fail(f"{line}: {capsys.readouterr().err}")


@pytest.mark.parametrize("name", [name for name in NAMES if name != "CHANGELOG.md"])
def test_source_files_are_there(name: str) -> None:
    places = [ROOT, *(ROOT / package for package in ("litegripd", "litegrip_client", "docs"))]
    for path in re.findall(r"`((?:\w+/)+\w+\.py)(?:::\w+)?`", text_of(name)):
        assert any((place / path).exists() for place in places), path


def test_there_are_commands_to_be_checked() -> None:
    assert sum(len(commands_of(name)) for name in NAMES) > 60


def test_code_that_is_shown_is_that_of_its_file() -> None:
    """A fence below `<!-- FILE -->` shows all of that file."""
    shown = [
        (name, file, body)
        for name in NAMES
        for file, body in re.findall(
            r"^<!-- (\S+) -->\n```\w*\n(.*?)^```$", text_of(name), re.MULTILINE | re.DOTALL
        )
    ]
    assert {"examples/clients/grasp.cpp", "examples/clients/grasp.js"} <= {
        file for _, file, _ in shown
    }
    for name, file, body in shown:
        assert text_of(file) == body, f"{file} in {name}"


def test_the_page_names_no_command_where_it_says_why_a_motion_failed() -> None:
    assert re.search(r"litegripctl|--\w", page_motions()) is None


MOST_WORDS = 1500
LONG = {
    "installation.md",  # its commands are typed in a virtual machine, one after the other
    "troubleshooting.md",  # most of it is the table of symptoms, which runs write
    "from-the-sdk.md",
}


def test_a_page_is_read_in_ten_minutes() -> None:
    """What is made from the code's tables is looked up in, not read."""
    made = {Path(generated.path).name for generated in GENERATED}
    long = {
        path.name
        for path in (ROOT / "docs").glob("*.md")
        if len(path.read_text(encoding="utf-8").split()) > MOST_WORDS
    }
    assert long - made <= LONG


def test_the_index_names_every_page() -> None:
    linked = {target.partition("#")[0] for target in LINK.findall(text_of("docs/README.md"))}
    pages = {path.name for path in (ROOT / "docs").glob("*.md")} - {"README.md"}
    assert pages <= linked


def test_the_tree_of_exceptions_has_each_one_below_what_catches_it() -> None:
    tree = next(body for _, _, body in FENCE.findall(text_of("docs/errors.md")))
    above: list[type] = []
    seen = set()
    for line in tree.rstrip("\n").split("\n"):
        name = line.split()[0]
        kind = getattr(litegrip_client, name)
        del above[(len(line) - len(line.lstrip())) // 4 :]
        assert all(issubclass(kind, other) for other in above), name
        above.append(kind)
        seen.add(name)
    raised = {
        name
        for name in litegrip_client.__all__
        if isinstance(kind := getattr(litegrip_client, name), type)
        and issubclass(kind, litegrip_client.LiteGripError)
    }
    assert seen == raised


def test_troubleshooting_knows_every_reason_that_a_user_can_mend() -> None:
    hardware, busy, stopped, not_permitted = 5, 6, 7, 9
    mended = {hardware, busy, stopped, not_permitted}
    page = text_of("docs/troubleshooting.md")
    for row in ERROR_TABLE:
        if row.exit_code in mended:
            assert f"`{row.reason}`" in page, row.reason


def test_troubleshooting_knows_every_fault_of_the_motor() -> None:
    page = text_of("docs/troubleshooting.md")
    faults = [status for status in Status if status >= Status.OVER_VOLTAGE]
    assert len(faults) == 7
    for status in faults:
        name = status_name(status).replace("_", " ")
        assert f"| {status:X} | {name} |" in page


def test_each_outcome_of_a_motion_has_its_meaning() -> None:
    page = text_of("docs/python-programs.md").partition("## Outcomes")[2].partition("\n## ")[0]
    told = re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)
    assert set(told) == {*get_args(MoveOutcome), *get_args(GraspOutcome)}
    assert len(told) == len(set(told))
