"""`litegripd-fleet check`: looks at this machine's parts, and at what they reach; changes nothing.

Here the facts are gathered; what they mean is said in `findings`.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import grp
import os
import pwd
import shutil
import socket
import stat
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent import futures
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import zenoh

from litegrip_client.core.discovery import UNIT_DIRECTORIES, socket_paths
from litegrip_client.ctl.findings import Check, Finding, Found, error, findings_of, warning
from litegrip_client.threads.blocking import connect
from litegrip_client.values.errors import LiteGripError
from litegrip_client.values.version import client_version
from litegrip_fleet.admin import findings
from litegrip_fleet.admin.by_portal import ANSWER_WITHIN_S
from litegrip_fleet.admin.certificates import Certificate, CertificateError, authorities, met, own
from litegrip_fleet.admin.config import FleetConfig, FleetConfigError, PortalConfig, load
from litegrip_fleet.admin.findings import (
    DaemonFacts,
    EndpointFacts,
    FileFacts,
    FileKind,
    Kind,
    Measured,
    Unmeasured,
    parts_of,
)
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.network import CONNECT_WITHIN_S, NetworkError, Tls, close, opening
from litegrip_fleet.wire.site import look

ENDPOINT_WITHIN_S = 3.0
_STATES = 8
_SEEN_WITHIN_S = 1.0
_SYSTEMCTL_WITHIN_S = 5.0
_NO_ROUTE = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN)
_WILDCARDS = {"0.0.0.0": "127.0.0.1", "[::]": "::1"}  # noqa: S104 - compared with, not bound to


@dataclass(slots=True)
class Machine:
    """What the checks look at; what one of them has found out, and others need, is None before."""

    file: str
    now_s: float
    config: FleetConfig | None = None
    certificate: Certificate | None = None
    """The own one, where it can be used."""


def examine(file: str, now_s: float) -> list[tuple[str, Finding]]:
    """Return all findings by the names of their checks, at a Unix time."""
    machine = Machine(file, now_s)
    found = findings_of([Check("configuration", _configuration)], machine)
    if (config := machine.config) is None:
        return found
    return found + findings_of(_checks(config, config.network.tls), machine)


def _checks(config: FleetConfig, tls: Tls | None) -> Iterator[Check[Machine]]:
    """Yield what there is to look at, in the order in which it is read."""
    yield Check("encryption", lambda _: findings.of_encryption(insecure=config.insecure))
    if tls is not None:
        yield Check("key", lambda _: _files(tls, parts_of(config)))
        yield Check("certificate", lambda machine: _certificates(config, tls, machine))
    yield Check("unit", lambda _: _units(config))
    yield Check("daemon", lambda _: _daemons(config))
    yield Check("router", lambda machine: _router(config, machine.certificate))
    yield Check("network", lambda machine: _network(config, machine))


def _configuration(machine: Machine) -> Finding:
    file = machine.file
    if not Path(file).exists():
        return error(
            f"{file} is not there: this machine has no part of a fleet",
            "sudo litegripctl install-units --fleet",
            "it brings an example; docs/fleet.md says what to fill in",
        )
    if not os.access(file, os.R_OK):
        return warning(f"{file} is not for this user", findings.CHECK_AS_ROOT)
    try:
        machine.config = load(file)
    except FleetConfigError as problem:
        advice = "correct it: docs/fleet.md and etc/fleet.toml have examples"
        return error(str(problem), advice=advice)
    return findings.of_parts(machine.config)


# The own files ------------------------------------------------------------------------------------


def _files(tls: Tls, parts: Sequence[str]) -> Found:
    users = [user for part in parts if (user := _user_of(part)) is not None]
    are_others = bool(users) and os.getuid() not in {user.pw_uid for user in users}
    kinds: Mapping[FileKind, str] = {"ca": tls.ca, "certificate": tls.certificate, "key": tls.key}
    for kind, path in kinds.items():
        yield kind, findings.of_file(_file(kind, path, users), parts_are_others=are_others)


def _file(kind: FileKind, path: str, users: Sequence[pwd.struct_passwd]) -> FileFacts:
    try:
        mode = Path(path).stat().st_mode
        with Path(path).open("rb"):
            pass
    except FileNotFoundError:
        return FileFacts(kind, path, is_missing=True)
    except OSError as problem:
        return FileFacts(kind, path, problem.strerror or str(problem))
    closed_to = [user.pw_name for user in users if not _may_read(path, user)]
    return FileFacts(kind, path, mode=stat.S_IMODE(mode), closed_to=closed_to)


def _user_of(part: str) -> pwd.struct_passwd | None:
    """Return the user as whom systemd runs a part; None where there is none."""
    try:
        return pwd.getpwnam(f"litegrip-{part}")
    except KeyError:
        return None


def _groups(user: pwd.struct_passwd) -> list[int]:
    """Return a user's groups, with those that the units add."""
    groups = os.getgrouplist(user.pw_name, user.pw_gid)
    for name in ("litegrip", "litegrip-fleet"):
        with contextlib.suppress(KeyError):  # there is no such group: the user is in none
            groups.append(grp.getgrnam(name).gr_gid)
    return groups


