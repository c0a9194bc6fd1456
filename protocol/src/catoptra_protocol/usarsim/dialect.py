"""The two dialects of USARSim: UT2004 (2004-2009, that of the paper) and UDK (2010 on).

Each report writes its own form in either dialect, and readers accept both; this module holds only
the differences that several reports share.
"""

from __future__ import annotations

from enum import Enum

from catoptra_protocol.usarsim.grammar import Pairs
from catoptra_protocol.usarsim.value_format import format_fixed_point


class Dialect(Enum):
    """Dialect of the lines that a server writes."""

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
    """Time of a reading that has none in UT2004: that of UDK, if known."""
    if dialect is not Dialect.UDK or time_s is None:
        return ()
    return (("Time", format_fixed_point(time_s)),)
