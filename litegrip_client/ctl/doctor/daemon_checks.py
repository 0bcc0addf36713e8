"""The checks of the daemon: does it run, may this user use it, and which rights has it got.

Facts in, findings out; nothing is asked.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from litegrip_client.core.discovery import asking, asking_for_group
from litegrip_client.ctl.doctor.facts import SIMULATED, Facts
from litegrip_client.ctl.findings import Finding, error, ok, warning
from litegrip_client.values.terms import told_all

STANDSTILL_US = 100_000
"""From so late a tick on some motors report "communication lost", others later."""
_LIMITS = "[Service]\\nLimitRTPRIO=99\\nLimitMEMLOCK=infinity\\n"
_DROP_IN = "/etc/systemd/system/litegripd@.service.d"
SHORT_S = 30 * 86_400.0
"""A certificate that is good for less is about to be over."""


def configuration(facts: Facts) -> Finding | None:
    """Check the file with which a daemon would be started, and that one that runs has read it."""
    found = facts.configuration
    if found is None:
        return _unread(facts)
    as_user = f"sudo -u {found.as_user} " if found.as_user else ""
    again = f"{as_user}litegripd {facts.channel} --check"
    if found.error is not None:
        advice = f"the daemon ends with it: correct it, and check it again: {again}"
        return error(found.error, advice=advice)
    if found.content is None:
        bus = f"which may name another bus than {facts.bus_channel}"
        if facts.interface is None:
            bus = "nor the bus that it names"
        return warning(
            f"{found.file} was not checked, {bus}: {found.unchecked}",
            advice=f"where the daemon is installed, as who may read it: {again}",
        )
    named = found.content.get("calibration") or {}
    if named.get("problem"):
        return error(
            f"{found.file}: {named['problem']} ({named.get('named_by')} names it)",
            advice="a daemon starts with it, and refuses motions: correct it, and check it again:"
            f" {again}",
        )
    if named.get("warnings"):
        doubts = "; ".join(map(str, named["warnings"]))
        return warning(
            f"{named.get('file')}, which {named.get('named_by')} names: {doubts}",
            advice=f"correct it, and check it again: {again}",
        )
    return ok(f"{found.file}: interface {facts.interface}, channel {facts.bus_channel}")


def _unread(facts: Facts) -> Finding | None:
    """Return that what was written has no effect on the daemon that runs, or would be started."""
    if facts.misnamed is not None:
        right = f"/etc/litegripd/{facts.channel}.toml"
        return warning(
            f"{facts.misnamed} is no file that a daemon reads, which would be {right}",
            f"sudo mv {facts.misnamed} {right}" if facts.misnamed != right else None,
            "then restart the daemon; a folder is to be moved away",
        )
    uptime_s = None if facts.daemon is None else facts.daemon.health.get("uptime_s")
    if facts.edited is None or uptime_s is None:
        return None
    path, written_s = facts.edited
    if written_s <= facts.now_s - uptime_s:
        return None
    again = _systemctl("restart", facts) or "end it, and start it again"
    text = f"{path} was written after the daemon was started, which continues with the one before"
    if facts.interface in SIMULATED:
        return warning(text, advice=f"to use it: {again}")
    return warning(
        text,
        f"{facts.ctl} restart --hold",
        f"where that is refused, since other tables have changed: {again}, with empty jaws",
    )


def daemon(facts: Facts) -> Finding | None:
    """Check that a daemon answers, and that it is the right one."""
    answering = facts.daemon
    if answering is None and facts.blocked is not None:
        return error(str(facts.failure), advice=f"{facts.blocked}; then start the daemon again")
    if answering is None:
        return _no_daemon(facts)
    channel = answering.hello.get("channel")
    if facts.asked_channel not in (None, channel):
        return error(
            f"the daemon at {answering.path} has channel {channel}, not {facts.asked_channel}",
            "unset LITEGRIPD_SOCKET",
        )
    uptime_s = answering.health.get("uptime_s")
    since = f" for {uptime_s:.0f} s" if isinstance(uptime_s, int | float) else ""
    where = ""
    if facts.is_remote:
        own = f"litegripctl -c {(answering.hello.get('remote') or {}).get('channel')} doctor"
        where = f", on another machine (there, '{own}' examines its link and its rights)"
    return ok(f"runs{since}, pid {answering.hello.get('pid')}{where}, {answering.path}")


def version(facts: Facts) -> Finding | None:
    """Check that daemon and client are of one version."""
    if facts.daemon is None:
        return None
    version = facts.daemon.hello.get("version")
    if version == facts.version:
        return ok(f"{version}, as this program")
    text = f"the daemon is {version}, this program {facts.version}"
    why = "a daemon keeps running the version that was started; else install one version for both"
    if facts.is_remote:
        return warning(text, advice="install one version on both machines")
    if facts.interface in SIMULATED:
        return warning(text, advice=f"end it, and start it again; {why}")
    hold = f"{facts.ctl} restart --hold" if facts.unit is None else _systemctl("reload", facts)
    return warning(text, hold, f"the jaws hold meanwhile what they hold; {why}")


def sockets(facts: Facts) -> Finding | None:
    """Check that this user may connect, and stop."""
    if not facts.sockets:
        return None
    closed = _closed(facts)
    if not closed:
        return ok(f"{facts.user.name} may open {' and '.join(s.path for s in facts.sockets)}")
    text = f"{facts.user.name} may not open {' and '.join(closed)}"
    directory = _closed_directory(facts)
    if directory is not None:
        path, owner, _group = directory
        what = "it" if path in closed else path
        ask = asking_for_group if path in closed else asking
        return error(f"{text}: {what} is only for {owner}", advice=ask(owner))
    return error(text, _admit(facts), _then(facts))


def group(facts: Facts) -> Finding | None:
    """Check that this user is in the group that may connect."""
    user = facts.user
    if _closed_directory(facts) is not None:
        return None  # what refuses is no group
    if user.has_group:
        return ok(f"{user.name} is in group {user.group}")
    is_own = any(s.owner_uid == user.uid for s in facts.sockets)
    if is_own and facts.interface in SIMULATED and not facts.is_remote:
        return ok(f"{user.name} needs no group for a simulated gripper of their own")
    if user.group_exists and (user.uid == 0 or is_own):
        return ok(f"{user.name} needs no group {user.group}")
    if not user.group_exists:
        text = f"there is no group {user.group}, whose members are to connect"
    elif user.is_member:
        text = f"{user.name} is in group {user.group}, but not yet in this session"
    else:
        text = f"{user.name} is not in group {user.group}"
    return warning(text, _admit(facts), _then(facts))


def real_time(facts: Facts) -> Finding | None:
    """Check that the daemon has the real-time rights that it asked for."""
    if facts.daemon is None or "control" not in facts.daemon.health or facts.is_remote:
        return None
    granted = facts.daemon.health["control"]
    wanted = facts.daemon.info.get("configuration", {}).get("control", {}).get("priority")
    priority, locked = granted.get("fifo_priority"), granted.get("memory_locked")
    missing = []
    if not priority and wanted != 0:
        missing.append(f"SCHED_FIFO {wanted or ''}".strip())
    if not locked:
        missing.append("locked memory")
    stood_still = _stood_still(granted)
    if not missing and stood_still is not None:
        return warning(
            stood_still,
            f"{facts.ctl} health",
            "find what kept it from running, for example another real-time program or a suspended"
            " machine; cpus in [control] gives it processors of its own",
        )
    if not missing:
        order = f"SCHED_FIFO {priority}" if priority else "ordinary priority, as configured"
        return ok(f"{order}, memory locked")
    if facts.daemon.info.get("simulated") is True and stood_still is None:
        return ok("ordinary priority, which is enough for a simulated gripper")
    text = f"not granted: {' and '.join(missing)}; {stood_still or 'ticks may start late'}"
    container = "a container must be given CAP_SYS_NICE and CAP_IPC_LOCK as well"
    if facts.unit is None:
        advice = (
            "start it where 'ulimit -r' is 50 or more and 'ulimit -l' is unlimited, as units do"
        )
        return warning(text, advice=f"{advice}; {container}")
    return warning(
        text,
        f"sudo mkdir -p {_DROP_IN} && printf '{_LIMITS}' | sudo tee {_DROP_IN}/realtime.conf"
        f" && sudo systemctl daemon-reload && {_systemctl('restart', facts)}",
        container,
    )


def _stood_still(control: Mapping[str, Any]) -> str | None:
    """Return a report if the daemon paused so long that the motor disarmed itself, or None."""
    worst_us = control.get("lateness", {}).get("worst_us")
    if worst_us is None or worst_us < STANDSTILL_US:
        return None
    return (
        f"the daemon itself stood still for {worst_us / 1e3:.0f} ms at worst since it was started,"
        f" {control.get('lost_ticks')} ticks lost in all; motors usually disarm after 100 ms"
    )


def disk(facts: Facts) -> Finding | None:
    """Check that there is room for what daemons write; None where they write elsewhere."""
    if facts.is_remote:
        return None
    if not facts.disks:
        return ok("there is room for calibrations, trajectories, dumps and the journal")
    text = "; ".join(lacking.text for lacking in facts.disks)
    if any(lacking.is_full for lacking in facts.disks):
        advice = "nothing can be kept meanwhile, and no daemon can be started while /tmp is full"
        return error(text, "df -h /var/lib/litegripd /run /tmp /var/log", advice)
    if any(lacking.is_read_only for lacking in facts.disks):
        advice = "an error of the disk makes it so: repair it, and restart; else mount it writable"
        return warning(text, "sudo dmesg | tail", advice)
    return warning(text, "sudo du -xh --max-depth=2 /var | sort -h | tail", "what is largest")


def health(facts: Facts) -> Finding | None:
    """Pass on the daemon's own verdict."""
    if facts.daemon is None:
        return None
    verdict = facts.daemon.health.get("verdict")
    if verdict == "ok":
        return ok("the daemon's verdict on itself is ok")
    reasons = "; ".join(told_all(facts.daemon.health, "reasons", facts.voice))
    found = warning if verdict == "degraded" else error
    return found(f"{verdict}: {reasons}", f"{facts.ctl} health")


