"""Makes the client for threads from the core's classes: the same methods, which block.

A coroutine becomes a method that waits for it. An object for `async with` becomes one for `with`.
Signatures and docstrings are the core's.
"""

import ast
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

CORE = Path(__file__).resolve().parent.parent / "litegrip_client" / "core"

PROPERTIES = {"config", "mount"}
"""Coroutines without arguments that are properties for threads, as in the vendor's SDK."""

HEAD = '''"""The client for threads: made by docs/generate.py from its core, not by hand."""

from __future__ import annotations

from litegrip_client.threads.blocking import complete
from litegrip_client.values.fields import Hinting
from litegrip_client.values.tracebacks import shortened

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing typing and dataclasses is slow
'''

_Function: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True, slots=True)
class Made:
    """A class to make: its name, and the class of a module of the core that it waits for."""

    name: str
    module: str
    source: str
    base: str | None = None


BLOCKS = (
    Made("Lease", "session", "Lease"),
    Made("ManualCalibration", "calibrations", "ManualCalibration"),
    Made("SetpointStream", "motion", "SetpointStream"),
)
CLASSES = (
    *BLOCKS,
    Made("GripperActions", "actions", "GripperActions"),
    Made("BlockingGripper", "gripper", "Gripper", base="GripperActions"),
)
MADE = {made.name for made in CLASSES}


def blocking_client() -> str:
    """Return the text of `litegrip_client/threads/actions.py`."""
    imports = {
        f"    from litegrip_client.core import {made.module} as core_{made.module}"
        for made in CLASSES
    }
    classes = []
    for made in CLASSES:
        tree = ast.parse((CORE / f"{made.module}.py").read_text(encoding="utf-8"))
        found = [one for one in tree.body if isinstance(one, ast.ClassDef)]
        node = next(one for one in found if one.name == made.source)
        classes.append(_class(made, node))
        imports |= _imports(made, tree, node)
    text = HEAD + "\n".join(sorted(imports)) + "\n\n\n" + "\n\n\n".join(classes) + "\n"
    for command in (("check", "--select=I", "--fix", "--quiet"), ("format",)):
        text = _ruff(text, *command)
    return text


def _class(made: Made, node: ast.ClassDef) -> str:
    core = f"core_{made.module}.{made.source}"
    head = "@shortened\n" if made in BLOCKS else ""
    hinting = [name for one in node.bases if (name := ast.unparse(one)) == "Hinting"]
    base = made.base or "".join(hinting)
    parts = [f"{head}class {made.name}{f'({base})' if base else ''}:\n{_docstring(node)}"]
    if made.base is None:
        parts.append(f"    def __init__(self, core: {core}) -> None:\n        self._core = core")
    else:
        parts.append(f"    _core: {core}")
    members = [one for one in node.body if isinstance(one, _Function)]
    parts += [text for one in members if (text := _member(made, one))]
    return "\n\n".join(parts)


def _member(made: Made, node: _Function) -> str:
    """Return the text of a public member, or of a block's begin or end; nothing of others."""
    returns = "None" if node.returns is None else ast.unparse(node.returns)
    decorators = [ast.unparse(one) for one in node.decorator_list]
    name, call = node.name, f"self._core.{node.name}({_arguments(node)})"
    if name == "__aenter__":
        name, returns, body = "__enter__", made.name, f"complete({call})\n        return self"
    elif name == "__aexit__":
        name, body = "__exit__", f"complete({call})"
    elif name == "__repr__":
        body = "return repr(self._core)"
    elif name.startswith("_"):
        return ""
    elif isinstance(node, ast.AsyncFunctionDef):
        body = f"complete({call})" if returns == "None" else f"return complete({call})"
        decorators = ["property"] if name in PROPERTIES else decorators
    elif "property" in decorators:
        body = f"return self._core.{name}"
    elif f"{name}.setter" in decorators:
        body = f"self._core.{name} = {_arguments(node)}"
    else:
        body = f"return {returns}({call})" if returns in MADE else f"return {call}"
    head = "".join(f"    @{one}\n" for one in decorators)
    head += f"    def {name}({ast.unparse(node.args)}) -> {returns}:\n"
    return f"{head}{_docstring(node)}        {body}"


def _arguments(node: _Function) -> str:
    given = [one.arg for one in node.args.args[1:]]
    return ", ".join(given + [f"{one.arg}={one.arg}" for one in node.args.kwonlyargs])


def _docstring(node: _Function | ast.ClassDef) -> str:
    text = ast.get_docstring(node, clean=False)
    if text is None:
        return ""
    indent = "    " if isinstance(node, ast.ClassDef) else "        "
    return f'{indent}"""{text.replace("async with", "with")}"""\n'


def _imports(made: Made, tree: ast.Module, node: ast.ClassDef) -> set[str]:
    """Return the imports for what the public members' annotations name."""
    functions = [one for one in node.body if isinstance(one, _Function)]
    used = {
        name.id
        for function in functions
        if not function.name.startswith("_") or function.name == "__aexit__"
        for annotation in _annotations(function)
        for name in ast.walk(annotation)
        if isinstance(name, ast.Name)
    }
    lines = set()
    for one in ast.walk(tree):
        if isinstance(one, ast.ImportFrom):
            names = [alias.name for alias in one.names if alias.name in used - MADE]
            lines |= {f"    from {one.module} import {name}" for name in names}
        elif isinstance(one, ast.Import):
            lines |= {f"    import {alias.name}" for alias in one.names if alias.name in used}
        elif isinstance(one, ast.AnnAssign) and ast.unparse(one.target) in used:
            module = f"litegrip_client.core.{made.module}"
            lines.add(f"    from {module} import {ast.unparse(one.target)}")
    return lines


def _annotations(node: _Function) -> list[ast.expr]:
    arguments = (*node.args.args, *node.args.kwonlyargs)
    found = [one.annotation for one in arguments]
    return [one for one in (*found, node.returns) if one is not None]


def _ruff(text: str, *command: str) -> str:
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "ruff",
            *command,
            "--stdin-filename",
            "litegrip_client/threads/actions.py",
            "-",
        ],
        input=text,
        capture_output=True,
        encoding="utf-8",
        cwd=CORE.parent.parent,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"ruff {command[0]}: {done.stderr}")
    return done.stdout
