"""Every block of Python in the pages is run, on a whole daemon in virtual time."""

import re
from pathlib import Path

import pytest

from litegrip_client import LiteGrip
from tests.docs.test_pages import NAMES, text_of
from tests.drop_in import Daemon, Site, a_site
from tests.sdk.readme import blocks

BLOCKS = [
    (name, code)
    for name in NAMES
    # These blocks need daemons of their own: tests/process/test_testing.py, test_two_grippers.py,
    # test_python_programs.py.
    if name not in ("docs/simulator.md", "docs/two-grippers.md", "docs/python-programs.md")
    for code in re.findall(r"^```python\n(.*?)^```$", text_of(name), re.MULTILINE | re.DOTALL)
]


def interrupt() -> None:
    raise KeyboardInterrupt


def run(site: Site, code: str) -> None:
    """Run a script, or parts that are given a gripper; what goes on for ever is interrupted."""
    if "with LiteGrip(" in code and "for state in" in code:
        site.after(5.0, interrupt)
        with pytest.raises(KeyboardInterrupt):
            blocks.run(code)
        return
    if "with LiteGrip(" in code:
        blocks.run(code)
        return
    with LiteGrip("can0") as gripper:
        gripper.enable()
        for part in code.split("\n\n"):
            site.after(5.0, interrupt)
            with pytest.raises(KeyboardInterrupt):
                blocks.run(part, gripper=gripper)


def test_there_are_blocks() -> None:
    assert [name for name, _ in BLOCKS].count("README.md") == 1
    assert [name for name, _ in BLOCKS].count("docs/python.md") == 5
    assert [name for name, _ in BLOCKS].count("docs/python-loops.md") == 3
    assert [name for name, _ in BLOCKS].count("docs/tutorial.md") == 1


@pytest.mark.parametrize(("name", "code"), BLOCKS, ids=[name for name, _ in BLOCKS])
def test_it_runs(name: str, code: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with a_site(tmp_path) as site:
        daemon = site.add(Daemon())
        if "zero()" not in code:  # which needs a free way
            daemon.gripper.put_object(width_mm=30.0)
        run(site, code)
        assert not daemon.is_energised
    if "print(" in code:
        assert capsys.readouterr().out