def teleop(facts: Facts) -> Finding | None:
    """Check that teleoperation reaches the other end; None where that is not known."""
    figures = {} if facts.daemon is None else facts.daemon.health.get("teleop", {})
    reach, why = figures.get("reach"), figures.get("unreached")
    if reach is None:
        return None
    if reach in ("connected", "frames"):
        return ok("the leader is reached")
    if reach == "sending":
        if why is None:
            return ok("frames are sent, and no follower refuses them: over UDP no more is known")
        return error(
            why,
            f"{facts.ctl} teleop status",
            "on that machine: the follower is to be started, at that port",
        )
    return error(
        f"{reach}: {why or 'the leader is not reached yet'}",
        f"{facts.ctl} teleop status",
        "the same command on the leader's machine says if it leads, and at which port; both ends"
        " need the same port, and a firewall must let it through",
    )


def protection(facts: Facts) -> Finding | None:
    """Check how the way to another machine's gripper is protected, as its portal says."""
    told = None if facts.daemon is None else facts.daemon.health.get("remote")
    if not isinstance(told, Mapping):
        return None
    if told.get("insecure"):
        return warning(
            "insecure = true in the portal's fleet.toml: nothing is encrypted, and everybody on the"
            " network may do everything",
            advice="make certificates with etc/zenoh-certificates, see docs/fleet.md",
        )
    expires_s = told.get("certificate_expires_s")
    if not isinstance(expires_s, int | float):
        return ok("encrypted")
    days = (expires_s - facts.now_s) / 86_400.0
    if days < 0.0:
        return error("the portal's certificate is over", advice=_RENEW)
    text = f"encrypted; the portal's certificate is good for {days:.0f} days"
    return ok(text) if expires_s - facts.now_s >= SHORT_S else warning(text, advice=_RENEW)


