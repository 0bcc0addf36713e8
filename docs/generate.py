"""Write the files that are made from the daemon's own tables; `--check` only compares.

    python docs/generate.py           write what is stale
    python docs/generate.py --check   exit 1 when something is stale, and say what

A further file is a further row of `GENERATED`: its path, and the function that makes its text.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import litegrip_client  # noqa: E402
from docs.blocking_client import blocking_client  # noqa: E402
from docs.configuration_page import configuration_page, default_file  # noqa: E402
from docs.protocol_fields import (  # noqa: E402
    forms_section,
    jobs_section,
    notifications_section,
    result_form,
    results_section,
    state_section,
    teleop_section,
)
from litegrip_client.ctl.render import WHY_NOT  # noqa: E402
from litegrip_client.values.errors import OWN_REASONS, LiteGripError  # noqa: E402
from litegrip_client.values.fields import SPAN_INSET_MM  # noqa: E402
from litegrip_client.values.severity import (  # noqa: E402
    EXCUSE,
    SEVERITIES,
    WARNING_MEMBERS,
    WARNINGS,
)
from litegripd.app.build import METHODS, SIMULATED_METHODS  # noqa: E402
from litegripd.io.stop_socket import MAX_STOP_LINE_BYTES  # noqa: E402
from litegripd.model.calibration import NOMINAL, SUPERSEDED  # noqa: E402
from litegripd.model.errors import ERROR_TABLE  # noqa: E402
from litegripd.model.gripper import STROKE_RANGE_MM  # noqa: E402
from litegripd.model.motion_config import MotionConfig  # noqa: E402
from litegripd.rpc.jsonrpc import MAX_LINE_BYTES  # noqa: E402
from litegripd.rpc.method import CONFIG, Method, Param  # noqa: E402
from litegripd.rpc.methods.reading import STATE_FIELDS  # noqa: E402
from litegripd.rpc.openrpc import PROTOCOL_VERSION  # noqa: E402
from litegripd.trajectories.methods import SPEEDS  # noqa: E402


@dataclass(frozen=True, slots=True)
class Generated:
    """One generated file: where it is, below the root of the project, and what makes its text."""

    path: str
    make: Callable[[], str]

    @property
    def file(self) -> Path:
        """Where the file is."""
        return ROOT / self.path

    def is_stale(self) -> bool:
        """Whether the file is missing or does not say what it should."""
        return not self.file.exists() or self.file.read_text(encoding="utf-8") != self.make()


def client_error_table() -> str:
    """Make the client's table: reason to exception and exit code, code to reason."""
    reasons = (f'    "{row.reason}": ("{row.exception}", {row.exit_code}),' for row in ERROR_TABLE)
    codes = (f'    {row.code}: "{row.reason}",' for row in ERROR_TABLE)
    return "\n".join(
        (
            '"""Reasons, codes and exit codes of errors: made by docs/generate.py, not by hand."""',
            "",
            "REASONS: dict[str, tuple[str, int]] = {",
            *reasons,
            "}",
            '"""Reason of an error: the name of its exception, the exit code of litegripctl."""',
            "",
            "CODES: dict[int, str] = {",
            *codes,
            "}",
            '"""JSON-RPC code of an error: its reason."""',
            "",
        )
    )


def client_method_table() -> str:
    """Make the client's table: method to parameters, each with what it may name."""
    config = tuple(MotionConfig().as_fields(1.0))
    return "\n".join(
        (
            '"""Methods and parameters of this version: made by docs/generate.py, not by hand."""',
            "",
            "_CONFIG = (",
            *(f'    "{name}",' for name in config),
            ")",
            "",
            "METHODS: dict[str, dict[str, tuple[str, ...]]] = {",
            *(line for row in METHODS for line in _method_rows(row)),
            "}",
            '"""Method: its parameters, and the values or fields that each of them may name."""',
            "",
        )
    )


def _method_rows(method: Method) -> Iterator[str]:
    yield f'    "{method.name}": {{'
    for name, param in method.declared.items():
        if param.choices:
            yield f'        "{name}": ('
            yield from (f'            "{choice}",' for choice in param.choices)
            yield "        ),"
        else:
            yield f'        "{name}": {"_CONFIG" if name == CONFIG.name else "()"},'
    yield "    },"


