"""Names of renderers and instruction sets, for options.

Command lines import this module: no numpy, and nothing of a renderer. The kinds are distinguished
in five modules: here, in `frames/renderers.py` (creation), in `frames/plan/planner.py`
(settings), in `frames/plan/costs.py` (stages) and in `commands/doctor/devices.py` (checks).
"""

from __future__ import annotations

from enum import Enum


class RendererKind(Enum):
    """Renderers of the server."""

    TRACE = "trace"
    """Rays on the CPU."""
    RASTER = "raster"
    """Cube faces and a mirror pass, by OpenGL."""

    @property
    def uses_faces(self) -> bool:
        """Whether a frame looks up cube faces that were rendered first, rather than rays."""
        return self is RendererKind.RASTER


AUTO = "auto"
RENDERER_NAMES = (AUTO, *(kind.value for kind in RendererKind))
INSTRUCTION_SETS = ("avx512", "avx2", "sse4.2")
"""Instruction sets that the trace renderer's kernel may be limited to, best first."""
INSTRUCTION_SET_NAMES = (AUTO, *INSTRUCTION_SETS)