_RENEW = (
    "where the authority's ca.key is: etc/zenoh-certificates DIRECTORY user:NAME; copy it here,"
    " then restart the portal"
)


def _no_daemon(facts: Facts) -> Finding:
    """Return why no daemon answers, as far as known, and how to start one."""
    status = None if facts.unit is None else f"systemctl status {facts.unit}"
    if _closed(facts):
        text = "not known if it runs: its socket is closed to this user"
        return warning(text, status, None if status else "ask who has started it")
    failure = facts.failure or "it does not answer"
    if facts.is_remote:
        return error(
            failure,
            advice=f"it is a gripper of another machine: the portal has to run here, with"
            f" {facts.channel} in [portal] of fleet.toml; if nothing below says what is in its way:"
            " sudo litegripd-fleet check, here, then on the router's and on the gripper's machine",
        )
    if facts.hung_pid is not None:
        who = f"pid {facts.hung_pid}" if facts.hung_pid else "a process"
        return error(
            f"{who} listens, but {failure}",
            _systemctl("restart", facts),
            f"{f'look first: {status}; ' if status else ''}without systemd: end it, start it again",
        )
    if facts.others:
        return error(
            f"no channel was named, and {facts.channel} is none of this machine; there are:"
            f" {', '.join(facts.others)}",
            f"litegripctl -c {facts.others[0]} doctor",
            f"or for all commands of this shell: export LITEGRIP_CHANNEL={facts.others[0]}",
        )
    if not facts.is_channel_known:
        advice = f"start its daemon: litegripd CHANNEL --socket {facts.socket}"
        return error(failure, advice=f"{advice}; without hardware: with --simulate")
    if facts.unit is None:
        return _not_installed(facts, failure)
    start = _systemctl("start", facts)
    if facts.configuration is not None and facts.configuration.error is not None:
        return error(failure, start, "not before the configuration is corrected")
    if facts.is_unit_enabled:
        why = f"its unit is enabled, so it was stopped or has failed: {status} says which"
        return error(failure, start, why)
    return error(
        failure,
        start,
        f"without systemd: litegripd {facts.channel};"
        f" without hardware: litegripd {facts.channel} --simulate",
    )


