"""Who may open the page, its socket, and give orders."""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
from dataclasses import dataclass
from typing import Final

_LOOPBACK_NAMES: Final = ("localhost", "127.0.0.1", "::1")
_HOST: Final = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([^\s:\[\]/@]+))(?::\d{1,5})?")
_SHOWN: Final = 100  # characters of something foreign in a line of the log

HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
"""Of every answer: nothing from elsewhere, in no frame of another page."""


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches an address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def shown(text: object) -> str:
    """Return what somebody sent as a part of one line of a log."""
    return ascii(str(text)[:_SHOWN])


@dataclass(frozen=True)
class Guard:
    """Checks of requests."""

    host: str  #: address that is bound
    #: what a page must know to give orders; None where only this machine reaches the server
    token: str | None

    @classmethod
    def of(cls, host: str) -> Guard:
        """Return the guard of an address, with a new token if others reach it."""
        return cls(host, None if is_loopback(host) else secrets.token_urlsafe(16))

    def refuses_host(self, header: str | None) -> str | None:
        """Return why a Host header is refused: against names that others let point here."""
        name = _name_of(header or "")
        if self.token is not None:  # an address of this machine, whichever: no name
            try:
                ipaddress.ip_address(name)
            except ValueError:
                return None if name in ("localhost", self.host) else f"Host {shown(header)}"
            return None
        return None if name in (*_LOOPBACK_NAMES, self.host) else f"Host {shown(header)}"

    def refuses_origin(self, origin: str | None, host: str | None) -> str | None:
        """Return why a socket is refused: it must be asked for by our own page."""
        if origin is not None and host and origin in (f"http://{host}", f"https://{host}"):
            return None
        return f"Origin {shown(origin)}"

    def may_control(self, token: str | None) -> bool:
        """Return whether a page with this token may give orders."""
        if self.token is None:
            return True
        return token is not None and hmac.compare_digest(token.encode(), self.token.encode())


def _name_of(host: str) -> str:
    """Return the name in a Host header, without its port; an empty one if it is not well formed."""
    found = _HOST.fullmatch(host)
    return "" if found is None else found[1] or found[2]
