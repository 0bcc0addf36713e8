"""What `litegripd-fleet check` finds in the facts that it has gathered; nothing is asked here.

Each function takes facts, and the Unix time where that matters. A finding names the command or the
edit that repairs what is wrong.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Literal, TypeAlias

from litegrip_client.ctl.findings import Finding, Found, error, ok, warning
from litegrip_client.line.exchange import PROTOCOL
from litegrip_fleet.admin.access import ROLES
from litegrip_fleet.admin.certificates import (
    WARN_BELOW_S,
    Certificate,
    date,
    problem_of_dates,
    time_left,
)
from litegrip_fleet.admin.config import FleetConfig, GatewayConfig, PortalConfig
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.lateness import MOTION_COUNTS_S, SET_POINT_COUNTS_S

SLOW_WAY_S = 0.1
"""From so long a way (half of the round trip) on, some set-points come too late to count."""

CHECK_AS_ROOT = "sudo litegripd-fleet check"
RENEW = (
    "where the authority's ca.key is: etc/zenoh-certificates DIRECTORY NAME (user:NAME,"
    " gateway:NAME); copy DIRECTORY/NAME/ here, then restart the parts"
)
_LET_READ = (
    "sudo chgrp -R litegrip-fleet {folder} && sudo chmod -R u=rwX,g=rX,o= {folder}",
    "the group has the users of all three parts",
)


# The files of TLS ---------------------------------------------------------------------------------

FileKind: TypeAlias = Literal["ca", "certificate", "key"]


@dataclass(frozen=True, slots=True)
class FileFacts:
    """A file of TLS: what keeps this user from it, None where nothing does, and who may read it.

    `closed_to` are the users of parts that may not.
    """

    kind: FileKind
    path: str
    problem: str | None = None
    is_missing: bool = False
    mode: int = 0o640
    closed_to: Sequence[str] = ()


def of_file(file: FileFacts, *, parts_are_others: bool) -> Finding:
    """Judge a file; `parts_are_others`: the parts run as users of their own."""
    folder = file.path.rpartition("/")[0] or "."
    command, advice = _LET_READ
    command = command.format(folder=folder)
    if file.is_missing:
        return error(f"{file.path} is not there", advice=RENEW)
    if file.kind == "key" and file.mode & 0o007:
        return error(
            f"{file.path} is open to every user of this machine, who can then act in its name",
            f"sudo chmod o= {file.path}",
        )
    if file.closed_to:
        return error(f"{', '.join(file.closed_to)} may not read {file.path}", command, advice)
    if file.problem is None:
        return ok(file.path)
    text = f"{file.path} was not checked: {file.problem}"
    if parts_are_others:
        return warning(text, CHECK_AS_ROOT)
    return error(text, command, advice)


# Certificates -------------------------------------------------------------------------------------


_TELEOPERATION = "litegrip teleoperation"
"""How etc/zenoh-certificates calls an authority of leaders and followers; that of a fleet is called
"litegrip fleet"."""


def of_certificate(certificate: Certificate | str, now_s: float, file: str) -> Finding:
    """Judge the own certificate or an authority's; of the own one, say why it cannot be used."""
    if isinstance(certificate, str):
        return error(f"{file} {certificate}", advice=RENEW)
    found = _of_dates(certificate, now_s, f"{certificate.common_name}, {file},")
    if found.level != "ok" or certificate.common_name != _TELEOPERATION:
        return found
    return warning(
        f"{file} is teleoperation's authority: each machine with a certificate of it is let in by"
        " the router, and nobody need have listed it",
        advice="etc/zenoh-certificates NEW_DIRECTORY ROUTER gateway:NAME user:NAME makes an"
        " authority for the fleet alone",
    )


def _of_dates(certificate: Certificate, now_s: float, called: str) -> Finding:
    problem = problem_of_dates(certificate, now_s)
    if problem is not None:
        is_early = now_s < certificate.from_s
        return error(f"{called} {problem}", advice=_CLOCK if is_early else RENEW)
    text = f"{called} {time_left(certificate, now_s)}"
    is_short = certificate.until_s - now_s < WARN_BELOW_S
    return warning(text, advice=RENEW) if is_short else ok(text)


_CLOCK = (
    "set this machine's clock (timedatectl); if that is right, the certificate was made on a"
    " machine whose clock is wrong: set that one, and make the certificate again"
)


