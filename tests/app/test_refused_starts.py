"""What `litegripd` refuses before it is a daemon: wrong usage, and configurations with a mistake.

How such a process ends, with its line in the journal, is tried in tests/process/test_hardware.py.
"""

import faulthandler
import logging
from pathlib import Path

import pytest

from litegripd.app.main import EXIT_USAGE, main


@pytest.fixture(autouse=True)
def _left_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """The program sets up its process, which is not to be this one."""
    monkeypatch.setattr(faulthandler, "enable", lambda: None)
    monkeypatch.setattr(logging.getLogger("can"), "level", logging.NOTSET)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "the following arguments are required: channel"),
        (("../x",), "'../x'"),
        (("can0.stop",), "can0.stop"),
        (("typo0", "--simulat"), "--simulat"),
    ],
)
def test_wrong_usage_is_told(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], told: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == EXIT_USAGE
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "cannot be read: No such file"),
        ("[motor]\ncan_id = 0x800\n", "[motor] can_id"),
        ("[control]\nrate = 200\n", "[control] rate is unknown"),
        ("[rpc\n", "not valid TOML"),
        (
            '[access]\nadmins = ["@no-such-group"]\n',
            "[access] admins: there is no group 'no-such-group'; allowed",
        ),
    ],
)
def test_a_configuration_error_is_told_with_its_file(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, content: str | None, told: str
) -> None:
    path = tmp_path / "wrong.toml"
    if content is not None:
        path.write_text(content, encoding="utf-8")
    assert main(["can0", "--config", str(path)]) == EXIT_USAGE
    assert told in caplog.text
    assert str(path) in caplog.text
    assert "Traceback" not in caplog.text
