import json
from pathlib import Path

import pytest

from litegrip_client import CALIB_TEMPLATES, CommandError, list_templates
from litegrip_client.values import calibration_files as files
from litegripd.model.calibration import parse_calibration
from tests.client.fake_daemon import CONTENT

DAEMONS = Path(__file__).resolve().parents[2] / "litegripd/model/data"


def test_the_templates_are_the_daemons() -> None:
    assert list_templates() == ["normal", "reverse"] == list(CALIB_TEMPLATES)
    for name, path in CALIB_TEMPLATES.items():
        assert Path(path).read_bytes() == (DAEMONS / f"{name}.json").read_bytes()
        geometry = parse_calibration(Path(path).read_text(encoding="utf-8")).geometry
        assert geometry.mount == name


def test_the_list_of_templates_is_the_callers() -> None:
    list_templates().append("sideways")
    assert list_templates() == ["normal", "reverse"]


@pytest.mark.parametrize("name", ["Reverse", "", "sideways", 5, None, ["normal"]])
def test_another_mount_is_refused_with_the_valid_ones(name: object) -> None:
    with pytest.raises(CommandError, match="must be one of: normal, reverse") as caught:
        files.check_template(name)  # type: ignore[arg-type]
    assert caught.value.data["allowed"] == ["normal", "reverse"]


def test_a_template_is_known_by_its_path(tmp_path: Path) -> None:
    link = tmp_path / "link.json"
    link.symlink_to(CALIB_TEMPLATES["reverse"])
    assert files.template_at(CALIB_TEMPLATES["normal"]) == "normal"
    assert files.template_at(Path(CALIB_TEMPLATES["reverse"])) == "reverse"
    assert files.template_at(link) == "reverse"
    assert files.template_at(tmp_path / "normal.json") is None


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"{", "not valid JSON"),
        (b"\xff", "not UTF-8"),
        (b"[1]", "holds no JSON object"),
        (b"[" * 15_000, "not valid JSON"),
        (b'{"kp": 1e400}', "kp is 1e400, it must be a finite number"),
        (b" " * 16_001, "larger than 16000 bytes"),
    ],
)
def test_what_cannot_be_read_says_why(tmp_path: Path, content: bytes, why: str) -> None:
    path = tmp_path / "c.json"
    path.write_bytes(content)
    with pytest.raises(CommandError, match=f"{path} cannot be read: .*{why}") as caught:
        files.read(path)
    assert caught.value.reason == "calibration_unreadable"


def test_a_missing_file_that_is_named_as_a_mount_gets_a_hint() -> None:
    with pytest.raises(CommandError, match="No such file") as caught:
        files.read("reverse")
    assert 'load_calibration(template="reverse")' in str(caught.value)


@pytest.mark.parametrize("path", ["a\0b", 5, "~nobody-of-this-name/c.json"])
def test_what_is_no_path_is_refused(path: str) -> None:
    with pytest.raises(CommandError, match="cannot be the path of a calibration"):
        files.read(path)


def test_what_was_written_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "c.json"
    assert files.write(path, CONTENT) == str(path)
    assert files.read(path) == CONTENT
    assert list(path.parent.iterdir()) == [path]


def test_writing_keeps_what_others_wrote_there(tmp_path: Path, home: Path) -> None:
    path = home / "c.json"
    path.write_text(json.dumps({"kp": 50, "channel": "can9", "owner": "lab", "note": "old"}))
    (tmp_path / "link.json").symlink_to(path)
    files.write(tmp_path / "link.json", CONTENT)
    assert json.loads(path.read_text()) == {**CONTENT, "owner": "lab"}
    path.write_text("broken")
    files.write("~/c.json", CONTENT)
    assert json.loads(path.read_text()) == CONTENT


def test_what_cannot_be_written_says_so_and_leaves_nothing(tmp_path: Path) -> None:
    here = tmp_path / "here"
    (here / "directory").mkdir(parents=True)
    (here / "file").write_text("")
    with pytest.raises(CommandError, match="cannot be written") as caught:
        files.write(here / "file" / "c.json", CONTENT)
    assert caught.value.reason == "not_saved"
    with pytest.raises(CommandError, match="Is a directory"):
        files.write(here / "directory", CONTENT)
    assert sorted(path.name for path in here.iterdir()) == ["directory", "file"]


def test_a_template_is_never_written() -> None:
    for path in CALIB_TEMPLATES.values():
        with pytest.raises(CommandError, match="is not to be written"):
            files.write(path, CONTENT)
    test_the_templates_are_the_daemons()


# The user's own files


def store(home: Path, name: str, content: str) -> None:
    (home / ".litegrip").mkdir(exist_ok=True)
    (home / ".litegrip" / name).write_text(content)


def test_the_users_files_in_their_order(home: Path) -> None:
    assert list(files.own_files("can1")) == []
    store(home, "litegrip_calibration.json", '{"rad_to_mm": 70}')
    store(home, "can1_calibration.json", '{"channel": "can1"}')
    store(home, "can0_calibration.json", '{"channel": "can0"}')
    assert [content for _, content in files.own_files("can1")] == [
        {"channel": "can1"},
        {"rad_to_mm": 70},
    ]


def test_a_file_of_another_channel_is_passed_over_and_logged(
    home: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store(home, "litegrip_calibration.json", '{"channel": "can0"}')
    assert list(files.own_files("can1")) == []
    assert "litegrip_calibration.json is for channel 'can0'" in caplog.text


def test_a_broken_file_of_the_users_is_not_passed_over(home: Path) -> None:
    """What would be found in its place could be the other mount's."""
    store(home, "can1_calibration.json", "broken")
    store(home, "litegrip_calibration.json", json.dumps(CONTENT))
    with pytest.raises(CommandError, match="not valid JSON"):
        next(files.own_files("can1"))