def of_clock(certificates: Iterable[Certificate], now_s: float) -> Finding | None:
    """Compare this machine's date with the certificates of others: the only use of a wall clock."""
    known = list(certificates)
    if not known:
        return None
    early = [one for one in known if now_s < one.from_s]
    if early:
        worst = max(early, key=lambda one: one.from_s)
        return error(
            f"here it is {date(now_s)}, but {worst.common_name}'s certificate was made for"
            f" {date(worst.from_s)} and later",
            "timedatectl",
            _CLOCK,
        )
    return ok(f"{date(now_s)} agrees with the others' certificates; nothing else needs this clock")


def of_identity(config: FleetConfig, name: str) -> Sequence[Finding]:
    """Judge whether the certificate's name is the one that the tables have; `name` is its own."""
    found = [] if config.portal is None else [_of_user(config, config.portal, name)]
    return found if config.gateway is None else [*found, _of_gateway(config, config.gateway, name)]


def _of_user(config: FleetConfig, portal: PortalConfig, name: str) -> Finding:
    user, wanted = portal.user, portal.role
    if user != name:
        return error(
            f"[portal] user is {user!r}, the certificate is that of {name!r}: the router"
            " lets nobody ask by another name",
            advice=f"copy the certificate of {user} here; only if {name!r} is in the"
            f" router's [router.users], set user = {name!r} instead",
        )
    if config.router is None:
        return ok(f"{name} is the user of [portal]")
    users = config.router.users
    if user not in users:
        return error(
            f"{user} is not in [router.users]",
            advice=f'add {user} = "{wanted}" in {config.source}, then restart the router',
        )
    if ROLES.index(users[user]) < ROLES.index(wanted):
        return error(
            f"[portal] role is {wanted}, [router.users] lets {user} be {users[user]}",
            advice="change one of them; the router's rules are read when it starts",
        )
    return ok(f"{user} is the user of [portal], and {users[user]} by [router.users]")


def _of_gateway(config: FleetConfig, gateway: GatewayConfig, name: str) -> Finding:
    places = list(map(str, gateway.places))
    if config.router is None:
        listed = ", ".join(f'"{place}"' for place in places)
        return ok(f"the router needs {name} = [{listed}] in [router.gateways]")
    allowed = set(map(str, config.router.gateways.get(name, ())))
    missing = [place for place in places if place not in allowed]
    if missing:
        return error(
            f"[router.gateways] does not let {name} offer {', '.join(missing)}",
            advice=f"add them in {config.source}, then restart the router",
        )
    return ok(f"{name} may offer {', '.join(places)} by [router.gateways]")


# The router ---------------------------------------------------------------------------------------

Kind: TypeAlias = Literal[
    "refused", "timeout", "no_route", "unknown_host", "certificate", "endpoint", "other"
]


@dataclass(frozen=True, slots=True)
class EndpointFacts:
    """Where a router is to be met: its certificate, or of which kind the problem is, and which."""

    endpoint: str
    certificate: Certificate | None = None
    kind: Kind | None = None
    problem: str = ""


_ADVICE: Mapping[Kind, str] = {
    "refused": "nothing listens there: is the port right, and does the router run? On its machine:"
    " systemctl status litegripd-fleet@router",
    "timeout": "is the host right, does it run, does a firewall drop the port? Try: ping, nc -zv",
    "no_route": "is this machine's network up (ip address), is the cable in, is the host right, and"
    " does it run?",
    "unknown_host": "correct the name in [network] connect, or add it to DNS or /etc/hosts",
    "certificate": "connect by a name that is in the router's certificate, and let both ends have"
    " the same ca; another one is made by: etc/zenoh-certificates DIRECTORY HOST",
    "endpoint": 'write it as "tls/HOST:PORT"',
    "other": "is it a router that listens there? On its machine: litegripd-fleet check",
}


def of_endpoint(facts: EndpointFacts, now_s: float) -> Finding:
    """Judge the way to a router."""
    if facts.kind is not None:
        return error(f"{facts.endpoint}: {facts.problem}", advice=_ADVICE[facts.kind])
    if facts.certificate is None:
        return ok(f"{facts.endpoint} answers")
    return _of_dates(facts.certificate, now_s, f"{facts.endpoint} answers; its certificate")


def of_no_session(where: str, within_s: float) -> Finding:
    """Say that who answers at an endpoint is no router, or lets nobody in."""
    return error(
        f"{where} answers, and gives no session of zenoh within {within_s:g} s",
        advice="if nothing is wrong with the own certificate above, does a router listen there? On"
        " its machine: litegripd-fleet check",
    )