def _may_read(path: str, user: pwd.struct_passwd) -> bool:
    """Return True if the modes let a user read a file, and pass through what leads to it."""
    if user.pw_uid == 0:
        return True
    groups = _groups(user)
    whole = Path(path).resolve()
    for one, right in ((whole, 4), *((parent, 1) for parent in whole.parents)):
        found = one.stat()
        shift = 6 if found.st_uid == user.pw_uid else 3 if found.st_gid in groups else 0
        if not found.st_mode >> shift & right:
            return False
    return True


def _certificates(config: FleetConfig, tls: Tls, machine: Machine) -> Found:
    if not all(os.access(path, os.R_OK) for path in (tls.ca, tls.certificate, tls.key)):
        return  # which was said of the files
    certificate: Certificate | str
    try:
        certificate = machine.certificate = own(tls, as_server=parts_of(config) == ["router"])
    except CertificateError as problem:
        certificate = str(problem)
    yield "certificate", findings.of_certificate(certificate, machine.now_s, tls.certificate)
    try:
        for signer in authorities(tls.ca):
            yield "authority", findings.of_certificate(signer, machine.now_s, tls.ca)
    except CertificateError as problem:
        yield "authority", error(str(problem), advice=findings.RENEW)
    if machine.certificate is not None:
        for finding in findings.of_identity(config, machine.certificate.common_name):
            yield "identity", finding


# The parts ----------------------------------------------------------------------------------------


def _units(config: FleetConfig) -> Found:
    """Ask systemd about each part's unit, where it has one."""
    program = shutil.which("systemctl")
    is_there = any(
        (Path(folder) / "litegripd-fleet@.service").exists() for folder in UNIT_DIRECTORIES
    )
    if program is None or not is_there or not Path("/run/systemd/system").exists():
        return
    for part in parts_of(config):
        done = subprocess.run(
            [program, "is-active", f"litegripd-fleet@{part}"],
            capture_output=True,
            text=True,
            timeout=_SYSTEMCTL_WITHIN_S,
            check=False,
        )
        yield "unit", findings.of_unit(part, done.stdout.strip())


def _daemons(config: FleetConfig) -> Found:
    """Ask each daemon of the gateway's, in its user's name where this one may."""
    if config.gateway is None:
        return
    user = _user_of("gateway")
    for name, channel in config.gateway.grippers.items():
        yield "daemon", findings.of_daemon(_daemon(name, channel, config.gateway.site, user))


def _daemon(name: str, channel: str, site: str, user: pwd.struct_passwd | None) -> DaemonFacts:
    is_possible = user is None or os.geteuid() in (0, user.pw_uid)
    who = user if user is not None else pwd.getpwuid(os.getuid())
    asked_as = who.pw_name if is_possible else None
    try:
        with _acting_as(user if is_possible else None):
            connection = connect(channel, None, ANSWER_WITHIN_S)
        with connection:
            hello = connection.call("hello", {"client": "litegripd-fleet check"})
            distrust = _distrust(connection, site) if is_possible else None
    except LiteGripError as problem:
        if not is_possible and _is_closed(channel):
            return DaemonFacts(name, channel)
        hint = problem.data.get("hint")
        return DaemonFacts(name, channel, problem=problem.message, hint=hint)
    return DaemonFacts(name, channel, str(hello["version"]), distrust=distrust, asked_as=asked_as)


