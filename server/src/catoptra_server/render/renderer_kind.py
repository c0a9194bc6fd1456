"""Names of renderers and instruction sets, for options. Imported by command lines: no numpy.

The kinds are distinguished in five modules: here, in `frames/renderers.py` (creation), in
`frames/plan/candidates.py` (settings), in `frames/plan/costs.py` (stages) and in
`commands/doctor/devices.py` (checks).

The package embreex, which brings Embree: whether it is installed, and what to do without it.

Its wheels are for x86-64 and for macOS. Elsewhere raster renders, and nothing casts rays.
"""

from __future__ import annotations

import importlib.util
from enum import Enum

from catoptra_protocol.errors import RendererUnavailableError


class RendererKind(Enum):
    """Renderers of the server."""

    TRACE = "trace"
    """Rays on the CPU, by Embree."""
    RASTER = "raster"
    """Cube faces and a mirror pass, by OpenGL."""

    @property
    def uses_faces(self) -> bool:
        """Whether a frame looks up cube faces that were rendered first, rather than rays."""
        return self is RendererKind.RASTER


AUTO = "auto"
RENDERER_NAMES = (AUTO, *(kind.value for kind in RendererKind))
INSTRUCTION_SETS = (AUTO, "avx512", "avx2", "sse4.2")
"""Instruction sets that the trace renderer's kernel may be limited to."""


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
