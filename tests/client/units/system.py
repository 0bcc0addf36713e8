"""A system below a directory of its own, into which `install-units` installs."""

import json
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.ctl.main import main

PROGRAMS = "/opt/grippers/bin"
UNITS = "usr/local/lib/systemd/system"
UNIT = f"{UNITS}/litegripd@.service"
RULES = "usr/local/lib/udev/rules.d/85-litegrip.rules"
CONFIGURATION = "etc/litegripd/litegripd.toml"


class System:
    """What is installed, enabled and running below `root`; paths are relative to that."""

    def __init__(self, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.root = root
        self._capsys = capsys

    def ends(self, *words: str) -> tuple[int, dict[str, Any]]:
        """Run `install-units`; return its exit code and its answer in JSON."""
        code = main(["install-units", "--root", str(self.root), "--json", *words])
        answer: dict[str, Any] = json.loads(self._capsys.readouterr().out)
        return code, answer

    def run(self, *words: str) -> dict[str, Any]:
        """Run `install-units`, which must succeed; return its answer."""
        code, answer = self.ends(*words)
        assert code == 0, answer
        return answer

    def next(self, *words: str) -> list[str]:
        """Return the commands that `install-units` says come next."""
        commands: list[str] = self.run(*words)["next"]
        return commands

    def shows(self, *words: str) -> str:
        """Return what `install-units` shows a person."""
        assert main(["install-units", "--root", str(self.root), *words]) == 0
        return self._capsys.readouterr().out

    def put(self, *words: str) -> dict[str, str]:
        """Return what `install-units` does, by file."""
        done = self.run(*words)["files"]
        return {str(Path(one["path"]).relative_to(self.root)): one["what"] for one in done}

    def refusal(self, *words: str) -> tuple[str, str]:
        """Return the message and the hint with which `install-units` refuses."""
        code, answer = self.ends(*words)
        assert code != 0
        return answer["error"]["message"], answer["error"]["data"]["hint"]

    def read(self, path: str) -> str:
        return (self.root / path).read_text(encoding="utf-8")

    def write(self, path: str, content: str = "") -> Path:
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content, encoding="utf-8")
        return file

    def files(self) -> set[str]:
        """Return all that there are, links to nowhere left out."""
        found = (path for path in self.root.rglob("*") if path.is_file())
        return {str(path.relative_to(self.root)) for path in found}

    def enable(self, name: str, by: str = "litegripd.target") -> Path:
        """Have systemd start a unit with another one."""
        return self._link(f"etc/systemd/system/{by}.wants/{name}", f"/{UNIT}")

    def start(self, *names: str) -> None:
        """Have systemd note that these units run."""
        for name in names:
            self._link(f"run/systemd/units/invocation:{name}.service", "0123456789abcdef" * 2)

    def _link(self, path: str, target: str) -> Path:
        link = self.root / path
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(target)
        return link