def page_severity() -> str:
    """Make the page's rule which events are warnings."""
    kinds = ", ".join(f'"{kind}"' for kind in SEVERITIES if kind in WARNINGS)
    members = " || ".join(f"data.{member}" for member in WARNING_MEMBERS)
    return "\n".join(
        (
            "/* Which events are warnings: made by docs/generate.py, not by hand. */",
            "",
            f"const WARNINGS = new Set([{kinds}]);",
            "",
            "export function isWarning({ kind, data }) {",
            f"  return !data.{EXCUSE} && Boolean(WARNINGS.has(kind) || {members});",
            "}",
            "",
        )
    )


ON_PAGE = {
    "litegripctl release": "“Let go”",
    "litegripctl grasp": "“Grasp”",
    "litegripctl zero": "“Zero …”",
    "litegripctl open": "“Open”",
    "litegripctl health": "the lamp of its health",
    "--force": "“Force”",
}
"""What the shell names in `WHY_NOT`, in the words of the page."""


def page_motions() -> str:
    """Make what the page has of motions: what may be given, and why they failed."""
    templates = sorted({template.rad_to_mm for template in NOMINAL + SUPERSEDED})
    reasons = dict(WHY_NOT)
    for command, words in ON_PAGE.items():
        reasons = {outcome: why.replace(command, words) for outcome, why in reasons.items()}
    return "\n".join(
        (
            "/* What a motion may be given, and why it ended wrongly: made by docs/generate.py. */",
            "",
            f"export const REPLAY_SPEEDS = {json.dumps(SPEEDS)};",
            f"export const SPAN_INSET_MM = {json.dumps(SPAN_INSET_MM)};",
            f"export const STROKE_RANGE_MM = {json.dumps(STROKE_RANGE_MM)};",
            f"export const TEMPLATES_RAD_TO_MM = {json.dumps(templates)};",
            "",
            "export const WHY_NOT = {",
            *(f"  {name}: {json.dumps(why, ensure_ascii=False)}," for name, why in reasons.items()),
            "};",
            "",
        )
    )


def _exceptions(kind: type[LiteGripError], indent: str) -> Iterator[str]:
    """Yield a line for each of the client's exceptions, behind that of its first base."""
    others = [base.__name__ for base in kind.__bases__[1:]]
    yield f"{indent}{kind.__name__}" + (f" (also a {', '.join(others)})" if others else "")
    for one in kind.__subclasses__():
        if one.__name__ in litegrip_client.__all__ and one.__bases__[0] is kind:
            yield from _exceptions(one, f"{indent}    ")


def errors_page() -> str:
    """Make the page on errors."""
    rows = (
        f"| `{row.reason}` | {row.code} | `{row.exception}` | {row.exit_code} "
        f"| {'yes' if row.retryable else 'no'} | {row.meaning} |"
        for row in ERROR_TABLE
    )
    own = (
        f"| `{reason}` | `{exception}` | {code} | {meaning} |"
        for reason, (exception, code, meaning) in OWN_REASONS.items()
    )
    return "\n".join(
        (
            "# Errors",
            "",
            "<!-- Made by docs/generate.py from the code; not to be edited. -->",
            "",
            "Every error on the wire carries a number for JSON-RPC, a message for a person and,",
            "in `data`, a `reason` that does not change. `litegrip_client` raises the exception",
            "of the reason, `litegripctl` ends with its exit code. *Retryable* says whether the",
            "same request may succeed later unchanged.",
            "",
            "On the wire a message names methods and parameters, and `data.terms` says where",
            "([protocol.md](protocol.md#names-in-texts)). In their place the exceptions of",
            "`litegrip_client` name its calls, and `litegripctl`, also with `--json`, its commands",
            "and options (`litegrip_client/values/voices.py` is the table). What users have said",
            "stays as it is, and so do messages of an older daemon without `terms`.",
            "",
            "An exception has `reason`, `code`, `message`, `hint` (what to do, or `None`), `data`,",
            "`retryable`, `owner` (who has what was asked for, or has stopped) and `channel`:",
            "that of the gripper whose call has raised it, `None` where no connected or connecting",
            "gripper has, as for a value that is refused before. In a program that is connected to",
            "several channels at once, `str(error)` begins with it.",
            "",
            "The exceptions: what catches one catches those below it, too.",
            "",
            "```",
            *_exceptions(LiteGripError, ""),
            "```",
            "",
            "| reason | code | exception | exit code | retryable | meaning |",
            "| --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
            "## Without the daemon",
            "",
            "What `litegrip_client` and `litegripctl` find out themselves has no number: `code` is",
            "`None`, in JSON `null`. Measuring the travel that fails has its `outcome` as reason.",
            "",
            "| reason | exception | exit code | meaning |",
            "| --- | --- | --- | --- |",
            *own,
            "",
        )
    )


