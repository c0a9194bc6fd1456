"""The triangles of a scene with the vertex attributes and programs of one way to light them.

A group has only what it needs: no texture coordinates without a texture, no normals where light is
constant over each triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render import shading
from catoptra_server.render.chunks import Chunks, runs
from catoptra_server.render.raster.programs import (
    Definitions,
    Programs,
    ProgramSpec,
    set_uniform,
)
from catoptra_server.scene.description import Light
from catoptra_server.scene.meshes import SceneMesh, Texture

# GL_SRGB8: the sampler turns texels into linear light before it filters them.
_SRGB8 = 0x8C41

Attribute = tuple[moderngl.Buffer, str]


@dataclass(frozen=True, slots=True)
class FacetLight:
    """How the faces' programs light facets.

    constant: the lights that give each triangle one radiance. varying: what a program defines that
    computes the light of others from place and normal; empty: there are none.
    """

    constant: tuple[Light, ...]
    varying: Definitions = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """The triangles of one texture: their chunks, and what draws them."""

    chunks: slice
    program: moderngl.Program
    vertices: moderngl.VertexArray
    texture: moderngl.Texture | None


class SceneLook:
    """What draws a scene's chunks in one light. `position`: their corners, not freed here."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        scene: SceneMesh,
        chunks: Chunks,
        *,
        position: Attribute,
        light: FacetLight,
    ) -> None:
        self._context = context
        self._chunks = chunks
        self._light = light
        self._owned = self._upload(scene)
        self._attributes = {"position": position, **self._owned}
        self._groups = [self._group(programs, scene, int(g)) for g in np.unique(chunks.group)]

    @property
    def programs(self) -> set[moderngl.Program]:
        """Return the programs that draw it."""
        return {group.program for group in self._groups}

    def _upload(self, scene: SceneMesh) -> dict[str, Attribute]:
        """Return the buffer and the format of each attribute that some group has."""
        of_triangles = shading.facet_radiance(scene, self._light.constant)
        attributes = {"radiance": _at_corners(of_triangles)}
        if scene.textures:
            attributes["uv"] = scene.uv
        if self._light.varying:
            attributes["normal"] = _at_corners(scene.normals)
            attributes["lit_albedo"] = _at_corners(scene.albedo * ~scene.unlit[:, None])
        return {
            name: attribute(self._context, values[self._chunks.order])
            for name, values in attributes.items()
        }

    def _group(self, programs: Programs, scene: SceneMesh, index: int) -> _Group:
        """Return group `index`: 0 = without a texture, then one for each texture."""
        names = ["position", "radiance"]
        define: Definitions = ()
        if index > 0:
            names, define = [*names, "uv"], (*define, ("TEXTURED", 1))
        if self._light.varying:
            names = [*names, "normal", "lit_albedo"]
            define = (*define, *self._light.varying)
        program = programs.get(ProgramSpec("face", "face", define))
        content = [(*self._attributes[name], name) for name in names]
        members = np.flatnonzero(self._chunks.group == index)
        return _Group(
            chunks=slice(int(members[0]), int(members[-1]) + 1),
            program=program,
            vertices=self._context.vertex_array(program, content),
            texture=upload_texture(self._context, scene.textures[index - 1]) if index > 0 else None,
        )

    def draw(self, clip_from_scene: Floats, visible: Bools) -> int:
        """Draw the visible chunks through a (3, 3) map to clip x, y, w; return the draw calls."""
        calls = 0
        for group in self._groups:
            borders = self._chunks.borders[group.chunks.start : group.chunks.stop + 1]
            parts = runs(visible[group.chunks], borders)
            if not parts:
                continue
            set_uniform(group.program, "clip_from_scene", clip_from_scene.T)
            if group.texture is not None:
                group.texture.use(0)
            for first, count in parts:
                group.vertices.render(vertices=3 * count, first=3 * first)
            calls += len(parts)
        return calls

    def close(self) -> None:
        """Free the buffers, vertex arrays and textures; programs belong to the context."""
        for group in self._groups:
            group.vertices.release()
            if group.texture is not None:
                group.texture.release()
        for buffer, _ in self._owned.values():
            buffer.release()


def attribute(context: moderngl.Context, values: Floats) -> Attribute:
    """Return a buffer of (n, 3, k) values at corners, and its format."""
    data = values.astype(np.float32).tobytes()
    # OpenGL knows no empty buffer, a world without surfaces exists.
    buffer = context.buffer(data) if data else context.buffer(reserve=4)
    return buffer, f"{values.shape[-1]}f"


def upload_texture(context: moderngl.Context, image: Texture) -> moderngl.Texture:
    """Return a texture that repeats and is filtered as shading.texture_value does.

    Row 0 of the image is row 0 of the texture, so (0, 0) is the image's top left corner.
    """
    height, width = image.shape[:2]
    texture = context.texture((width, height), 3, image.tobytes(), internal_format=_SRGB8)
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    return texture


def _at_corners(values: Floats) -> Floats:
    """Return (n, 3, 3): each triangle's (n, 3) values at its three corners."""
    return np.repeat(values[:, None], 3, axis=1)
