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


@contextlib.contextmanager
def connected(
    lab: Fleet, name: str | None, certificates: Path | None = None
) -> Iterator[zenoh.Session]:
    """Be on the network with a certificate, or without one; raises `ZError` if not let in."""
    folder = certificates or lab.certificates
    own = folder / (name or "op1")
    tls = Tls(str(own / "ca.pem"), str(own / "own.pem"), str(own / "own.key"))
    config = configuration(Network([lab.endpoint], tls=tls), "client")
    config.insert_json5("connect/timeout_ms", "2000")
    config.insert_json5("connect/exit_on_failure", "true")
    if name is None:
        authority = {"root_ca_certificate": tls.ca}
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
