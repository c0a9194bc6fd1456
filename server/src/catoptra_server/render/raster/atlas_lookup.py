"""Definitions and uniforms of programs that include include/atlas.glsl."""

from __future__ import annotations

import moderngl

from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.raster.shader_programs import Definitions, set_uniform


def atlas_definitions(atlas: Atlas) -> Definitions:
    """Preprocessor definitions of such a program."""
    # A definition instead of a uniform: without face U the shader has no comparison with U.
    return (("NUM_FACES", atlas.num_faces),)


def set_atlas_uniforms(program: moderngl.Program, atlas: Atlas) -> None:
    """Set the atlas' transforms and size in a program."""
    set_uniform(program, "face_texel_transform", atlas.texel_transforms())
    set_uniform(program, "atlas_texel", (1.0 / atlas.width, 1.0 / atlas.height))
