"""What listens for browsers: who may ask, and what everybody gets with each answer.

A page that anybody can reach moves a gripper that people trust with their fingers. So: this
machine alone, unless there is TLS; no name but our own (a foreign one may be made to lead here); no
page but our own; no cookies; and a token in the part of the address that no browser sends.
"""

from __future__ import annotations

import asyncio
import ipaddress
import ssl
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from http import HTTPStatus
from importlib import resources
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Request, Response

from litegrip_web.bridge import MAX_MESSAGE_BYTES, Bridge
from litegrip_web.gripper import Gripper

if TYPE_CHECKING:  # its place depends on Python's version
    from importlib.abc import Traversable

MOST_STRANGERS = 64
"""Connections that have not proved the secret, of all grippers; one more ends the oldest. A browser
needs a few for some milliseconds; whoever opens a thousand keeps nobody out."""

_BACKLOG = 32
"""So many connections are accepted before those that are there already have their turn."""

SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; object-src 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
}
"""Of every answer."""

_GRIPPERS = "/ws/"
_KINDS = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}


@dataclass(frozen=True, slots=True)
class Settings:
    """What to serve, and where; `port` 0 takes any. `names` are further names of this machine."""

    grippers: Sequence[Gripper]
    token: str
    address: str = "127.0.0.1"
    port: int = 8040
    operate: bool = False
    tls: ssl.SSLContext | None = None
    names: Sequence[str] = ()


def is_loopback(address: str) -> bool:
    """Return True for an address that no other machine reaches."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


class Guard:
    """Answers plain requests, and decides which browsers may connect; `port` is the real one."""

    def __init__(
        self, settings: Settings, port: int, strangers: dict[ServerConnection, None]
    ) -> None:
        self._strangers = strangers
        scheme, default = ("https", 443) if settings.tls else ("http", 80)
        names = [_in_url(settings.address), *map(_in_url, settings.names)]
        if is_loopback(settings.address):
            names += ["localhost", "127.0.0.1", "[::1]"]
        self.hosts = {f"{name}:{port}".lower() for name in names}
        if port == default:
            self.hosts |= {name.lower() for name in names}
        self.origins = {f"{scheme}://{host}" for host in self.hosts}
        self._bridges = {
            f"{_GRIPPERS}{gripper.channel}": Bridge(
                gripper, settings.token, operate=settings.operate
            )
            for gripper in settings.grippers
        }
        self._files = dict(_files(settings))

    def answer(self, _browser: ServerConnection, request: Request) -> Response | None:
        """Answer a request; None lets a browser connect to a gripper."""
        try:
            host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        except MultipleValuesError:
            return _plain(HTTPStatus.BAD_REQUEST, "a header came twice")
        if host.lower() not in self.hosts:
            text = f"this is not {host!r}; litegripd-web --name allows a further name"
            return _plain(HTTPStatus.MISDIRECTED_REQUEST, text)
        path = request.path.partition("?")[0]
        if path in self._bridges:
            if origin is None or origin.lower() not in self.origins:
                return _plain(HTTPStatus.FORBIDDEN, "only the page itself may connect")
            return None
        found = self._files.get(path)
        if found is None:
            return _plain(HTTPStatus.NOT_FOUND, "there is no such page")
        kind, content = found
        return _response(HTTPStatus.OK, kind, content)

    async def serve(self, browser: ServerConnection) -> None:
        """Serve a browser that `answer` has let connect."""
        request = browser.request
        assert request is not None, "it has been answered"  # noqa: S101 - for the type
        bridge = self._bridges[request.path.partition("?")[0]]
        if await bridge.is_known(browser, request.headers["Host"]):
            self._strangers.pop(browser, None)
            await bridge.serve(browser)

    async def keep_histories(self) -> None:
        """Keep the last minute of each gripper, until cancelled."""
        await asyncio.gather(*(bridge.history.keep() for bridge in self._bridges.values()))


def _counted(strangers: dict[ServerConnection, None]) -> type[ServerConnection]:
    """Return a connection that is one of the `strangers` until it proves the secret."""

    class Browser(ServerConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            strangers[self] = None
            if len(strangers) > MOST_STRANGERS:
                oldest = next(iter(strangers))
                del strangers[oldest]
                oldest.transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            strangers.pop(self, None)
            super().connection_lost(exc)

    return Browser


@asynccontextmanager
async def listening(settings: Settings) -> AsyncIterator[str]:
    """Listen; yield the address of the page, without the token.

    Raises `OSError` where nobody can listen there.
    """
    guard: Guard | None = None
    strangers: dict[ServerConnection, None] = {}

    def answer(browser: ServerConnection, request: Request) -> Response | None:
        assert guard is not None, "nobody connects before somebody listens"  # noqa: S101
        return guard.answer(browser, request)

    async def handle(browser: ServerConnection) -> None:
        assert guard is not None, "nobody connects before somebody listens"  # noqa: S101
        await guard.serve(browser)

    server = await serve(
        handle,
        settings.address,
        settings.port,
        ssl=settings.tls,
        process_request=answer,
        process_response=_add_headers,
        max_size=MAX_MESSAGE_BYTES,
        compression=None,
        server_header=None,
        open_timeout=5,
        create_connection=_counted(strangers),
        backlog=_BACKLOG,
        start_serving=False,
    )
    histories: asyncio.Task[None] | None = None
    try:
        port = int(server.sockets[0].getsockname()[1])
        guard = Guard(settings, port, strangers)
        histories = asyncio.create_task(guard.keep_histories())
        await server.start_serving()
        scheme = "https" if settings.tls else "http"
        yield f"{scheme}://{_in_url(settings.address)}:{port}/"
    finally:
        if histories is not None:
            histories.cancel()
        server.close()
        await server.wait_closed()


def _add_headers(
    _browser: ServerConnection, _request: Request, response: Response
) -> Response | None:
    for name, value in SECURITY_HEADERS.items():
        if name not in response.headers:
            response.headers[name] = value
    return None


def _files(settings: Settings) -> Iterator[tuple[str, tuple[str, bytes]]]:
    """Yield what is served under each path: read once, so that no path leads anywhere else."""
    for path, file in _walk(resources.files("litegrip_web") / "page", ""):
        content = file.read_bytes()
        if path == "/index.html":
            channels = " ".join(gripper.channel for gripper in settings.grippers)
            content = content.replace(b"{{channels}}", channels.encode())
            path = "/"  # noqa: PLW2901 - the one file with another path
        yield path, (_KINDS[PurePosixPath(file.name).suffix], content)


def _walk(folder: Traversable, above: str) -> Iterator[tuple[str, Traversable]]:
    for entry in folder.iterdir():
        path = f"{above}/{entry.name}"
        if entry.is_dir():
            yield from _walk(entry, path)
        else:
            yield path, entry


def _in_url(address: str) -> str:
    return f"[{address}]" if ":" in address else address


def _plain(status: HTTPStatus, text: str) -> Response:
    return _response(status, "text/plain", f"{text}\n".encode())


def _response(status: HTTPStatus, kind: str, content: bytes) -> Response:
    fields = {
        "Content-Type": f"{kind}; charset=utf-8" if kind.startswith("text/") else kind,
        "Content-Length": str(len(content)),
        "Connection": "close",
        **SECURITY_HEADERS,
    }
    return Response(status.value, status.phrase, Headers(fields), content)
