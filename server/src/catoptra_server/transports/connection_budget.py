"""Numbers of connections that fit into the process's descriptors of open files."""

from __future__ import annotations

import logging
import resource

log = logging.getLogger(__name__)

# An idle server has 66 descriptors open; the rest is for files and libraries of a late moment.
_RESERVED_DESCRIPTORS = 100


def fit_connections(wanted: int, *, share: float, descriptors_each: int = 1, name: str) -> int:
    """Limit of connections to a port: as many as wanted, or as its share of descriptors allows.

    Fixed shares, not one pool: connections to one port never take the descriptors of another.

    Args:
        wanted: Configured limit.
        share: Part of the descriptors for this port, 0 to 1; the shares of all ports add up to 1.
        descriptors_each: Descriptors of one connection.
        name: Name of the port in the log.
    """
    soft_limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft_limit == resource.RLIM_INFINITY:
        return wanted
    available = share * (soft_limit - _RESERVED_DESCRIPTORS)
    fitting = max(1, int(available / descriptors_each))
    if fitting < wanted:
        log.warning(
            "the %s port has %d connections at most, not %d: the process may open %d files; "
            "raise the limit with `ulimit -n`",
            *(name, fitting, wanted, soft_limit),
        )
    return min(fitting, wanted)
