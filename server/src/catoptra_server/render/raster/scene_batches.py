"""The triangles of a scene with the vertex attributes and programs of one way to light them.

A group has only what it needs: no texture coordinates without a texture, no normals where light is
constant over each triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.raster.shader_programs import (
    Definitions,
    ProgramSpec,
    ShaderPrograms,
    set_uniform,
)
from catoptra_server.scene import shading
from catoptra_server.scene.scene_mesh import SceneMesh, Texture
from catoptra_server.scene.triangle_clusters import TriangleClusters, visible_runs
from catoptra_server.scene.world_description import Light

# GL_SRGB8: the sampler turns texels into linear light before it filters them.
_SRGB8 = 0x8C41

VertexAttribute = tuple[moderngl.Buffer, str]


@dataclass(frozen=True, slots=True)
class FacetLighting:
    """How the faces' programs light facets.

    constant: the lights that give each triangle one radiance. varying: what a program defines that
    computes the light of others from place and normal; empty: there are none.
    """

    constant_lights: tuple[Light, ...]
    definitions: Definitions = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """The triangles of one texture: their chunks, and what draws them."""

    clusters: slice
    program: moderngl.Program
    vertices: moderngl.VertexArray
    texture: moderngl.Texture | None


class SceneBatches:
    """What draws a scene's chunks in one light. `position`: their corners, not freed here."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        scene: SceneMesh,
        clusters: TriangleClusters,
        *,
        position: VertexAttribute,
        lighting: FacetLighting,
    ) -> None:
        self._context = context
        self._clusters = clusters
        self._lighting = lighting
        self._owned = self._upload(scene)
        self._attributes = {"position": position, **self._owned}
        self._batches = [
            self._make_batch(programs, scene, int(g)) for g in np.unique(clusters.groups)
        ]

    @property
    def programs(self) -> set[moderngl.Program]:
        """Return the programs that draw it."""
        return {group.program for group in self._batches}

    def _upload(self, scene: SceneMesh) -> dict[str, VertexAttribute]:
        """Return the buffer and the format of each attribute that some group has."""
        of_triangles = shading.facet_radiance(scene, self._lighting.constant_lights)
        attributes = {"radiance": _repeat_at_corners(of_triangles)}
        if scene.textures:
            attributes["uv"] = scene.uv
        if self._lighting.definitions:
            attributes["normal"] = _repeat_at_corners(scene.normals)
            attributes["lit_albedo"] = _repeat_at_corners(scene.albedo * ~scene.unlit[:, None])
        return {
            name: make_attribute(self._context, values[self._clusters.order])
            for name, values in attributes.items()
        }

    def _make_batch(self, programs: ShaderPrograms, scene: SceneMesh, index: int) -> _Batch:
        """Return group `index`: 0 = without a texture, then one for each texture."""
        names = ["position", "radiance"]
        define: Definitions = ()
        if index > 0:
            names, define = [*names, "uv"], (*define, ("TEXTURED", 1))
        if self._lighting.definitions:
            names = [*names, "normal", "lit_albedo"]
            define = (*define, *self._lighting.definitions)
        program = programs.get(ProgramSpec("face", "face", define))
        content = [(*self._attributes[name], name) for name in names]
        members = np.flatnonzero(self._clusters.groups == index)
        return _Batch(
            clusters=slice(int(members[0]), int(members[-1]) + 1),
            program=program,
            vertices=self._context.vertex_array(program, content),
            texture=upload_texture(self._context, scene.textures[index - 1]) if index > 0 else None,
        )

    def draw(self, clip_from_scene: Floats, visible: Bools) -> int:
        """Draw the visible chunks through a (3, 3) map to clip x, y, w; return the draw calls."""
        calls = 0
        for group in self._batches:
            borders = self._clusters.offsets[group.clusters.start : group.clusters.stop + 1]
            parts = visible_runs(visible[group.clusters], borders)
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
        for group in self._batches:
            group.vertices.release()
            if group.texture is not None:
                group.texture.release()
        for buffer, _ in self._owned.values():
            buffer.release()


def make_attribute(context: moderngl.Context, values: Floats) -> VertexAttribute:
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


def _repeat_at_corners(values: Floats) -> Floats:
    """Return (n, 3, 3): each triangle's (n, 3) values at its three corners."""
    return np.repeat(values[:, None], 3, axis=1)
