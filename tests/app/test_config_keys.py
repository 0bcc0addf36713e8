"""What the manual says of the configuration is what the configuration takes."""

from pathlib import Path

import pytest

from litegripd.app.config import _TYPES, load
from litegripd.app.config_keys import _MEANINGS, Key, keys

COMMENTED = Path(__file__).resolve().parents[2] / "etc/litegripd.toml"


def test_every_key_has_a_meaning() -> None:
    assert _MEANINGS.keys() == _TYPES.keys()
    assert [(key.table, key.name) for key in keys()] == list(_TYPES)


def test_the_commented_file_has_every_key() -> None:
    lines = [line.lstrip("# ") for line in COMMENTED.read_text(encoding="utf-8").splitlines()]
    for key in keys():
        assert [line for line in lines if line.startswith(f"{key.name} =")], key


@pytest.mark.parametrize("key", [key for key in keys() if key.default], ids=lambda key: key.name)
def test_a_default_is_what_is_taken_without_it(key: Key, tmp_path: Path) -> None:
    path = tmp_path / "can0.toml"
    path.write_text(f"[{key.table}]\n{key.name} = {key.default}\n", encoding="utf-8")
    given, default = load("can0", path), load("can0", None)
    assert getattr(given, key.table) == getattr(default, key.table)
