"""Exposure of the ports to other machines: only the live page has authentication."""

from __future__ import annotations

import asyncio
import logging
import socket
from ipaddress import ip_address

log = logging.getLogger(__name__)


async def warn_of_exposure(host: str) -> None:
    """Log a warning if other machines can reach the ports of a host name or address."""
    try:
        reachable = [a for a in await _resolve(host) if not ip_address(a).is_loopback]
    except (OSError, UnicodeError):
        # UnicodeError: an impossible name, such as a..b. Opening the ports fails too, and ends the
        # server with the reason.
        return
    if reachable:
        log.warning(
            "the ports are open to the network on %s, without authentication, except for the live "
            "page, whose link has a token: every machine that reaches them can drive the robots "
            "and see their cameras. Restrict them by a firewall, "
            "or serve on 127.0.0.1 and connect through `ssh -L`",
            ", ".join(reachable),
        )


async def _resolve(host: str) -> list[str]:
    """Addresses of a host, without the scope of link-local ones; of "" the wildcard."""
    found = await asyncio.get_running_loop().getaddrinfo(
        host or None, 0, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )
    return sorted({str(address[0]).partition("%")[0] for *_, address in found})