def of_listening(facts: EndpointFacts, own: Certificate | None) -> Finding:
    """Judge whether this machine's router listens, with the certificate of its file."""
    if facts.kind is not None:
        text, advice = f"{facts.endpoint}: {facts.problem}", "journalctl -u litegripd-fleet@router"
        if facts.kind == "endpoint":
            return error(text, advice=_ADVICE["endpoint"])
        command = "sudo systemctl enable --now litegripd-fleet@router"
        return error(text, command, f"if it runs, see why: {advice}")
    shown = facts.certificate
    if shown is not None and own is not None and shown.serial != own.serial:
        return warning(
            f"{facts.endpoint} still shows the certificate from before, valid until"
            f" {date(shown.until_s)}",
            "sudo systemctl restart litegripd-fleet@router",
            "that ends all sessions of remote users",
        )
    return ok(f"{facts.endpoint} listens")


def of_names(own: Certificate, named: str | None, problem: str | None) -> Finding:
    """Judge the names of the router's certificate; `problem` is why it is not good as one.

    `named` is the host where it listens, None for every address.
    """
    if problem is not None:
        where = "" if named is None else f" ({named})"
        return error(f"the router's certificate {problem}{where}", advice=RENEW)
    if not own.names:
        return error("the router's certificate has no host name", advice=RENEW)
    return ok(f"others reach this router as {', '.join(own.names)}, and by no other name")


# The parts ----------------------------------------------------------------------------------------


def of_unit(part: str, state: str) -> Finding:
    """Judge a part's unit by what `systemctl is-active` says."""
    unit = f"litegripd-fleet@{part}"
    if state == "active":
        return ok(f"{unit} is active")
    see = f"see why: journalctl -u {unit}"
    if state in ("failed", "activating"):
        return error(f"{unit} is {state}: it ends again and again", f"journalctl -u {unit}")
    return error(f"{unit} is {state or 'unknown'}", f"sudo systemctl enable --now {unit}", see)


@dataclass(frozen=True, slots=True)
class DaemonFacts:
    """A daemon of [gateway.grippers]: whether it answers, and trusts the gateway's user.

    `distrust` is its answer where it does not; `asked_as` who asked, None where it could not be
    asked in that user's name.
    """

    name: str
    channel: str
    version: str | None = None
    problem: str | None = None
    hint: str | None = None
    distrust: str | None = None
    asked_as: str | None = None


def of_daemon(facts: DaemonFacts) -> Finding:
    """Judge a daemon of this machine, for the gateway."""
    called = f"{facts.name} ({facts.channel})"
    if facts.problem is not None:
        return error(f"{called}: {facts.problem}", advice=facts.hint)
    if facts.asked_as is None and facts.version is None:
        return warning(f"{called} was not asked: this user may not", CHECK_AS_ROOT)
    if facts.asked_as is None:
        return warning(
            f"{called} answers, {facts.version}; not known: does it trust litegrip-gateway?",
            CHECK_AS_ROOT,
        )
    if facts.distrust is not None:
        return error(
            f"{called} does not let {facts.asked_as} speak for remote users: {facts.distrust}",
            f"sudo systemctl reload litegripd@{facts.channel}",
            f'first add to its configuration: [access] gateways = ["{facts.asked_as}"],'
            f' operators = ["{facts.asked_as}"]',
        )
    return ok(f"{called} answers, {facts.version}, and trusts {facts.asked_as}")


def of_offered(place: Place, is_seen: bool) -> Finding:
    """Judge whether a gripper of this machine's gateway is on the network."""
    if is_seen:
        return ok(f"{place} is on the network")
    return error(
        f"{place} is not seen on the network, though a router answers",
        "systemctl status litegripd-fleet@gateway",
        "the gateway does not run, its daemon does not answer, or the router's [router.gateways]"
        f" does not list {place} for this machine's certificate",
    )


# Remote grippers ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Measured:
    """What a portal's socket answered: `hello`, and the round trips and ages of some states."""

    hello: Mapping[str, Any]
    round_trips_s: Sequence[float]
    ages_s: Sequence[float | None]


@dataclass(frozen=True, slots=True)
class Unmeasured:
    """Why a portal's socket did not answer; `is_silent`: nobody listens there.

    `is_closed`: this user may not connect.
    """

    problem: str
    is_silent: bool
    is_closed: bool


