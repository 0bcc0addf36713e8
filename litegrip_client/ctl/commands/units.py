"""The command that installs the units for systemd, and tells what is to be done then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from litegrip_client.ctl.run import OK, Command, Run
from litegrip_client.units import install, plan
from litegrip_client.units.install import Done, Wishes


def install_units(run: Run) -> int:
    """Install or remove, and say what comes next."""
    options = run.options
    root: Path = options.root
    notes: list[str] = []
    if options.uninstall:
        if options.can or options.serial:
            return run.refuse(
                "--uninstall removes everything", "leave --can and --serial out, or --uninstall"
            )
        done = install.uninstall(root)
        following = _after_removal(root, done)
        notes.append("configuration, calibrations, user and group are left: see the documentation")
    else:
        wishes = Wishes(options.can, options.serial)
        done = install.install(root, wishes, plan.program_directory())
        following = _after_installation(root, done, options.can)
        notes += install.foreign_users(root)
        notes += [f"{path} is used instead of what was installed" for path in install.hiding(root)]
    data = {"files": [asdict(one) for one in done], "next": following, "notes": notes}
    run.output.result(data, _text(done, following, notes))
    return OK


def _after_installation(root: Path, done: Sequence[Done], channels: Sequence[str]) -> list[str]:
    following = ["systemd-sysusers", "systemctl daemon-reload"]
    if channels or any(one.what != "unchanged" and _is_of_network(one.path) for one in done):
        if install.uses_networkd(root):
            following.append("networkctl reload")
        following.append("udevadm control --reload")
        following += [
            f"udevadm trigger --action=add --subsystem-match=net --sysname-match={channel}"
            for channel in channels
        ]
    running = install.running(root)
    stopped = [name for name in install.enabled(root) if "@" in name and name not in running]
    if running:
        verb = "restart" if _has_new_settings(done) else "reload"
        following.append(f"systemctl {verb} {' '.join(running)}")
    if stopped:
        following.append(f"systemctl start {' '.join(stopped)}")
    if not running and not stopped and not channels:
        channels = install.channels(root) or [plan.EXAMPLE_CHANNEL]
    known = (*running, *stopped)
    new = [name for name in map("litegripd@{}".format, channels) if name not in known]
    if new:
        following += [
            "usermod --append --groups litegrip USER   # who may use the grippers",
            f"systemctl enable litegripd.target {' '.join(new)}",
            f"systemctl start {' '.join(new)}",
        ]
    return following


def _has_new_settings(done: Sequence[Done]) -> bool:
    """Whether the daemons' unit is not what it was, its drop-in included."""
    return any(
        one.what in ("installed", "replaced") and "/litegripd@.service" in one.path for one in done
    )


def _is_of_network(path: str) -> bool:
    return "/network/" in path or "/rules.d/" in path


def _after_removal(root: Path, done: Sequence[Done]) -> list[str]:
    removed = [one.path for one in done if one.what == "removed"]
    following = ["systemctl daemon-reload"] if removed else []
    if any(map(_is_of_network, removed)):
        if install.uses_networkd(root):
            following.append("networkctl reload")
        following.append("udevadm control --reload")
    return following


def _text(done: Sequence[Done], following: Sequence[str], notes: Sequence[str]) -> str:
    lines = [f"{one.what:9}  {one.path}" for one in done] or ["nothing to remove"]
    if following:
        lines += ["next, as root:", *(f"  {command}" for command in following)]
    return "\n".join([*lines, *(f"note: {note}" for note in notes)])


COMMANDS: Mapping[str, Command] = {"install-units": install_units}
