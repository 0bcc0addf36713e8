"""The command that looks at everything a gripper needs, also where no daemon runs."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from litegrip_client.ctl.render import plain
from litegrip_client.ctl.run import NOT_OK, OK, Commands, Run
from litegrip_client.doctor import daemon_checks, gripper_checks, link_checks
from litegrip_client.doctor.findings import Check, Finding, as_data, examine
from litegrip_client.doctor.gather import gather
from litegrip_client.voices import in_shell

_LEVEL_WIDTH = 9
_NAME_WIDTH = 14


def findings_text(findings: Sequence[tuple[str, Finding]]) -> str:
    """Show all findings, and how many are not all right."""
    lines = [line for name, finding in findings for line in _lines(name, finding)]
    counts = [
        _counted(sum(finding.level == level for _, finding in findings), level)
        for level in ("error", "warning")
    ]
    return "\n".join([*lines, "", ", ".join(counts)])


def _lines(name: str, finding: Finding) -> list[str]:
    head = f"{finding.level.upper():<{_LEVEL_WIDTH}}"
    lines = [f"{head}{name:<{_NAME_WIDTH}}{_told(finding.text)}"]
    if finding.command is not None:
        lines.append(f"{'':<{_LEVEL_WIDTH}}{plain(finding.command)}")
    if finding.advice is not None:
        lines.append(f"{'':<{_LEVEL_WIDTH}}({_told(finding.advice)})")
    return lines


def _told(text: str) -> str:
    """Show a text that may be the daemon's, which names methods."""
    return plain(in_shell(text))


def _counted(count: int, level: str) -> str:
    return f"{count} {level}" if count == 1 else f"{count or 'no'} {level}s"


CHECKS: tuple[Check, ...] = (
    Check("configuration", daemon_checks.configuration),
    Check("iproute2", link_checks.tool),
    Check("link", link_checks.link),
    Check("device", link_checks.device),
    Check("adapter", link_checks.adapter),
    Check("bit-rate", link_checks.bit_rate),
    Check("sample-point", link_checks.sample_point),
    Check("restart", link_checks.restart),
    Check("queue", link_checks.queue),
    Check("bus-state", link_checks.bus_state),
    Check("bus-errors", link_checks.errors),
    Check("daemon", daemon_checks.daemon),
    Check("version", daemon_checks.version),
    Check("sockets", daemon_checks.sockets),
    Check("group", daemon_checks.group),
    Check("real-time", daemon_checks.real_time),
    Check("bus", gripper_checks.bus),
    Check("motor", gripper_checks.motor),
    Check("other-master", gripper_checks.other_master),
    Check("control-mode", gripper_checks.control_mode),
    Check("can-br", gripper_checks.bit_rate_code),
    Check("ids", gripper_checks.ids),
    Check("watchdog", gripper_checks.watchdog),
    Check("ranges", gripper_checks.ranges),
    Check("calibration", gripper_checks.calibration),
    Check("position", gripper_checks.position),
    Check("channel", gripper_checks.calibration_channel),
    Check("health", daemon_checks.health),
)


def doctor(run: Run) -> int:
    """Show what was found; the exit code shows if there is an error."""
    options = run.options
    if options.ssh_host is not None:
        return run.refuse(
            "doctor looks at the machine that it runs on, not at another one",
            f"run it there: ssh {shlex.quote(options.ssh_host)} litegripctl doctor",
        )
    facts = gather(options.channel, options.socket, channel_chosen=options.channel_chosen)
    findings = examine(facts, CHECKS)
    data = as_data(facts.channel if facts.is_channel_known else None, findings)
    run.output.result(data, findings_text(findings))
    return OK if data["ok"] else NOT_OK


COMMANDS: Commands = {
    "doctor": (doctor, None),
}
