"""Commands about the machine: what it needs, checked; units for systemd; completion."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from runpy import run_path

from litegrip_client.ctl import install
from litegrip_client.ctl.doctor import daemon_checks, gripper_checks, link_checks
from litegrip_client.ctl.doctor.facts import Facts
from litegrip_client.ctl.doctor.gather import gather, scan
from litegrip_client.ctl.findings import Check, as_data, as_text, findings_of, is_well
from litegrip_client.ctl.install import Done, Wanted
from litegrip_client.ctl.parser import LateParser
from litegrip_client.ctl.run import Commands, Run, installing
from litegrip_client.socketcan.managers import uses_networkd
from litegrip_client.threads.blocking import connect
from litegrip_client.values.errors import CommandError, LiteGripError

CHECKS: tuple[Check[Facts], ...] = (
    Check("configuration", daemon_checks.configuration),
    Check("iproute2", link_checks.tool),
    Check("link", link_checks.link),
    Check("device", link_checks.device),
    Check("serial", link_checks.serial),
    Check("adapter", link_checks.adapter),
    Check("bit-rate", link_checks.bit_rate),
    Check("modes", link_checks.modes),
    Check("network", link_checks.network),
    Check("sample-point", link_checks.sample_point),
    Check("restart", link_checks.restart),
    Check("queue", link_checks.queue),
    Check("bus-state", link_checks.bus_state),
    Check("bus-errors", link_checks.errors),
    Check("daemon", daemon_checks.daemon),
    Check("version", daemon_checks.version),
    Check("sockets", daemon_checks.sockets),
    Check("protection", daemon_checks.protection),
    Check("group", daemon_checks.group),
    Check("real-time", daemon_checks.real_time),
    Check("disk", daemon_checks.disk),
    Check("bus", gripper_checks.bus),
    Check("motor", gripper_checks.motor),
    Check("stop", gripper_checks.stop),
    Check("scan", gripper_checks.scan),
    Check("other-master", gripper_checks.other_master),
    Check("control-mode", gripper_checks.control_mode),
    Check("can-br", gripper_checks.bit_rate_code),
    Check("ids", gripper_checks.ids),
    Check("watchdog", gripper_checks.watchdog),
    Check("ranges", gripper_checks.ranges),
    Check("calibration", gripper_checks.calibration),
    Check("stroke", gripper_checks.stroke),
    Check("position", gripper_checks.position),
    Check("channel", gripper_checks.calibration_channel),
    Check("teleop", daemon_checks.teleop),
    Check("health", daemon_checks.health),
)


def doctor_options(parser: LateParser) -> None:
    """Add the arguments of `doctor`."""
    parser.add_argument(
        "--scan",
        action="store_true",
        help="also have the ids 1 to 16 asked for a motor; refused while it is enabled",
    )


def doctor(run: Run) -> int:
    """Show what was found; the exit code shows if there is an error."""
    options = run.options
    facts = gather(options.channel, options.socket, channel_chosen=options.channel_chosen)
    if options.scan:
        facts = replace(facts, scan=scan(facts))
    found = [*findings_of(CHECKS, facts), *facts.fleet]
    channel = facts.channel if facts.is_channel_known else None
    return run.done(as_data(found, channel=channel), as_text(found), ok=is_well(found))


_INTERFACE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,14}")  # IFNAMSIZ less the final zero

_FLEET_NEXT = (
    "the fleet needs its part of this machine in /etc/litegripd/fleet.toml (docs/fleet.md), then:"
    " systemctl enable --now litegripd-fleet@gateway (or @portal, @router);"
    " a machine without a gripper needs no litegripd@"
)
_INSTALL_UNITS = """\
Install what lets systemd run the daemons of this installation: units, a user
and a group, a configuration to begin with. Says what it did, and which commands
come next; runs none of them. A configuration that is there stays as it is. What
an earlier call had brought up or allowed stays so, and is renewed.
"""


def install_units_options(parser: LateParser) -> None:
    """Add the arguments of `install-units`."""
    parser.description = _INSTALL_UNITS
    parser.add_argument(
        "--root", type=Path, default=Path("/"), metavar="DIR", help="a system below DIR (/)"
    )
    parser.add_argument(
        "--can",
        action="append",
        default=[],
        type=_interface,
        metavar="NAME",
        help="also have this CAN interface brought up at 1 Mbit/s; may be repeated",
    )
    parser.add_argument(
        "--serial", action="store_true", help="also let the daemons use adapters at serial ports"
    )
    parser.add_argument(
        "--fleet", action="store_true", help="also what puts grippers on a network of machines"
    )
    parser.add_argument(
        "--uninstall", action="store_true", help="remove it all; configuration and data stay"
    )


def _interface(text: str) -> str:
    """Read the name of a network interface."""
    if not _INTERFACE.fullmatch(text):
        raise ArgumentTypeError(f"{text!r} is no name of a CAN interface (can0, for example)")
    return text


def install_units(run: Run) -> int:
    """Install or remove, and say what comes next."""
    options = run.options
    root: Path = options.root
    notes: list[str] = []
    if options.uninstall:
        if options.can or options.serial or options.fleet:
            return run.refuse(
                "--uninstall removes everything",
                "leave --can, --serial and --fleet out, or --uninstall",
            )
        done = install.uninstall(root)
        is_any_removed = any(one.what == "removed" for one in done)
        following = ["systemctl daemon-reload", *_reloads(root, done)] if is_any_removed else []
        notes.append("configuration, calibrations, user and group are left: see the documentation")
    else:
        wanted = Wanted(options.can, options.serial, options.fleet)
        programs = install.program_directory()
        done = install.install(root, wanted, programs)
        following = _after_installation(root, done, options.can, programs)
        lacking = install.lacking(programs)
        needed = [one for one in lacking if one.is_used(root) or (one.is_fleet and options.fleet)]
        following[:0] = [one.remedy for one in needed]
        notes += [
            f"{one.unit} cannot run without {one.package}, which this environment lacks; before it"
            f" is enabled: {one.remedy}"
            for one in lacking
            if one not in needed and not one.is_fleet
        ]
        notes += [_FLEET_NEXT] if options.fleet else []
        notes += install.foreign_users(root)
        notes += [f"{path} is used instead of what was installed" for path in install.hiding(root)]
        notes += [
            f"{path} is a copy of a file of earlier versions, and still does what it says, beside"
            f" /{install.RULES}: remove it, or rename a rule to {Path(install.RULES).name}"
            for path in install.outdated(root)
        ]
    if install.is_packaged(root):
        notes.append("the units are those of the Debian package: no copy is installed")
    data = {"files": [asdict(one) for one in done], "next": following, "notes": notes}
    return run.done(data, _text(done, following, notes))


def _after_installation(
    root: Path, done: Sequence[Done], channels: Sequence[str], programs: str
) -> list[str]:
    following = ["systemd-sysusers", "systemctl daemon-reload"]
    following += _reloads(root, done, is_rule_wanted=bool(channels))
    if any(one.path.endswith(install.SERIAL_RULES) and one.what != "unchanged" for one in done):
        following.append("udevadm trigger --subsystem-match=tty")
    following += [
        f"udevadm trigger --action=add --subsystem-match=net --sysname-match={channel}"
        for channel in channels
    ]
    running = install.running(root)
    stopped = [name for name in install.enabled(root) if "@" in name and name not in running]
    daemons = [name for name in running if name.startswith("litegripd@")]
    others = [name for name in running if name not in daemons]  # they hold nothing, nor reload
    new_settings = [  # of the daemons' unit, its drop-in included
        one.path
        for one in done
        if one.what in ("installed", "replaced") and "/litegripd@.service" in one.path
    ]
    if daemons and new_settings:
        following.append(f"systemctl restart {' '.join(daemons)}")
    elif daemons:
        silent = [name for name in daemons if root == Path("/") and _is_silent(name)]
        if following_at_once := [name for name in daemons if name not in silent]:
            following.append(f"systemctl reload {' '.join(following_at_once)}")
        following += [_followed(name, programs) for name in silent]
    if others:
        following.append(f"systemctl restart {' '.join(others)}")
    if stopped:
        following.append(f"systemctl start {' '.join(stopped)}")
    if not running and not stopped and not channels:
        channels = install.channels(root) or [install.EXAMPLE_CHANNEL]
    known = (*running, *stopped)
    new = [name for name in map("litegripd@{}".format, channels) if name not in known]
    if new:
        following += [
            "usermod --append --groups litegrip USER   # who may use the grippers",
            f"systemctl enable litegripd.target {' '.join(new)}",
            f"systemctl start {' '.join(new)}",
        ]
    return following


def _is_silent(daemon: str) -> bool:
    """Return True if a daemon says that its motor does not answer: then it is not reloaded."""
    try:
        with connect(_channel(daemon), timeout_s=_ASK_WITHIN_S) as connection:
            return connection.call("state.get").get("motor") in _SILENT
    except LiteGripError:
        return False


def _followed(daemon: str, programs: str) -> str:
    """Return the line that has a daemon without power follow; as the Debian package's postinst.

    Its motor gets no commands and holds nothing. Whether that is still so is asked when it is
    typed: by then there may be power, and something between the jaws.
    """
    asked = f"{programs}/litegripctl -c {_channel(daemon)} state --json"
    motor = r"\|".join(_SILENT)
    is_silent = f'{asked} | grep -q \'"motor": "\\({motor}\\)"\''
    return f"systemctl reload {daemon} || {{ {is_silent} && systemctl restart {daemon}; }}"


def _channel(daemon: str) -> str:
    return daemon.partition("@")[2]


def _reloads(root: Path, done: Sequence[Done], *, is_rule_wanted: bool = False) -> list[str]:
    """Return the commands for networkd and udev to reload their files, if any has changed."""
    changed = [one.path for one in done if one.what not in ("unchanged", "kept")]
    is_network = any("/systemd/network/" in path for path in changed)
    is_rule = any("/rules.d/" in path for path in changed)
    following = ["networkctl reload"] if is_network and uses_networkd(root) else []
    if is_rule_wanted or is_rule or is_network:  # a .link is udev's
        following.append("udevadm control --reload")
    return following


def _text(done: Sequence[Done], following: Sequence[str], notes: Sequence[str]) -> str:
    lines = [f"{one.what:9}  {one.path}" for one in done] or ["nothing to do"]
    if following:
        lines += ["next, as root:", *(f"  {command}" for command in following)]
    return "\n".join([*lines, *(f"note: {note}" for note in notes)])


_SILENT = ("silent", "unknown")
"""The states of a motor that gets no commands."""
_ASK_WITHIN_S = 2.0

_COMPLETION = """\
Print the script by which a shell completes commands, options and their values:
running channels, files.
"""
_COMPLETION_EXAMPLES = """\
examples:
  eval "$(litegripctl completion bash)"      for this shell, or in ~/.bashrc
  eval "$(litegripctl completion zsh)"       in ~/.zshrc, behind compinit
  litegripctl completion fish | source       in ~/.config/fish/config.fish
"""


def completion_options(parser: LateParser) -> None:
    """Add the arguments of `completion`."""
    parser.description, parser.epilog = _COMPLETION, _COMPLETION_EXAMPLES
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="the shell")


def completion(run: Run) -> int:
    """Print a shell's script that was built with the package; a source tree makes it itself."""
    shell = run.options.shell
    built = install.DATA / f"litegripctl.{shell}"
    if built.exists():
        script = built.read_text(encoding="utf-8")
    else:
        maker = Path(__file__).parents[3] / "docs/completion.py"
        try:
            script = str(run_path(str(maker))["completion_script"](shell))
        except ModuleNotFoundError as missing:
            raise CommandError(
                f"a source tree has no script for {shell}, and {missing.name}, which makes it,"
                " is not installed",
                reason="library_missing",
                data={"hint": installing(missing.name or "shtab")},
            ) from None
    return run.done({"shell": shell, "script": script}, script.rstrip("\n"))


COMMANDS: Commands = {
    "doctor": (doctor, doctor_options),
    "install-units": (install_units, install_units_options),
    "completion": (completion, completion_options),
}