def protocol_page() -> str:
    """Make the page on the protocol: what holds for all, each method, and what they tell."""
    sections = [
        PROTOCOL_HEAD,
        *map(_method_section, METHODS),
        SIMULATED_HEAD,
        *map(_method_section, SIMULATED_METHODS),
        notifications_section(),
        results_section(),
        jobs_section(),
        teleop_section(),
        state_section(),
        forms_section(),
    ]
    return "\n".join(sections)


SIMULATED_HEAD = """## The world of a simulated gripper

Only a daemon that simulates its gripper has these methods (`simulated` of `hello` is true).
"""


def _method_section(method: Method) -> str:
    lines = [f"### `{method.name}`", "", method.summary, "", f"Result: {method.result}", ""]
    lines += [f"Form: {result_form(method)}", ""]
    if method.params:
        lines += ["| parameter | type | allowed | meaning |", "| --- | --- | --- | --- |"]
        lines += [
            f"| `{param.name}`{' (required)' if param.required else ''} | {param.kind} "
            f"| {_allowed(param)} | {param.description} |"
            for param in method.params
        ]
        lines.append("")
    return "\n".join(lines)


def _allowed(param: Param) -> str:
    if param.choices:
        is_field = param.choices == STATE_FIELDS
        return "the fields of the state" if is_field else ", ".join(param.choices)
    bounds = (param.minimum, param.maximum)
    if bounds == (None, None):
        return ""
    low, high = ("" if bound is None else f"{bound:g}" for bound in bounds)
    return f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"