def _is_closed(channel: str) -> bool:
    """Return True if a daemon of this machine has a socket that this user may not open."""
    return any(
        os.path.lexists(path) and not os.access(path, os.W_OK) for path in socket_paths(channel)
    )


def _distrust(connection: Any, site: str) -> str | None:
    """Return why a daemon does not let this connection speak for remote users, or None."""
    try:
        connection.call("hello", {"on_behalf": f"check@{site}", "role": "observer"})
    except LiteGripError as refused:
        return refused.message
    return None


@contextlib.contextmanager
def _acting_as(user: pwd.struct_passwd | None) -> Iterator[None]:
    """Connect as another user, as root can: a daemon is shown whom a connection was made by."""
    if user is None or os.geteuid() != 0:
        yield
        return
    groups, gid = os.getgroups(), os.getegid()
    os.setgroups(_groups(user))
    os.setegid(user.pw_gid)
    os.seteuid(user.pw_uid)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(gid)
        os.setgroups(groups)


def _router(config: FleetConfig, certificate: Certificate | None) -> Found:
    """Look at this machine's own router."""
    if config.router is None:
        return
    tls = config.network.tls
    for endpoint in config.router.listen:
        facts = _met(_wildcard_as_local(endpoint), tls, check_name=False)
        yield "router", findings.of_listening(facts, certificate)
    if tls is not None and certificate is not None:
        for name in _names(config.router.listen):
            try:
                own(tls, as_server=True, name=name)
                problem = None
            except CertificateError as refused:
                problem = str(refused)
            yield "names", findings.of_names(certificate, name, problem)


def _names(listen: Sequence[str]) -> list[str | None]:
    """Return the hosts that the endpoints name; None for every address."""
    hosts = [parts[1] for parts in map(_parts_of, listen) if parts is not None]
    return [None if host in _WILDCARDS else host.strip("[]") for host in dict.fromkeys(hosts)]


def _wildcard_as_local(endpoint: str) -> str:
    for wildcard, local in _WILDCARDS.items():
        endpoint = endpoint.replace(f"/{wildcard}:", f"/{f'[{local}]' if ':' in local else local}:")
    return endpoint


# The network --------------------------------------------------------------------------------------


def _network(config: FleetConfig, machine: Machine) -> Found:
    """Look at the routers, and by them at the grippers; the portal's sockets need neither."""
    now_s = machine.now_s
    if config.network.tls is not None and machine.certificate is None:
        yield from _grippers(config, None)
        return
    tls = config.network.tls
    with futures.ThreadPoolExecutor() as several:
        routers = list(several.map(lambda endpoint: _met(endpoint, tls), config.network.connect))
    for router in routers:
        yield "network", findings.of_endpoint(router, now_s)
    certificates = [one.certificate for one in routers if one.certificate is not None]
    if (clock := findings.of_clock(certificates, now_s)) is not None:
        yield "clock", clock
    session = None
    if any(router.kind is None for router in routers):
        try:
            session = opening(config.network).result(CONNECT_WITHIN_S)
        except (NetworkError, futures.TimeoutError):
            where = ", ".join(config.network.connect)
            yield "network", findings.of_no_session(where, CONNECT_WITHIN_S)
    try:
        yield from _grippers(config, session)
    finally:
        if session is not None:
            close(session)


def _grippers(config: FleetConfig, session: zenoh.Session | None) -> Found:
    """Look for the grippers that this machine offers, and for those that it uses."""
    if config.gateway is not None and session is not None:
        for place in config.gateway.places:
            yield "offered", findings.of_offered(place, is_seen=_is_seen(session, place))
    if config.portal is None:
        return
    about = {} if session is None else asyncio.run(_about(session, config.portal.grippers))
    with futures.ThreadPoolExecutor() as several:
        measured = several.map(partial(_measured, config.portal), config.portal.grippers)
        for place, socket_facts in zip(config.portal.grippers, measured, strict=True):
            if session is not None:
                yield "gripper", findings.of_remote(place, about.get(place))
            yield from findings.of_socket(place, socket_facts, client_version())


