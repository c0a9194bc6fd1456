"""Who may use the live page: checks of Host, Origin and token before anything else of a request.

The loopback is open to every page that a browser shows. A page of another site may send requests
there, too, and may even read replies once a name of that site resolves to 127.0.0.1 (DNS
rebinding). Host and Origin name the site that the browser shows, and no script can change these
headers. Where other machines reach the port, a request needs the token of the printed link.
"""

from __future__ import annotations

import hmac
import re
import secrets
from ipaddress import ip_address

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.serve.port import Listener

# Name or IPv4 address, or IPv6 address in brackets; and a port, which `ssh -L` may change.
_HOST = re.compile(r"([a-z0-9._-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?", re.ASCII)
_LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})


class AccessDeniedError(CatoptraError):
    """A request to the live page is refused before the path is looked at; says why."""


@dataclass(frozen=True, slots=True)
class WebAccess:
    """Rules of access to one port."""

    host_names: frozenset[str]
    """Names in lower case that the Host header may have; not used with a token."""
    link_host: str
    """Host of the link."""
    port: int
    token: str | None = None
    """Secret of the link, needed where other machines reach the port; None on the loopback."""

    @property
    def link(self) -> str:
        """Address of the page, for a browser; with the token, if any."""
        query = f"?token={self.token}" if self.token else ""
        return f"http://{self.link_host}:{self.port}/{query}"

    @property
    def cookie_name(self) -> str:
        """Name of the cookie with the token: browsers send all cookies of a host to each port."""
        return f"catoptra_{self.port}"

    def check_headers(self, host: str, origin: str | None, *, needs_origin: bool) -> None:
        """Check that a request is for this server, and not of a page of another site.

        Args:
            host: Host header.
            origin: Origin header; None if absent.
            needs_origin: Whether the request must state an origin, as browsers do for WebSockets.

        Raises:
            AccessDeniedError: Host or Origin is another's; says why.
        """
        host = host.lower()
        found = _HOST.fullmatch(host)
        if found is None:
            raise AccessDeniedError("the Host header names no host")
        if self.token is None and found[1] not in self.host_names:
            known = ", ".join(sorted(self.host_names))
            raise AccessDeniedError(
                f"the Host header names another host: open the page at one of {known}"
            )
        if origin is None and needs_origin:
            raise AccessDeniedError("a WebSocket needs an Origin header")
        if origin is not None and origin.lower() not in (f"http://{host}", f"https://{host}"):
            raise AccessDeniedError("the request comes from a page of another site")

    def check_token(self, token: str | None) -> None:
        """Check the token of the link or of the cookie, where one is needed.

        Raises:
            AccessDeniedError: The token is missing or wrong.
        """
        # In constant time: the time of a reply must not tell how much of a guess is right.
        if self.token is not None and not hmac.compare_digest(
            (token or "").encode(), self.token.encode()
        ):
            raise AccessDeniedError(
                "open the link that the server printed: its token is missing or wrong"
            )


def create_web_access(host: str, listener: Listener) -> WebAccess:
    """Rules for a listening socket.

    Args:
        host: Name or address on which to listen was requested.
        listener: The socket.
    """
    address, port = listener.getsockname()[:2]
    bound = ip_address(address.partition("%")[0])
    name = f"[{host}]" if ":" in host else host.lower()
    if bound.is_loopback:
        return WebAccess(_LOOPBACK_NAMES | {name}, name, port)
    # A wildcard is no address that browsers open: the link names this machine.
    link_host = "localhost" if bound.is_unspecified else name
    return WebAccess(frozenset(), link_host, port, secrets.token_urlsafe())
