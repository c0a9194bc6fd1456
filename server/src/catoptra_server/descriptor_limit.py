"""Limit of open files of the process: every connection takes at least one descriptor."""

from __future__ import annotations

import resource

# Limits of a million, as some containers set, suggest tables of that size to libraries.
MAX_DESCRIPTORS = 65_536


def raise_descriptor_limit() -> int:
    """Raise the soft limit of open files to the hard limit, or to MAX_DESCRIPTORS.

    Returns:
        The soft limit now.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, MAX_DESCRIPTORS)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return soft
    resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return wanted
