"""Page and server prove to each other that they know the secret, and neither sends it.

Another user of the machine can take the port while `litegripd-web` is restarted, and every page
that is still open connects to him. So the server proves first. A proof is an HMAC-SHA256 with the
secret as its key, over a role, the host of the page's address and a nonce of each side: it holds
for this connection alone, and nobody can pass it on to a server at another port.
"""

from __future__ import annotations

import hmac
import re
import secrets

NONCE = re.compile(r"[A-Za-z0-9_-]{22,64}")
"""At least 128 bits, in letters of base64url."""


def new_nonce() -> str:
    """Return a nonce of 32 random bytes."""
    return secrets.token_urlsafe(32)


def proof(token: str, role: str, host: str, page_nonce: str, server_nonce: str) -> str:
    """Return the proof of `role`, "page" or "server", as hexadecimal digits."""
    text = "\n".join(("litegripd-web", role, host.lower(), page_nonce, server_nonce))
    return hmac.new(token.encode("ascii"), text.encode(), "sha256").hexdigest()


def is_proof(given: object, expected: str) -> bool:
    """Return True if a value that came from somebody is the expected proof."""
    return isinstance(given, str) and given.isascii() and hmac.compare_digest(given, expected)
