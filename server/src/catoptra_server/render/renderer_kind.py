"""Names of renderers and instruction sets, for options. Imported by command lines: no numpy.

The kinds are distinguished in five modules: here, in `planning/renderer_choice.py` (creation), in
`planning/candidate_plans.py` (settings), in `planning/cost_model.py` (stages) and in
`doctor/renderer_devices.py` (checks).
"""

from __future__ import annotations

from enum import Enum


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
