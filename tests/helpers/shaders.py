"""GLSL functions evaluated by the device, one fragment an input: the float32 half of a twin test.

The main function comes from `tests/twins/shaders/`, the functions under test from the server's
files.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.raster.device import (
    GL_LIBRARY,
    GLSL_VERSION,
    Definitions,
    load_source,
    set_uniform,
)
from catoptra_server.render.raster.scene_batches import ImageTexture

_MAINS = Path(__file__).parent.parent / "twins" / "shaders"


def evaluate_shader(
    context: moderngl.Context,
    main_file: str,
    *,
    include: str | None,
    inputs: tuple[Floats, ...],
    uniforms: Mapping[str, npt.ArrayLike] | None = None,
    define: Definitions = (),
    texture: ImageTexture | None = None,
) -> Floats:
    """(n, 4) outputs of a main function for (n, <= 4) inputs `input_0`, `input_1`, ...

    texture: bound as `albedo_texture`. All values pass through float32.
    """
    functions = load_source(include, define) if include else GLSL_VERSION
    program = context.program(
        vertex_shader=load_source("fullscreen_triangle.vert"),
        fragment_shader="\n".join((functions, (_MAINS / main_file).read_text(encoding="utf-8"))),
    )
    count = len(inputs[0])
    for unit, values in enumerate(inputs):
        _input_texture(context, values).use(unit)
        program[f"input_{unit}"] = unit
    if texture is not None:
        texture.use(len(inputs))
        program["albedo_texture"] = len(inputs)
    for name, value in (uniforms or {}).items():
        set_uniform(program, name, value)
    target = context.framebuffer(
        [context.texture((_COLUMNS, -(-count // _COLUMNS)), 4, dtype="f4")]
    )
    target.use()
    context.enable_only(moderngl.NOTHING)
    context.vertex_array(program, []).render(vertices=3)
    read = np.frombuffer(target.read(components=4, dtype="f4"), dtype=np.float32)
    return read.reshape(-1, 4)[:count].astype(np.float64)


def read_texels(texture: ImageTexture, level: int, shape: tuple[int, ...]) -> npt.NDArray[np.uint8]:
    """Bytes of a level of a texture as (h, w, 3) texels."""
    texels = np.zeros(shape, dtype=np.uint8)
    library = ctypes.CDLL(GL_LIBRARY)
    texture.use()
    library.glPixelStorei(0x0D05, 1)  # GL_PACK_ALIGNMENT
    # GL_TEXTURE_2D, GL_RGB, GL_UNSIGNED_BYTE.
    target = texels.ctypes.data_as(ctypes.c_void_p)
    library.glGetTexImage(0x0DE1, level, 0x1907, 0x1401, target)
    return texels


# Inputs stand in rows of this many texels: a single row would end at the largest texture.
_COLUMNS = 1024


def _input_texture(context: moderngl.Context, values: Floats) -> moderngl.Texture:
    rows = -(-len(values) // _COLUMNS)
    texels = np.zeros((rows * _COLUMNS, 4), dtype=np.float32)
    texels[: len(values), : values.shape[1]] = values
    table = context.texture((_COLUMNS, rows), 4, texels.tobytes(), dtype="f4")
    table.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return table


def atlas_texels(context: moderngl.Context, atlas: Atlas, directions: Floats) -> Floats:
    """(n, 2) texels of (n, 3) directions by include/atlas.glsl."""
    out = evaluate_shader(
        context,
        "atlas_coordinates.frag",
        include="include/atlas.glsl",
        inputs=(directions,),
        uniforms={
            "face_texel_transform": atlas.texel_transforms(),
            "atlas_texel": (1.0 / atlas.width, 1.0 / atlas.height),
        },
        define=(("NUM_FACES", atlas.num_faces),),
    )
    return out[:, :2] * (atlas.width, atlas.height)
