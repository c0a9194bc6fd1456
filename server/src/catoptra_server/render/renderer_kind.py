"""Names of renderers, for options.

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