def _not_installed(facts: Facts, failure: str) -> Finding:
    """Return how to start a daemon where systemd has no unit for it."""
    foreground = f"litegripd {facts.channel}"
    option = f" --can {facts.bus_channel}" if facts.interface == "socketcan" else ""
    is_wrong = facts.configuration is not None and facts.configuration.error is not None
    advice = "not before the configuration is corrected; " if is_wrong else ""
    advice += "that is in the foreground; as a service, as root: litegripctl install-units"
    advice += f"{option}, which says what comes next; without hardware: {foreground} --simulate"
    return error(failure, foreground, advice)


def _systemctl(verb: str, facts: Facts) -> str | None:
    return None if facts.unit is None else f"sudo systemctl {verb} {facts.unit}"


def _closed(facts: Facts) -> list[str]:
    return [socket.path for socket in facts.sockets if not socket.is_accessible]


def _closed_directory(facts: Facts) -> tuple[str, str, str | None] | None:
    """Return the directory, or the socket, that is closed to all but its owner, if one is."""
    found = (socket.closed_by for socket in facts.sockets if socket.closed_by is not None)
    return next((closed for closed in found if closed[2] is None), None)


def _admit(facts: Facts) -> str | None:
    """Return the command that lets this user connect."""
    user = facts.user
    if user.has_group:
        return _systemctl("restart", facts)
    if user.group_exists and user.is_member:
        return f"newgrp {user.group}"
    join = f"sudo usermod --append --groups {user.group} {user.name}"
    if user.group_exists:
        return join
    make = f"sudo groupadd --system {user.group}"
    return f"{make} && {join}" if user.uid else make


def _then(facts: Facts) -> str:
    """Return the next steps; it is unknown if systemd runs the daemon."""
    login = "groups count from the next login on"
    if facts.user.group_exists or facts.is_remote:
        return login
    if facts.daemon is None and not facts.sockets:
        return f"the daemon looks for its group when it starts; {login}"
    return f"then start the daemon again, which looks for its group when it starts; {login}"
