import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def generate(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(root / "docs/generate.py"), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )


def a_copy(tmp_path: Path) -> Path:
    skipped = shutil.ignore_patterns("__pycache__")
    for name in (
        "docs",
        "etc",
        "examples",
        "litegripd",
        "litegrip_client",
        "litegrip_fleet",
        "litegrip_web",
    ):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=skipped)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_nothing_generated_is_stale() -> None:
    done = generate(ROOT, "--check")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_what_is_stale_or_missing_is_named_and_then_written(tmp_path: Path) -> None:
    root = a_copy(tmp_path)
    (root / "docs/errors.md").unlink()
    with (root / "litegrip_client/values/error_table.py").open("a") as table:
        table.write("# old\n")
    with (root / "litegrip_client/threads/actions.py").open("a") as made_from_the_core:
        made_from_the_core.write("# old\n")
    stale = generate(root, "--check")
    assert stale.returncode == 1
    assert stale.stdout.split("\n") == [
        "litegrip_client/values/error_table.py is stale",
        "litegrip_client/threads/actions.py is stale",
        "docs/errors.md is stale",
        "",
    ]
    assert not (root / "docs/errors.md").exists()
    assert generate(root).returncode == 0
    assert generate(root, "--check").returncode == 0
    assert (root / "docs/errors.md").read_bytes() == (ROOT / "docs/errors.md").read_bytes()
