"""Client library of robot programs: drive, receive frames, detect landmarks, localize.

A distribution of its own, so that a robot's author installs it without OpenGL, Matplotlib and the
server's libraries. Client and server meet in the protocol alone.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from catoptra_client.frame_pictures import show

__all__ = ["show"]


def __getattr__(name: str) -> Any:
    """`show`, loaded at its first use: importing the package loads no NumPy (PEP 562)."""
    if name != "show":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from catoptra_client.frame_pictures import show

    return show