def _is_seen(session: zenoh.Session, place: Place) -> bool:
    """Return True if a gripper's token is there; who has just connected may not see it at once."""
    ends_s = time.monotonic() + _SEEN_WITHIN_S
    while True:
        replies = session.liveliness().get(place.alive, timeout=_SEEN_WITHIN_S)
        if any(reply.ok is not None for reply in replies):
            return True
        if time.monotonic() > ends_s:
            return False
        time.sleep(0.05)


async def _about(
    session: zenoh.Session, places: Sequence[Place]
) -> Mapping[Place, Mapping[str, Any]]:
    """Return what the gateways say of the grippers, without those that were not found."""
    ends_s = time.monotonic() + _SEEN_WITHIN_S
    found: dict[Place, Mapping[str, Any]] = {}
    while True:
        for site in {place.site for place in places}:
            found |= {one.place: one.facts for one in await look(session, site)}
        if found.keys() >= set(places) or time.monotonic() > ends_s:
            return found


def _measured(portal: PortalConfig, place: Place) -> Measured | Unmeasured:
    """Ask a gripper some times, by the portal's socket, as every program here does."""
    path = portal.socket_path(place)
    try:
        with connect(str(place), path, ANSWER_WITHIN_S) as connection:
            hello = connection.call("hello", {"client": "litegripd-fleet check"})
            round_trips_s, ages_s = [], []
            for _ in range(_STATES):
                begun_s = time.monotonic()
                ages_s.append(connection.call("state.get").get("age_s"))
                round_trips_s.append(time.monotonic() - begun_s)
            return Measured(hello, round_trips_s, ages_s)
    except LiteGripError as failure:
        is_closed = Path(path).exists() and not os.access(path, os.W_OK)
        return Unmeasured(failure.message, failure.reason == "no_daemon", is_closed)


def _met(endpoint: str, tls: Tls | None, *, check_name: bool = True) -> EndpointFacts:
    """Meet who listens at an endpoint of zenoh's, and shake hands with it where it has TLS."""
    parts = _parts_of(endpoint)
    if parts is None:
        return EndpointFacts(endpoint, None, "endpoint", "is no endpoint")
    protocol, host, port = parts
    if protocol != ("tcp" if tls is None else "tls"):
        text = (
            f"{protocol}/ is not encrypted by the certificates, or not known here"
            if tls is not None
            else f"{protocol}/ needs certificates"
        )
        return EndpointFacts(endpoint, None, "endpoint", text)
    host = host.strip("[]")
    try:
        if tls is None:
            socket.create_connection((host, port), ENDPOINT_WITHIN_S).close()
            return EndpointFacts(endpoint)
        return EndpointFacts(
            endpoint, met(host, port, tls, ENDPOINT_WITHIN_S, check_name=check_name)
        )
    except CertificateError as refused:
        kind: Kind = "certificate"
        problem = str(refused)
    except socket.gaierror as failure:
        kind, problem = "unknown_host", f"{host} is not known: {failure.strerror}"
    except ConnectionRefusedError:
        kind, problem = "refused", "connection refused"
    except TimeoutError:
        kind, problem = "timeout", f"no answer within {ENDPOINT_WITHIN_S:g} s"
    except OSError as failure:
        kind = "no_route" if failure.errno in _NO_ROUTE else "other"
        problem = failure.strerror or str(failure)
    return EndpointFacts(endpoint, None, kind, problem)


def _parts_of(endpoint: str) -> tuple[str, str, int] | None:
    """Return protocol, host and port of zenoh's PROTOCOL/HOST:PORT, None for anything else."""
    protocol, slash, rest = endpoint.partition("/")
    host, colon, port = rest.partition("?")[0].partition("#")[0].rpartition(":")
    if not slash or not colon or not host or not port.isascii() or not port.isdigit():
        return None
    return protocol, host, int(port)
