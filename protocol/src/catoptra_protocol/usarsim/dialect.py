"""The two dialects of USARSim: UT2004 (2004-2009, the paper's) and UDK (2010 on).

Where they differ, each report writes the form that it is asked for; readers take both. Nothing but
the differences that belong to no single report stands here.
"""

from __future__ import annotations

from enum import Enum

from catoptra_protocol.usarsim.grammar import Pairs
from catoptra_protocol.usarsim.value_format import format_fixed_point


class Dialect(Enum):
    """How a server writes its lines."""

    UT2004 = "ut2004"
    UDK = "udk"


# UDK's source appends these blocks without a space before them: GEO's mount and all of a camera's
# CONF behind its name. Seen in real captures; SPEC-NOTES.md, Dialect.
UDK_BLOCKS_WITHOUT_SPACE = frozenset(
    {
        "Mount",
        "TextureOffsetX",
        "TextureOffsetY",
        "TextureResolutionX",
        "TextureResolutionY",
        "CameraDefFov",
        "CameraMinFov",
        "CameraMaxFov",
        "CameraFov",
    }
)


def udk_time_pairs(time_s: float | None, dialect: Dialect) -> Pairs:
    """Return the Time of readings that UT2004 sends without one: UDK's, if it is known."""
    if dialect is not Dialect.UDK or time_s is None:
        return ()
    return (("Time", format_fixed_point(time_s)),)
