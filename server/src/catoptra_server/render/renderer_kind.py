"""Names of renderers and instruction sets, for options, and the check for the package of Embree.

Command lines import this module: no numpy, and nothing of a renderer. The kinds are distinguished
in five modules: here, in `frames/renderers.py` (creation), in `frames/plan/planner.py`
(settings), in `frames/plan/costs.py` (stages) and in `commands/doctor/devices.py` (checks).

Embree comes with the package embreex, whose wheels are for x86-64 and for macOS. Without the
package raster renders, and nothing casts rays.
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
INSTRUCTION_SETS = ("avx512", "avx2", "sse4.2")
"""Instruction sets that the trace renderer's kernel may be limited to, by Embree's names, best
first."""
INSTRUCTION_SET_NAMES = (AUTO, *INSTRUCTION_SETS)


EMBREEX_PACKAGE = "embreex"
EMBREEX_REMEDY = f"pip install {EMBREEX_PACKAGE} (wheels exist for x86-64 and for macOS)"


def has_embreex() -> bool:
    """Whether the package is installed; nothing is loaded."""
    return importlib.util.find_spec(EMBREEX_PACKAGE) is not None


def require_embreex(need: str, *, alternative: str) -> None:
    """Raise RendererUnavailableError unless the package is installed.

    Args:
        need: Subject of the message, such as `the trace renderer`.
        alternative: What works without the package, as an imperative.
    """
    if not has_embreex():
        raise RendererUnavailableError(
            f"{need} needs the package {EMBREEX_PACKAGE}, which is not installed: "
            f"{EMBREEX_REMEDY}, or {alternative}"
        )
