"""The certificates of TLS: what is in them, whether they are good, and how long they still are.

Read by handshakes of the standard library's `ssl`, in memory for the own files: it judges as a
neighbour will, and needs neither the program openssl nor another library on the machine. Dates are
left to the caller, whose clock may be wrong.
"""

import asyncio
import logging
import socket
import ssl
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

from litegrip_fleet.wire.network import Tls

_log = logging.getLogger(__name__)

DAY_S = 86_400.0
WARN_BELOW_S = 30 * DAY_S

_NO_CHECK_TIME = 0x200000  # X509_V_FLAG_NO_CHECK_TIME of OpenSSL, which `ssl` has no name for

_UNKNOWN_AUTHORITY = (18, 19, 20, 21)  # X509_V_ERR_... of OpenSSL's x509_vfy.h
_BAD_SIGNATURE = 7
_WRONG_PURPOSE = 26
_OTHER_NAME = (62, 64)

_WENT_ON = "APPLICATION_DATA_AFTER_CLOSE_NOTIFY"
"""What `ssl` says of one that began to speak: it has taken the certificate."""

_MOST_TURNS = 10
"""A handshake in memory has six."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """Whose certificate it is, the names that it is good for, and from and until when (Unix)."""

    common_name: str
    names: tuple[str, ...]
    from_s: float
    until_s: float
    serial: str


class CertificateError(Exception):
    """A certificate that nobody will accept; the message says why."""


def own(tls: Tls, *, as_server: bool = False, name: str | None = None) -> Certificate:
    """Return the own certificate; raises `CertificateError`, and `OSError` for a file.

    Key and certificate have to belong together, and the authority has to have signed it, for a
    server or a client. A server's has to be good for `name`, where one is given.
    """
    try:
        server, client = _contexts(tls)
    except ssl.SSLError as error:
        raise CertificateError(_why_unusable(tls, error)) from error
    client.check_hostname = as_server and name is not None
    (server if as_server else client).verify_mode = ssl.CERT_NONE  # whom it sees does not matter
    try:
        ends = _shaken_hands(server, client, name)
    except ssl.SSLError as error:
        raise CertificateError(why(error)) from error
    return _certificate(ends[1 if as_server else 0].getpeercert() or {})


def authorities(ca: str) -> list[Certificate]:
    """Return the authorities of a file; raises `CertificateError`, and `OSError` for the file."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(ca)
    except ssl.SSLError as error:
        raise CertificateError(f"{ca} has no certificate in it") from error
    return [_certificate(found) for found in context.get_ca_certs()]


def met(host: str, port: int, tls: Tls, within_s: float, *, check_name: bool = True) -> Certificate:
    """Return the certificate of who listens there, once he has taken the own one.

    Raises `CertificateError` if one end refuses the other's, `OSError` if nobody answers.
    """
    _server, context = _contexts(tls)
    context.check_hostname = check_name
    with socket.create_connection((host, port), within_s) as connected:
        try:
            with context.wrap_socket(connected, server_hostname=host) as shaken:
                found = _certificate(shaken.getpeercert() or {})
                _until_judged(shaken)
        except ssl.SSLError as error:
            whose = "its certificate" if isinstance(error, ssl.SSLCertVerificationError) else "it"
            raise CertificateError(f"{whose} {why(error)}") from error
    return found


def _until_judged(shaken: ssl.SSLSocket) -> None:
    """Wait for whatever the other end says after the handshake: with TLS 1.3, it judges then.

    Raises `ssl.SSLError` if it says that it refuses the certificate.
    """
    try:
        shaken.unwrap()
    except (ssl.SSLEOFError, ssl.SSLZeroReturnError, ConnectionError) as error:
        _log.debug("the other end has closed the connection: %s", error)
    except ssl.SSLError as error:
        if error.reason != _WENT_ON:
            raise


def _contexts(tls: Tls) -> tuple[ssl.SSLContext, ssl.SSLContext]:
    """Return a server's and a client's context with the own files; raises `ssl.SSLError`."""
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    for context in (server, client):
        context.load_verify_locations(tls.ca)
        # Without a password, OpenSSL asks for one at the terminal.
        context.load_cert_chain(tls.certificate, tls.key, password=lambda: "")
        context.verify_mode = ssl.CERT_REQUIRED
        context.verify_flags |= _NO_CHECK_TIME
    return server, client


