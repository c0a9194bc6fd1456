"""Fog of the face pass: each fragment by its own distance, so that outlines stay smooth."""

from __future__ import annotations

import moderngl

from catoptra_server.render.raster.shader_programs import set_uniform
from catoptra_server.world.camera_state import FogMedium


def set_fog(program: moderngl.Program, fog: FogMedium | None) -> None:
    """Write the airlight and the extinction per metre, 0 in clear air, to a program."""
    clear = (0.0, 0.0, 0.0, 0.0)
    set_uniform(program, "fog", clear if fog is None else (*fog.airlight, fog.density_per_m))