def of_remote(place: Place, about: Mapping[str, Any] | None) -> Finding:
    """Judge what a remote gripper's gateway says of it; None where none was found."""
    if about is None:
        return error(
            f"{place} is not on the network",
            advice="is this machine's user in the router's [router.users]? Who is not sees no"
            " gripper. On the gripper's machine: does the gateway run, and is the gripper in its"
            " [gateway.grippers] and in the router's [router.gateways]? litegripd-fleet check"
            " says so there",
        )
    if "error" in about:
        return error(f"{place}: {about['error']}", advice="on its machine: litegripd-fleet check")
    if kept_out := about.get("kept_out"):
        times = "once" if kept_out == 1 else f"{kept_out} times"
        return warning(
            f"{place} is on the network; {times} since its gateway began, somebody else was"
            " connected with its id and kept it out, until it came by another",
            "journalctl -u litegripd-fleet@router",
            "on the router's machine, that says by whose certificate; then make a new authority,"
            " and certificates for everybody else",
        )
    return ok(f"{place} is on the network; its daemon's verdict is {about.get('verdict')}")


def of_socket(place: Place, facts: Measured | Unmeasured, version: str) -> Found:
    """Judge a remote gripper's socket; `version` is that of this machine's programs."""
    if isinstance(facts, Measured):
        yield "portal", ok(f"{place} answers at the portal's socket")
        yield "versions", _of_versions(place, facts.hello, version)
        yield "time", _of_time(place, facts)
        return
    text = f"{place}: {facts.problem}"
    if facts.is_closed:
        command = "sudo usermod --append --groups litegrip $USER"
        yield "portal", warning(text, command, "then log in again")
    elif facts.is_silent:
        command, why = "sudo systemctl enable --now litegripd-fleet@portal", "if it runs, see why:"
        yield "portal", error(text, command, f"{why} journalctl -u litegripd-fleet@portal")
    else:
        advice = (
            "the portal runs; if nothing else that is found says what is in its way: sudo"
            " litegripd-fleet check, here, then on the router's and on the gripper's machine"
        )
        yield "portal", error(text, advice=advice)


def _of_versions(place: Place, hello: Mapping[str, Any], version: str) -> Finding:
    remote = hello.get("remote") or {}
    daemon, gateway, portal = hello.get("version"), remote.get("gateway"), remote.get("portal")
    named = f"{place}: daemon {daemon}, gateway {gateway}, portal {portal}, here {version}"
    if hello.get("protocol") != PROTOCOL:
        return warning(
            f"{named}; its daemon speaks protocol {hello.get('protocol')}, this version {PROTOCOL}",
            advice="install the same major version on both machines",
        )
    return ok(named if {daemon, gateway, portal} != {version} else f"{place}: {version} everywhere")


def _of_time(place: Place, measured: Measured) -> Finding:
    """Judge how long things take.

    A portal reckons the gripper's clock by the quickest round trip; half of that bounds its error,
    and so what age a motion seems to have.
    """
    usual_s, best_s = median(measured.round_trips_s), min(measured.round_trips_s)
    ages_s = [age_s for age_s in measured.ages_s if age_s is not None]
    age = f"{median(ages_s) * 1e3:.0f} ms" if ages_s else "unknown"
    text = (
        f"{place}: round trip {usual_s * 1e3:.1f} ms, age of the state {age}, error of the clock"
        f" at most {best_s / 2 * 1e3:.1f} ms"
    )
    if usual_s / 2 > SET_POINT_COUNTS_S:
        return error(
            f"{text}: no set-point can arrive within the {SET_POINT_COUNTS_S:g} s that it counts,"
            f" motions have {MOTION_COUNTS_S:g} s",
            advice="use a quicker network; look for what loads it, the machines or Wi-Fi",
        )
    if usual_s / 2 > SLOW_WAY_S:
        return warning(
            f"{text}: set-points count {SET_POINT_COUNTS_S:g} s, some will come too late",
            advice="use a quicker network; look for what loads it, the machines or Wi-Fi",
        )
    return ok(text)


# All ----------------------------------------------------------------------------------------------


def of_encryption(*, insecure: bool) -> Finding | None:
    """Say that nothing is encrypted, where that is so."""
    if not insecure:
        return None
    return warning(
        "insecure = true: nothing is encrypted, and everybody on the network may do everything",
        advice="etc/zenoh-certificates makes certificates; then name ca, certificate and key in"
        " [network], and remove insecure",
    )


def of_parts(config: FleetConfig) -> Finding:
    """Say which parts this machine has."""
    parts = parts_of(config)
    if parts:
        return ok(f"{config.source}: {', '.join(parts)}")
    return warning(
        f"{config.source} has neither [gateway] nor [portal] nor [router]: nothing runs here",
        advice="fill in the table that this machine needs",
    )


def parts_of(config: FleetConfig) -> list[str]:
    """Return the parts that this machine has."""
    return [part for part in ("gateway", "portal", "router") if getattr(config, part) is not None]
