"""What a program that includes include/atlas.glsl has to be told."""

from __future__ import annotations

import moderngl

from catoptra_protocol.optics.cube import Face
from catoptra_server.render.raster.atlas import Atlas
from catoptra_server.render.raster.programs import Definitions, set_uniform


def atlas_definitions(atlas: Atlas) -> Definitions:
    """Return what is defined when such a program is compiled."""
    return (("FACES", _faces(atlas)),)


def use_atlas(program: moderngl.Program, atlas: Atlas, texture: moderngl.Texture) -> None:
    """Set the uniforms of a draw and bind the texture."""
    centres = atlas.face_centres()[: _faces(atlas)]
    set_uniform(program, "face_centre", centres)
    set_uniform(program, "texels_per_unit", 0.5 * atlas.face_size)
    set_uniform(program, "atlas_texel", (1.0 / atlas.width, 1.0 / atlas.height))
    texture.use(0)


def _faces(atlas: Atlas) -> int:
    """Return how many faces a direction is compared with: the upward one only where it is drawn."""
    return 6 if any(cell.face is Face.U for cell in atlas.cells) else 5
