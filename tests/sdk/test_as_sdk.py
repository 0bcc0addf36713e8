"""`python -m litegrip_client.as_sdk`: the program and its children find the package."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from litegrip_client import as_sdk

OURS = f"{as_sdk.FOLDER}/litegrip/__init__.py"


def run(*arguments: str | Path, cwd: Path) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, "PYTHONPATH": str(Path(as_sdk.__file__).parents[1])}
    return subprocess.run(
        [sys.executable, "-m", "litegrip_client.as_sdk", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        cwd=cwd,
        timeout=100,
    )


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


SHOW = "import litegrip, sys; print(litegrip.__file__, *sys.argv[1:])\n"


def test_a_script_and_its_arguments(tmp_path: Path) -> None:
    script = write(tmp_path / "one/show.py", "import beside\n" + SHOW)
    write(tmp_path / "one/beside.py", "")
    done = run(script, "--speed", "3", cwd=tmp_path)
    assert (done.stdout, done.stderr) == (f"{OURS} --speed 3\n", "")


def test_a_module(tmp_path: Path) -> None:
    write(tmp_path / "tool/__main__.py", SHOW)
    done = run("-m", "tool", "x", cwd=tmp_path)
    assert (done.stdout, done.stderr) == (f"{OURS} x\n", "")


@pytest.mark.parametrize("module", ["nosuch", "nosuch.mod", "tool.mod"])
def test_a_module_that_is_not_there(tmp_path: Path, module: str) -> None:
    write(tmp_path / "tool/__init__.py", "")
    done = run("-m", module, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(f"there is no module {module}\nusage: ")


def test_a_module_whose_package_lacks_another_one_fails_as_it_does(tmp_path: Path) -> None:
    write(tmp_path / "tool/__init__.py", "import nosuch\n")
    write(tmp_path / "tool/mod.py", "")
    done = run("-m", "tool.mod", cwd=tmp_path)
    assert done.stderr.endswith("ModuleNotFoundError: No module named 'nosuch'\n")
    assert "there is no module" not in done.stderr


@pytest.mark.parametrize("option", ["-h", "--help"])
def test_help_is_no_error(tmp_path: Path, option: str) -> None:
    done = run(option, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage: python -m litegrip_client.as_sdk (SCRIPT | -m MODULE)")


@pytest.mark.parametrize("method", ["spawn", "forkserver", "fork"])
def test_children_of_multiprocessing(tmp_path: Path, method: str) -> None:
    script = write(
        tmp_path / "many.py",
        f"""
import multiprocessing

def child(answers):
    import litegrip
    answers.put(litegrip.__file__)

if __name__ == "__main__":
    context = multiprocessing.get_context({method!r})
    answers = context.Queue()
    process = context.Process(target=child, args=(answers,))
    process.start()
    print(answers.get())
    process.join()
""",
    )
    done = run(script, cwd=tmp_path)
    assert (done.stdout, done.stderr) == (f"{OURS}\n", "")


def test_children_by_the_interpreter(tmp_path: Path) -> None:
    script = write(
        tmp_path / "one.py",
        "import subprocess, sys\n"
        "subprocess.run([sys.executable, '-c', 'import litegrip; print(litegrip.__file__)'])\n",
    )
    done = run(script, cwd=Path("/"))
    assert (done.stdout, done.stderr) == (f"{OURS}\n", "")


def test_a_checkout_that_a_script_puts_first_does_not_open_the_bus(tmp_path: Path) -> None:
    write(tmp_path / "src/litegrip/__init__.py", "raise SystemExit('it opens the bus')\n")
    script = write(
        tmp_path / "examples/stroke.py",
        f"import sys\nsys.path.insert(0, {str(tmp_path / 'src')!r})\n"
        f"{SHOW}from litegrip.can import MotorType\n",
    )
    done = run(script, cwd=tmp_path)
    assert (done.stdout, done.stderr) == (f"{OURS}\n", "")


def test_what_is_wrong_with_the_command_line(tmp_path: Path) -> None:
    for arguments, said in (((), "usage"), (("none.py",), "no script none.py"), (("-m",), "usage")):
        done = run(*arguments, cwd=tmp_path)
        assert done.returncode == 1
        assert said in done.stderr


def test_another_package_that_is_loaded_already(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PYTHONPATH", "")
    other = type(sys)("litegrip")
    other.__file__ = str(tmp_path / "litegrip/__init__.py")
    monkeypatch.setitem(sys.modules, "litegrip", other)
    with pytest.raises(RuntimeError, match="imported already"):
        as_sdk.install()


def test_nothing_of_the_standard_library_alone_is_slow() -> None:
    """The client's own start does not load the package."""
    code = "import sys, litegrip_client; litegrip_client.LiteGrip; print('litegrip' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


FAILING = """from litegrip import LiteGrip

def main():
    {}

main()
"""
WRAPPER = 1 if sys.version_info < (3, 11) else 0
"""Python 3.10 shows what shortens a traceback, too."""


@pytest.mark.parametrize("as_module", [False, True], ids=["script", "module"])
@pytest.mark.parametrize(
    ("line", "ours", "error"),
    [
        ("LiteGrip('none').connect()", 1, "litegrip.exceptions.ConnectError: "),
        ("LiteGrip('none').actions.open()", 1, "litegrip.exceptions.NotInitializedError: "),
        ("LiteGrip().open(speed=3)", 0, "TypeError: LiteGrip.open() has no argument 'speed'"),
        ("1 / 0", -WRAPPER, "ZeroDivisionError"),
    ],
)
def test_a_traceback_is_the_scripts_lines_and_one_of_ours(
    tmp_path: Path, line: str, ours: int, error: str, as_module: bool
) -> None:
    script = write(tmp_path / "fails.py", FAILING.format(line))
    done = run(*(("-m", "fails") if as_module else (script,)), cwd=tmp_path)
    assert done.returncode == 1
    frames = [one for one in done.stderr.splitlines() if one.startswith('  File "')]
    assert len(frames) == 2 + ours + WRAPPER, done.stderr
    assert [one.partition('"')[2].partition('"')[0] for one in frames[:2]] == [str(script)] * 2
    assert done.stderr.count("Traceback") == 1
    assert f"\n{error}" in done.stderr