PROTOCOL_HEAD = f"""# Protocol {PROTOCOL_VERSION}

<!-- Made by docs/generate.py from the daemon's tables; not to be edited. -->

JSON-RPC 2.0 over a Unix stream socket, one JSON text a line, UTF-8, parameters by name. The
socket is `/run/litegripd/<channel>.sock`, or `$XDG_RUNTIME_DIR/litegripd/<channel>.sock` for a
user who may not write there.

- A line is at most {MAX_LINE_BYTES} bytes; a longer one is refused and the connection closed.
  Batches, duplicate keys, NaN, Infinity and unknown parameters are refused and the connection stays
  open. So are requests without an `id`, a string or an integer, except `stream.set` and
  `teleop.receive`: without one they get no answer, and a `stream.refused` or `teleop.refused`
  where they are refused.
- Requests of one connection run concurrently: answers come when they are done, by `id`.
- `rpc.discover` returns an OpenRPC document: the parameters, the JSON Schema of every result, and,
  as `x-notifications`, that of the `params` of all that comes without a request. Of an event's
  `data` and an error's `data` it says only what all have in common. Bear members that it does not
  name: later versions add some.
- Versions of this protocol take nothing away and require nothing more. `version` of `hello` says
  which one the daemon is. It refuses what it does not know yet: `unknown_method`, or
  `invalid_params` with the `parameter`. So send only what is wanted. Of what `litegrip_client` has
  and the daemon lacks, it raises `older_daemon`.
- A motion answers with its result when it ends. With `"wait": false` it answers `{{"job": n}}` at
  once, and outlives its connection, unless `"detach"` is false; with `"detach": true` every one
  does. What its holder has queued under a lease that is lost never begins, detached or not.
  With `"progress": true` the connection gets `job.progress` [notifications](#notifications).
- The lease belongs to the connection that acquired it: its own motions need no token. The token
  (`lease`) is for another connection that is to act under it, and for `lease.resume`. It is a
  random secret, a new one for each grant, and only the holder is given it: whoever has it may move,
  whatever the user. Every request of the holder's renews a lease with `ttl_s`, a set-point without
  an `id` as well.
- A connection that has lost the lease (taken over, or silent for longer than `ttl_s`) moves nothing
  more, though the gripper be free: all that needs the lease is refused (`lease_lost`, with `cause`,
  `why`, and `by` whom) until it asks again by `lease.acquire`, `lease.take` or `lease.resume`. So
  does one without a lease whose motion a `lease.take` has ended, or dropped from the queue. Both
  get `lease.lost` at once, whether they wait for the motion or not.
- A connection whose opener has ended, but that another process has inherited, may read and stop.
- A motion that could not run its course (cancelled, stopped, a fault, its client lost) answers
  with an error. [errors.md](errors.md) lists all reasons.
- Every method takes `sent_s` (CLOCK_MONOTONIC, seconds) and `stop_generation` (as last told): a
  motion that was sent before a stop never runs after it, a `stop.clear` never clears it, and a
  `lease.take`, which may let the jaws go, takes nothing over. They are refused
  (`sent_before_stop`): look at the state, and send them again. Without the two
  parameters a request counts as sent when it was received; what still lay unread in the kernel when
  a stop came was sent before it. A `stop.clear` behind the client's own stop does clear that.
- A set-point counts for `valid_s` from `sent_s` on, else from when it was received; when its turn
  comes later than that, it is refused (`set_point_expired`). Of a connection's set-points without
  an `id` that wait to be read, only the newest is carried out; what comes behind them is not late.
- What is still to be read when a client's process or its connection ends is dropped, except stops.
  A client that only ends its sending side, as `socat` does, is served to the end.
- Users (by uid) take turns, and then each user's connections: a flood of many connections delays
  the requests of another user by a few requests only.
- A request that asks for a `stop` stops in any case, even where it is refused for how it is spelt.
- `hello` names in `stop_socket` a socket that is served before everything else. Any line there is a
  stop: a level's name, a request `stop` of at most {MAX_STOP_LINE_BYTES} bytes, else a `hold`. The
  answer has the latched `level` and the `generation`.
- A stop makes an event when it is latched or raised. Every other one takes effect, too, but is only
  counted, in the state's `stop` as `repeats`, which the event `stop_cleared` tells.
- A client that lets too much wait to be read is closed, with the reason `backlog_full`: behind the
  whole lines that were sent to it.
- A connection that the daemon closes gets a last line first, an error whose `id` is null. That of
  the daemon's orderly end, `shutting_down`, has `motor_off`: true if the motor has confirmed that.

## Names in texts

The texts for a person (`message` and `hint` of an error, `message` of an event or a result,
`reasons` and `notes` of `health`, `warnings` of a calibration) name methods and parameters as this
page does. Where they do, the object that holds the text has `terms`, in an error its `data`. By the
text's name it has a row, for a list of texts one row each, of names in their order:

- `start` and `end`: the name is the text's characters (code points) from `start` to before `end`.
- `method`: the method that is named; with `parameter`, a call of it with that parameter.
- `method` null: `parameter` is one of the method that was asked.

A client for people puts its own names there. Nothing else in a text is a name, whatever it looks
like: users have said it. A text without a row names nothing that is known, as of an older daemon.

## Methods
"""


GENERATED = (
    Generated("litegrip_client/values/error_table.py", client_error_table),
    Generated("litegrip_client/values/method_table.py", client_method_table),
    Generated("litegrip_client/threads/actions.py", blocking_client),
    Generated("litegrip_web/page/severity.js", page_severity),
    Generated("litegrip_web/page/motions.js", page_motions),
    Generated("docs/errors.md", errors_page),
    Generated("docs/protocol.md", protocol_page),
    Generated("docs/configuration.md", configuration_page),
    Generated("etc/litegripd.toml", default_file),
)


def main(arguments: list[str] | None = None) -> int:
    """Write or check the generated files."""
    parser = argparse.ArgumentParser(description="Write the generated files.")
    parser.add_argument("--check", action="store_true", help="only say what is stale, and exit 1")
    check = parser.parse_args(arguments).check
    stale = [generated for generated in GENERATED if generated.is_stale()]
    for generated in stale:
        if not check:
            generated.file.parent.mkdir(exist_ok=True)
            generated.file.write_text(generated.make(), encoding="utf-8")
        sys.stdout.write(f"{generated.path} {'is stale' if check else 'written'}\n")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
