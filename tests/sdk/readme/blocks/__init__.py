"""The code blocks of the SDK's README, one file each, as they stand there.

They are the vendor's words (Apache-2.0), and not to be edited: that they run unchanged, but for the
import, is what the tests show. `teleop` has two halves, one for each of two machines.
"""

import shlex
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
THEIRS, OURS = "from litegrip import ", "from litegrip_client import "


def names() -> set[str]:
    return {path.stem for path in HERE.glob("*.txt")}


def source(name: str) -> str:
    """Return a block with its import changed, and nothing else."""
    return (HERE / f"{name}.txt").read_text(encoding="utf-8").replace(THEIRS, OURS)


def halves(name: str) -> tuple[str, str]:
    """Return what the block runs on the leader's machine, and what on the follower's."""
    text = source(name)
    leader, _, follower = text.partition("\n# Follower")
    return leader, text.splitlines()[0] + "\n# Follower" + follower


def run(code: str, **given: Any) -> dict[str, Any]:
    """Run code as a script of its own, which finds what is `given`; return its names."""
    names = {"__name__": "__main__", **given}
    exec(compile(code, "block", "exec"), names)
    return names


def arguments(name: str, program: str) -> list[list[str]]:
    """Return what each line for a shell gives to one of the SDK's example programs."""
    lines = (shlex.split(line, comments=True) for line in source(name).splitlines())
    return [words[2:] for words in lines if words[:2] == ["python3", program]]
