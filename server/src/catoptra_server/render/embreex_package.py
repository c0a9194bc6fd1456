"""The package embreex, which brings Embree: whether it is installed, and what to do without it.

Its wheels are for x86-64 and for macOS. Elsewhere raster renders, and nothing casts rays.
"""

from __future__ import annotations

import importlib.util

from catoptra_protocol.errors import RendererUnavailableError

PACKAGE = "embreex"
REMEDY = f"pip install {PACKAGE} (wheels exist for x86-64 and for macOS)"


class EmbreexMissingError(RendererUnavailableError):
    """Rays cannot be cast: the message names the package, the user of the rays and the remedy."""

    def __init__(self, need: str, alternative: str) -> None:
        """Compose the message.

        Args:
            need: Subject of the message, such as `the trace renderer`.
            alternative: What works without the package, as an imperative.
        """
        super().__init__(
            f"{need} needs the package {PACKAGE}, which is not installed: {REMEDY}, or "
            f"{alternative}"
        )


def has_embreex() -> bool:
    """Whether the package is installed; nothing is loaded."""
    return importlib.util.find_spec(PACKAGE) is not None


def require_embreex(need: str, *, alternative: str) -> None:
    """Raise EmbreexMissingError unless the package is installed."""
    if not has_embreex():
        raise EmbreexMissingError(need, alternative)
