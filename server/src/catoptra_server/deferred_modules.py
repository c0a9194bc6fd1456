"""Modules that a server needs only once it serves, loaded right after its ports listen.

Before, each would delay the first frame. Later, a request would load them: a slow one, and one that
fails where connections have taken all descriptors of open files, since an import opens files. The
few requests that come earlier wait, in a thread of their own or in the stream's backlog, for the
module that they need.

The modules that use these import them in a function, with a reference to this one.
tests/end_to_end/test_loaded_modules.py finds what lacks here.
"""

from __future__ import annotations

import importlib
from contextlib import suppress

from catoptra_server.render.renderer_kind import AUTO

# In the order in which clients may need them. NumPy imports some parts at their first use: `ma` in
# its own `unique`.
_MODULES = (
    "catoptra_server.stream_port",
    "numpy.ma",
    "numpy.polynomial",
    "numpy.random",
)
# For the rays of GetLandmarks and of sensors, those of mirror meshes, and those of a kernel that
# cannot be made anew; a server without them runs without embreex.
_RAY_MODULES = (
    "catoptra_server.render.trace.ray_caster",
    "catoptra_server.render.trace.mirror_mesh_rays",
    "catoptra_server.render.trace.reference.engine",
)
# The raster renderer, and what moderngl imports with its first context.
_RASTER_MODULES = ("catoptra_server.render.raster", "glcontext", "glcontext.egl", "ctypes.util")


def load_deferred_modules(renderer: str) -> None:
    """Load all modules that a request may need.

    Args:
        renderer: requested renderer; `auto` may change to one that it did not start with.
    """
    for name in _MODULES:
        importlib.import_module(name)
    for optional in (_RAY_MODULES, _RASTER_MODULES if renderer == AUTO else ()):
        with suppress(ImportError):
            for name in optional:
                importlib.import_module(name)


def load_view_modules() -> None:
    """Load all modules of the live page: 0.2 s and 13 MB, for which no other port waits."""
    importlib.import_module("catoptra_server.web_port")
