"""Files that were edited on another system: what cannot be seen is taken, or named."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from litegrip_client.values import calibration_files
from litegrip_client.values.errors import CommandError, TrajectoryFormatError
from litegrip_client.values.text import cause, hidden, text_of
from litegrip_client.values.trajectory_format import SAMPLE, check_length, parse_grips
from litegrip_fleet.admin.config import FleetConfigError
from litegrip_fleet.admin.config import load as load_fleet
from litegripd.app.config import ConfigError
from litegripd.app.config import load as load_config
from litegripd.io.helper.files import DATA, load_operation

CONFIG = '[bus]\ninterface = "socketcan"\nchannel = "can0"\n'
FLEET = '[network]\nsite = "lab"\n'
CALIBRATION = (DATA / "normal.json").read_text(encoding="utf-8")
GRIPS = '{\n "format": 1\n}\n'


def configuration(path: Path) -> str | None:
    try:
        load_config("can0", path)
    except ConfigError as error:
        return str(error)
    return None


def fleet(path: Path) -> str | None:
    try:
        load_fleet(str(path))
    except FleetConfigError as error:
        return str(error)
    return None


def calibration(path: Path) -> str | None:
    try:
        load_operation({"channel": "can0", "mount": str(path), "configured": True})
    except ValueError as error:
        return str(error)
    return None


def of_the_client(path: Path) -> str | None:
    try:
        calibration_files.read(path)
    except CommandError as error:
        return str(error)
    return None


def grips(path: Path) -> str | None:
    try:
        parse_grips(path.read_bytes())
    except TrajectoryFormatError as error:
        return str(error)
    return None


Read = Callable[[Path], str | None]

READERS: list[tuple[Read, str]] = [
    (configuration, CONFIG),
    (calibration, CALIBRATION),
    (of_the_client, CALIBRATION),
    (grips, GRIPS),
]
ALL = [*READERS, (fleet, FLEET)]


@pytest.mark.parametrize(("read", "text"), READERS)
def test_a_mark_of_the_encoding_and_other_line_ends_are_taken(
    tmp_path: Path, read: Read, text: str
) -> None:
    file = tmp_path / "edited"
    for content in (
        text.encode(),
        text.encode("utf-8-sig"),
        text.replace("\n", "\r\n").encode(),
        text.replace("\n", "\r\n").encode("utf-8-sig"),
    ):
        file.write_bytes(content)
        assert read(file) is None, content[:20]


@pytest.mark.parametrize(("read", "text"), ALL)
@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_another_encoding_is_named(tmp_path: Path, read: Read, text: str, encoding: str) -> None:
    file = tmp_path / "edited"
    file.write_bytes(text.encode(encoding))
    said = read(file)
    assert said is not None
    assert "it is in UTF-16" in said
    assert "save it as UTF-8" in said


@pytest.mark.parametrize(("read", "text"), ALL)
def test_a_byte_of_an_old_encoding_is_named_with_its_line(
    tmp_path: Path, read: Read, text: str
) -> None:
    file = tmp_path / "edited"
    lines = text.encode().splitlines(keepends=True)
    file.write_bytes(lines[0] + b"# gr\xfcn\n" + b"".join(lines[1:]))
    said = read(file)
    assert said is not None
    assert "byte 0xFC in line 2 is not UTF-8" in said


@pytest.mark.parametrize(("read", "text"), ALL)
@pytest.mark.parametrize(
    ("sign", "name"),
    [
        ("\u00a0", "a non-breaking space (U+00A0)"),
        ("\u200b", "a space without width (U+200B)"),
        ("\u201c", "a typographic quote (U+201C)"),
        ("\x0c", "a control character (0x0C)"),
    ],
)
def test_a_sign_that_nobody_sees_is_named_where_the_parser_stops(
    tmp_path: Path, read: Read, text: str, sign: str, name: str
) -> None:
    file = tmp_path / "edited"
    first, rest = text.split("\n", 1)
    file.write_text(f"{first}\n{sign}{rest}", encoding="utf-8")
    said = read(file)
    assert said is not None
    assert f"line 2 has {name}" in said


@pytest.mark.parametrize(("read", "text"), [(configuration, CONFIG), (fleet, FLEET)])
def test_a_sign_within_a_value_is_named_with_its_key(tmp_path: Path, read: Read, text: str) -> None:
    file = tmp_path / "edited"
    file.write_text(text.rstrip()[:-1] + '\u00a0"\n', encoding="utf-8")
    said = read(file)
    assert said is not None
    assert "<U+00A0>" in said
    assert "a non-breaking space" in said
    assert ("bus.channel" in said) or ("network.site" in said)


def test_a_lone_cr_is_named() -> None:
    assert "line 1 has a CR without LF" in cause("[bus]\rchannel = 1")
    assert cause("[bus]\r\nchannel = 1\r\n") == ""


def test_text_in_which_all_can_be_seen_has_no_such_cause() -> None:
    assert cause('{"a": "Größe", "b": 1}') == ""
    assert hidden({"a": ["Größe"], "b": {"c": "µ"}}) is None
    assert text_of("Größe".encode()) == "Größe"


def test_a_trajectory_that_was_copied_as_text_says_so() -> None:
    content = SAMPLE.pack(*[10.0] * 5) * 10
    with pytest.raises(TrajectoryFormatError, match="text mode: copy it in binary mode"):
        check_length(66 + len(content.replace(b"\0", b"\0\0")), 10)
    with pytest.raises(TrajectoryFormatError, match=r"cut off or something was added$"):
        check_length(66, 10)


def test_a_key_with_a_sign_that_nobody_sees_is_not_just_missing(tmp_path: Path) -> None:
    content = json.loads(CALIBRATION)
    content["zero_position_rad\u00a0"] = content.pop("zero_position_rad")
    file = tmp_path / "edited.json"
    file.write_text(json.dumps(content, ensure_ascii=False, indent=1), encoding="utf-8")
    said = calibration(file)
    assert said is not None
    assert "a non-breaking space (U+00A0)" in said
