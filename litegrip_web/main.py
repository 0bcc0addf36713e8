"""The command `litegripd-web`: a page in the browser for the grippers of this machine."""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import secrets
import signal
import ssl
import sys
from collections.abc import Sequence
from pathlib import Path

from litegrip_client.core.discovery import check_channel
from litegrip_client.values.errors import CommandError
from litegrip_client.values.repeats import RepeatsHandler, poll_handlers
from litegrip_web.gripper import Gripper
from litegrip_web.options import EXIT_ADDRESS, EXIT_OK, EXIT_USAGE, make_parser
from litegrip_web.server import Settings, is_loopback, listening

TOKEN_BYTES = 32
SHORTEST_TOKEN = 32
"""Letters of a token in a file; it must not be guessed."""


class _UsageError(Exception):
    """What was asked for cannot be."""


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the page until a signal ends it; return the exit code.

    0 after a signal, 1 when nobody can listen at the address or keep the token, 2 for bad usage.
    """
    arguments = make_parser().parse_args(argv)
    form, handler = "litegripd-web: %(message)s", RepeatsHandler()
    logging.basicConfig(format=form, level=logging.WARNING, handlers=[handler])
    # Whoever knocks and goes is no error of this program.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    try:
        settings = _settings(arguments)
    except (_UsageError, CommandError) as error:
        return _fail(error, EXIT_USAGE)
    except OSError as error:
        return _fail(error, EXIT_ADDRESS)
    try:
        asyncio.run(_serve(settings, arguments.token_file))
    except OSError as error:
        text = f"cannot listen at {settings.address} port {settings.port}: {error.strerror}"
        return _fail(f"{text}; --port takes another, 0 any that is free", EXIT_ADDRESS)
    return EXIT_OK


def _settings(arguments: argparse.Namespace) -> Settings:
    """Check the command line; raises `_UsageError`, `CommandError` or `OSError`."""
    channels: list[str] = [check_channel(channel) for channel in arguments.channels]
    if len(set(channels)) < len(channels):
        raise _UsageError("a channel is named twice")
    if arguments.socket is not None and len(channels) > 1:
        raise _UsageError("--socket is of a single channel")
    if not 0 <= arguments.port <= 65535:
        raise _UsageError(f"--port {arguments.port}: 0 to 65535")
    return Settings(
        grippers=[Gripper(channel, arguments.socket) for channel in channels],
        token=_token(arguments.token_file),
        address=arguments.address,
        port=arguments.port,
        operate=arguments.operate,
        tls=_tls(arguments),
        names=arguments.name,
    )


def _tls(arguments: argparse.Namespace) -> ssl.SSLContext | None:
    """Return what encrypts; None for this machine's own address, where nothing has to."""
    certificate, key = arguments.certificate, arguments.key
    if (certificate is None) != (key is None):
        raise _UsageError("--certificate and --key belong together")
    if certificate is None:
        if not is_loopback(arguments.address):
            raise _UsageError(
                f"--address {arguments.address} can be reached by other machines: give "
                "--certificate and --key, or leave --address out and use 'ssh -L "
                f"{arguments.port}:127.0.0.1:{arguments.port}' from there"
            )
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        why = error.strerror or str(error)
        raise _UsageError(f"{certificate} and {key} cannot be used: {why}") from error
    return context


def _token(file: Path | None) -> str:
    """Return the secret: a new one, or that of `file`, which is made where there is none."""
    if file is None:
        return secrets.token_urlsafe(TOKEN_BYTES)
    try:
        # Others of its group may read it: whose gripper it is decides the folder's owner.
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o640), "w") as made:
            made.write(f"{secrets.token_urlsafe(TOKEN_BYTES)}\n")
    except FileExistsError:
        pass
    token = file.read_text("ascii", "replace").strip()
    if len(token) < SHORTEST_TOKEN or not token.replace("-", "").replace("_", "").isalnum():
        raise _UsageError(
            f"{file} holds no secret of {SHORTEST_TOKEN} letters, digits, '-' or '_' at least: "
            "remove it, and a new one is made"
        )
    return token


async def _serve(settings: Settings, token_file: Path | None) -> None:
    ending = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ending.set)
    async with listening(settings) as address:
        may = "look, stop and move" if settings.operate else "look and stop"
        if token_file is None:
            _say(f"{address}#{settings.token}")
            _say(f"Whoever has this address may {may}.")
        else:
            _say(f"{address}# and, behind it, what {token_file} holds.")
            _say(f"Whoever has both may {may}.")
        polling = asyncio.create_task(poll_handlers())
        await ending.wait()
        polling.cancel()


def _say(text: str) -> None:
    print(text, flush=True)


def _fail(error: object, code: int) -> int:
    print(f"litegripd-web: {error}", file=sys.stderr)
    return code
