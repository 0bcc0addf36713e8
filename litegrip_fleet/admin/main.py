"""The command `litegripd-fleet`: gateway, portal and router, and what is done with a site."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import zenoh

from litegrip_client.core.sockets import SOCKET_VARIABLE
from litegrip_client.core.stop import WHY_CHARACTERS
from litegrip_client.ctl.findings import as_data, as_text, is_well
from litegrip_client.values.repeats import RepeatsHandler, poll_handlers
from litegrip_fleet.admin import by_portal
from litegrip_fleet.admin.access import rules
from litegrip_fleet.admin.acl_check import UnreadableError, access_control_in, wider
from litegrip_fleet.admin.certificates import Certificate, CertificateError, own, watch
from litegrip_fleet.admin.check import examine
from litegrip_fleet.admin.config import FleetConfig, FleetConfigError, PortalConfig, load
from litegrip_fleet.admin.guests import Guests
from litegrip_fleet.admin.options import (
    EXIT_FAILED,
    EXIT_NETWORK,
    EXIT_OK,
    EXIT_USAGE,
    make_parser,
)
from litegrip_fleet.admin.stopping import stop_site
from litegrip_fleet.far.dead_man import DeadMansSwitch
from litegrip_fleet.far.gateway import Gateway
from litegrip_fleet.far.together import Together as FarTogether
from litegrip_fleet.near.portal import Portal
from litegrip_fleet.near.together import Together as NearTogether
from litegrip_fleet.wire.keys import BadNameError, check_name
from litegrip_fleet.wire.membership import Membership
from litegrip_fleet.wire.network import (
    Network,
    NetworkError,
    close,
    cut,
    hand_over,
    opened,
    reached,
    the_newest,
)
from litegrip_fleet.wire.site import About, Stopped, look

_NOT_SENT = "; no stop was sent: use the switch that cuts the power"
_LOOK = "look with: litegripd-fleet check"
_log = logging.getLogger("litegripd-fleet")


def run() -> NoReturn:
    """Run the command, and end at once.

    zenoh's threads may hold up the end of Python for good (zenoh-python issue 434).
    """
    code = main()
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    arguments = make_parser().parse_args(argv)
    logging.basicConfig(format="%(message)s", level=logging.INFO, handlers=[RepeatsHandler()])
    # It is one gripper of the shell: all of a gateway's would be that one.
    os.environ.pop(SOCKET_VARIABLE, None)
    try:
        if arguments.command == "check":
            return _check(arguments)
        return int(_COMMANDS[arguments.command](load(arguments.config), arguments))
    except (FleetConfigError, BadNameError, UnreadableError) as error:
        not_sent = _NOT_SENT if arguments.command == "stop" else ""
        return _fail(f"{error}{not_sent}", EXIT_USAGE)
    except NetworkError as error:
        return _fail(str(error), EXIT_NETWORK)
    except OSError as error:
        return _fail(str(error), EXIT_FAILED)


# Services -----------------------------------------------------------------------------------------


def _gateway(config: FleetConfig, _arguments: argparse.Namespace) -> int:
    part = config.gateway
    if part is None:
        raise FleetConfigError(f"{config.source}: there is no [gateway]")
    certificate = _begun(config)

    async def on_network(switch: DeadMansSwitch | None) -> None:
        network = Membership(config.network)
        looking = asyncio.create_task(network.run())
        try:
            await asyncio.wrap_future(network.begun)
            together = FarTogether(network, next(iter(part.places)))
            gateways = [
                Gateway(network, place, channel, together, switch)
                for place, channel in part.places.items()
            ]
            await asyncio.gather(looking, together.run(), *(gateway.run() for gateway in gateways))
        finally:
            network.close()

    async def serve() -> None:
        if not part.stop_when_silent:
            await on_network(None)
            return
        switch = DeadMansSwitch(part.places, part.stop_when_silent, part.stop_level)
        with switch.running() as watching:
            await asyncio.gather(on_network(switch), asyncio.wrap_future(watching))

    return asyncio.run(_until_a_signal(serve, certificate))


def _portal(config: FleetConfig, _arguments: argparse.Namespace) -> int:
    part = config.portal
    if part is None:
        raise FleetConfigError(f"{config.source}: there is no [portal]")
    certificate = _begun(config)

    async def serve() -> None:
        network = Membership(config.network)
        together = NearTogether(lambda: network.session, part.user, part.role)
        portals = [
            Portal(
                lambda: network.session,
                place,
                Path(part.socket_path(place)),
                together,
                user=part.user,
                role=part.role,
                ttl_s=part.ttl_s,
                router=config.network.connect,
                insecure=config.insecure,
                certificate_expires_s=None if certificate is None else certificate.until_s,
            )
            for place in part.grippers
        ]
        try:
            await asyncio.gather(
                asyncio.wrap_future(network.begun),
                network.run(),
                together.run(),
                *(portal.run() for portal in portals),
            )
        finally:
            network.close()

    return asyncio.run(_until_a_signal(serve, certificate))


def _router(config: FleetConfig, _arguments: argparse.Namespace) -> int:
    certificate = _begun(config, as_server=True)
    part, network = config.router, _router_network(config)

    async def serve() -> None:
        session = opened(network, "router")
        _log.info("listening at %s", ", ".join(network.listen))
        if part is not None and network.rules is not None:
            guests = Guests(part.users, part.gateways)
            coming = session.info.declare_link_events_listener(the_newest(), history=True)
            hand_over(coming, partial(_noted, session, guests), "guests")
        try:
            await asyncio.Event().wait()
        finally:
            close(session)

    return asyncio.run(_until_a_signal(serve, certificate))


def _noted(session: zenoh.Session, guests: Guests, event: zenoh.LinkEvent) -> None:
    name = event.link.auth_identifier
    if name is not None and event.kind == zenoh.SampleKind.PUT:
        guests.came(name, str(event.link.zid))
        present = ((link.auth_identifier, link.dst) for link in session.info.links())
        cut(guests.without_room((named, address) for named, address in present if named))


def _router_network(config: FleetConfig) -> Network:
    part = config.router
    if part is None:
        raise FleetConfigError(f"{config.source}: there is no [router]")
    own = None if config.insecure else rules(part.users, part.gateways)
    return Network(config.network.connect, part.listen, config.network.tls, own)


async def _until_a_signal(
    serve: Callable[[], Coroutine[Any, Any, None]], certificate: Certificate | None
) -> int:
    """Run a service until SIGTERM or SIGINT, and watch how long its certificate is good.

    The loop's own way to hear of signals loses them when its pipe is full, as in a flood of stops.
    """
    ending = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_received: loop.call_soon_threadsafe(ending.set))
    serving = asyncio.create_task(serve())
    waiting = asyncio.create_task(ending.wait())
    # Where there is no certificate, there is nothing to watch.
    watched = asyncio.Event().wait() if certificate is None else watch(certificate)
    watching = asyncio.create_task(watched)
    polling = asyncio.create_task(poll_handlers())
    await asyncio.wait((serving, waiting, watching), return_when=asyncio.FIRST_COMPLETED)
    for task in (serving, waiting, watching, polling):
        task.cancel()
    ended = await asyncio.gather(serving, watching, return_exceptions=True)
    for problem in ended:
        if isinstance(problem, Exception):
            raise problem
    return EXIT_OK


def _begun(config: FleetConfig, *, as_server: bool = False) -> Certificate | None:
    """Say what is wrong with the own protection; return the certificate that a part begins with.

    One that cannot be used is zenoh's to refuse.
    """
    tls = config.network.tls
    if tls is None:
        _log.warning("insecure = true: nothing is encrypted, and everybody may do everything")
        return None
    try:
        return own(tls, as_server=as_server)
    except (CertificateError, OSError) as error:
        _log.error("%s %s; %s", tls.certificate, error, _LOOK)
        return None


# Commands -----------------------------------------------------------------------------------------


def _check(arguments: argparse.Namespace) -> int:
    found = examine(arguments.config, time.time())
    as_json = arguments.json
    print(json.dumps(as_data(found, file=arguments.config)) if as_json else as_text(found))
    return EXIT_OK if is_well(found) else EXIT_FAILED


def _acl(config: FleetConfig, arguments: argparse.Namespace) -> int:
    made = _router_network(config).rules
    if arguments.check is None:
        print(json.dumps({"access_control": made}, indent=2))
        return EXIT_OK
    if made is None:
        raise FleetConfigError(f"{config.source}: insecure = true: there are no rules to check by")
    found = wider(access_control_in(arguments.check), made)
    print(*found or [f"{arguments.check} allows nothing beyond {config.source}"], sep="\n")
    return EXIT_FAILED if found else EXIT_OK


def _list(config: FleetConfig, arguments: argparse.Namespace) -> int:
    site = _site(arguments.site)
    if (portal := _only_by_portal(config)) is not None:
        found = by_portal.look(portal, site)
    else:
        with _connected(config) as session:
            found = asyncio.run(look(session, site))
    if arguments.json:
        rows = [{"gripper": str(one.place), "after_s": one.after_s, **one.facts} for one in found]
        print(json.dumps(rows))
    else:
        _print_table(found)
    return EXIT_OK if all("error" not in one.facts for one in found) else EXIT_FAILED


def _print_table(found: Sequence[About]) -> None:
    if not found:
        print("no gripper was found")
        return
    width = max(7, *(len(str(one.place)) for one in found))
    form = f"{{:<{width}}}  {{:<9}}{{:<10}}{{:<10}}{{:<8}}{{:<9}}{{}}"
    print(form.format("GRIPPER", "VERSION", "VERDICT", "MODE", "AGE", "ANSWER", "OWNER"))
    for one in found:
        facts, after = one.facts, f"{one.after_s * 1e3:.0f} ms"
        if silent := facts.get("silent"):
            print(f"{one.place!s:<{width}}  stopped while silent: {', '.join(silent)}")
        if "error" in facts:
            print(f"{one.place!s:<{width}}  {facts['error']}")
            continue
        age = "--" if facts["age_s"] is None else f"{facts['age_s'] * 1e3:.0f} ms"
        words = (facts["version"], facts["verdict"], facts["mode"])
        print(form.format(str(one.place), *words, age, after, facts["owner"] or "--"))


def _stop(config: FleetConfig, arguments: argparse.Namespace) -> int:
    site, part, why = _site(arguments.site), config.portal, (arguments.why or "")[:WHY_CHARACTERS]
    if part is None:
        raise FleetConfigError(f"{config.source}: a stop needs the [portal], whose user it is of")
    endpoints = config.network.connect if _only_by_portal(config) is None else ()
    networks = [replace(config.network, connect=[endpoint]) for endpoint in endpoints]
    stopped, sessions = stop_site(networks, part, site, arguments.level, why or None)
    # Before the sessions are closed: a network that does not answer holds that up.
    code = _report(stopped, arguments)
    sys.stdout.flush()
    sessions.close()
    return code


def _report(stopped: Stopped, arguments: argparse.Namespace) -> int:
    for text in stopped.lost:
        print(f"litegripd-fleet: {text}", file=sys.stderr)
    if arguments.json:
        data = {
            "ok": stopped.ok,
            "confirmed": {str(place): after_s for place, after_s in stopped.confirmed.items()},
            "failed": {str(place): problem for place, problem in stopped.failed.items()},
            "silent": [str(place) for place in stopped.silent],
            "lost": list(stopped.lost),
            "is_whole": stopped.is_whole,
        }
        print(json.dumps(data))
        return EXIT_OK if stopped.ok else EXIT_FAILED
    for place, after_s in sorted(stopped.confirmed.items()):
        print(f"{place}: stopped ({after_s * 1e3:.0f} ms)")
    for place, problem in sorted(stopped.failed.items()):
        print(f"{place}: NOT confirmed: {problem}")
    for place in stopped.silent:
        print(f"{place}: NOT confirmed: silent")
    if not stopped.confirmed and not stopped.failed and not stopped.silent:
        print("no gripper was found")
    if not stopped.is_whole:
        print("NOT stopped: other grippers of the site, if there are any beside this portal's")
    if not stopped.ok:
        print("This is no emergency stop: use the switch that cuts the power.", file=sys.stderr)
    return EXIT_OK if stopped.ok else EXIT_FAILED


def _only_by_portal(config: FleetConfig) -> PortalConfig | None:
    """Return the portal, and say so, where this user cannot read the key; None where he can.

    Zenoh does not say that: it tries to connect for ever. Raises `NetworkError` where he cannot,
    and there is no portal.
    """
    tls = config.network.tls
    try:
        for path in () if tls is None else (tls.ca, tls.certificate, tls.key):
            Path(path).open("rb").close()
        return None
    except PermissionError as error:
        closed = (
            f"{error.filename} may not be read by this user, only with sudo or in the group of the"
            " file (litegrip-fleet)"
        )
    except OSError as error:
        closed = f"{error.filename} cannot be read: {error.strerror}; {_LOOK}"
    if config.portal is None:
        raise NetworkError(closed)
    text = f"litegripd-fleet: {closed}: by the portal's sockets, only its own grippers"
    print(text, file=sys.stderr)
    return config.portal


def _site(text: str) -> str:
    return text if text == "*" else check_name(text, "site")


@contextlib.contextmanager
def _connected(config: FleetConfig) -> Iterator[zenoh.Session]:
    """Yield a session; raises `NetworkError` where none is possible, or no router answers."""
    session = reached(config.network)
    try:
        yield session
    finally:
        close(session)


def _fail(message: str, code: int) -> int:
    print(f"litegripd-fleet: {message}", file=sys.stderr)
    return code


_COMMANDS = {
    "gateway": _gateway,
    "portal": _portal,
    "router": _router,
    "acl": _acl,
    "list": _list,
    "stop": _stop,
}
