"""Who is on the network with a certificate, and asks there by hand, without a portal."""

import asyncio
import contextlib
import json
from collections.abc import Iterator
from pathlib import Path

import zenoh

from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.network import Answered, Network, Tls, ask, configuration
from tests.process.fleet.fleet_process import Fleet

LEFT = Place("lab", "left")


def configuration_of(lab: Fleet, name: str, certificates: Path | None = None) -> zenoh.Config:
    """Return the configuration of who has a certificate, and tries until he is let in."""
    own = (certificates or lab.certificates) / name
    tls = Tls(str(own / "ca.pem"), str(own / "own.pem"), str(own / "own.key"))
    return configuration(Network([lab.endpoint], tls=tls), "client")


@contextlib.contextmanager
def connected(
    lab: Fleet, name: str | None, certificates: Path | None = None
) -> Iterator[zenoh.Session]:
    """Be on the network with a certificate, or without one; raises `ZError` if not let in."""
    config = configuration_of(lab, name or "op1", certificates)
    config.insert_json5("connect/timeout_ms", "2000")
    config.insert_json5("connect/exit_on_failure", "true")
    if name is None:
        authority = {"root_ca_certificate": str(lab.certificates / "op1/ca.pem")}
        config.insert_json5("transport/link/tls", json.dumps(authority))
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()


def answers(
    session: zenoh.Session,
    key: str,
    payload: bytes = b"",
    attached: bytes | None = None,
    within_s: float = 1.5,
) -> list[Answered]:
    async def asked() -> list[Answered]:
        loop = asyncio.get_running_loop()
        return await ask(session, key, payload, attached, loop, within_s=within_s)

    return asyncio.run(asked())