def _shaken_hands(
    server: ssl.SSLContext, client: ssl.SSLContext, name: str | None
) -> tuple[ssl.SSLObject, ssl.SSLObject]:
    """Let two contexts meet in memory; raises `ssl.SSLError` if one refuses the other."""
    there, back = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = (
        server.wrap_bio(there, back, server_side=True),
        client.wrap_bio(back, there, server_hostname=name),
    )
    for _ in range(_MOST_TURNS):
        for end in ends:
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:  # noqa: PERF203 - it is the other's turn
                continue
    return ends


def _certificate(found: Mapping[str, Any]) -> Certificate:
    """Return what `ssl` has decoded."""
    subject = {name: value for part in found.get("subject", ()) for name, value in part}
    return Certificate(
        str(subject.get("commonName", "")),
        tuple(str(name) for _kind, name in found.get("subjectAltName", ())),
        float(ssl.cert_time_to_seconds(found["notBefore"])),
        float(ssl.cert_time_to_seconds(found["notAfter"])),
        str(found.get("serialNumber", "")),
    )


def why(error: ssl.SSLError) -> str:
    """Return why a handshake has failed."""
    code = getattr(error, "verify_code", None)
    if code in _UNKNOWN_AUTHORITY:
        return "is signed by another authority than the one in ca"
    if code == _BAD_SIGNATURE:
        return "has a signature that is not the authority's"
    if code == _WRONG_PURPOSE:
        return "is made for another purpose: user: and gateway: serve nobody, a router's does"
    if code in _OTHER_NAME:
        return "is not made for this name"
    if code is not None:
        return f"is refused: {getattr(error, 'verify_message', error)}"
    reason = (error.reason or str(error)).replace("_", " ").lower()
    if "alert" in reason:
        return f"is there, and refuses the certificate of this machine: {reason}"
    return f"does not speak TLS as it should: {reason}"


def _why_unusable(tls: Tls, error: ssl.SSLError) -> str:
    """Return which file cannot be used."""
    if error.reason == "KEY_VALUES_MISMATCH":
        return f"belongs to another key than {tls.key}"
    try:
        authorities(tls.ca)
    except CertificateError as no_authority:
        return f"cannot be judged: {no_authority}"
    return f"cannot be used with {tls.key}: one of both is no PEM, or the key has a password"


# Dates --------------------------------------------------------------------------------------------


def date(unix_s: float) -> str:
    """Return a date as it is shown, in UTC."""
    return datetime.fromtimestamp(unix_s, timezone.utc).strftime("%Y-%m-%d %H:%M UTC")


def problem_of_dates(certificate: Certificate, now_s: float) -> str | None:
    """Return why a certificate is not valid now, or None."""
    if now_s > certificate.until_s:
        return f"has been over since {date(certificate.until_s)}"
    if now_s < certificate.from_s:
        return f"is valid only from {date(certificate.from_s)} on; here it is {date(now_s)}"
    return None


def time_left(certificate: Certificate, now_s: float) -> str:
    """Return until when it is valid, and for how many days."""
    days = int((certificate.until_s - now_s) // DAY_S)
    return f"is valid until {date(certificate.until_s)}, for {days} day{'' if days == 1 else 's'}"


async def watch(
    certificate: Certificate,
    *,
    now: Callable[[], float] = time.time,
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
) -> None:
    """Log each day that a certificate is about to be over, or is; until cancelled."""
    name = certificate.common_name
    while True:
        now_s = now()
        left_s = certificate.until_s - now_s
        if (problem := problem_of_dates(certificate, now_s)) is not None:
            _log.error("the certificate of %s %s: nobody lets this machine in", name, problem)
        elif left_s < WARN_BELOW_S:
            text = time_left(certificate, now_s)
            _log.warning("the certificate of %s %s: make another one before", name, text)
        is_over_sooner = 0.0 <= left_s < DAY_S
        await sleep(left_s + 1.0 if is_over_sooner else DAY_S)
