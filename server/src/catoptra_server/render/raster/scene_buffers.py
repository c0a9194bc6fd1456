"""A scene on the device: uploaded once, drawn for any face.

Triangles are grouped by texture and cut into chunks. A group has only the vertex attributes and the
program that it needs: no texture coordinates without a texture, no normals without point lights.
Places are relative to the middle of the scene, so that float32 keeps its precision in a world far
from zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render import shading
from catoptra_server.render.chunks import make_chunks, runs
from catoptra_server.render.raster.depth import Surroundings
from catoptra_server.render.raster.frame_uniforms import FrameUniforms
from catoptra_server.render.raster.moving_bodies import MovingBodies
from catoptra_server.render.raster.programs import (
    Definitions,
    Programs,
    ProgramSpec,
    set_uniform,
)
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh, Texture

# GL_SRGB8: the sampler turns texels into linear light before it filters them.
_SRGB8 = 0x8C41
# Two vec3 a light, each as large as a vec4, in the 1024 components that OpenGL 3.3 promises.
MAX_POINT_LIGHTS = 100


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """The triangles of one texture: their chunks, and what draws them."""

    chunks: slice
    program: moderngl.Program
    vertices: moderngl.VertexArray
    texture: moderngl.Texture | None


class SceneBuffers:
    """Vertex buffers, textures and programs of one world."""

    def __init__(
        self, context: moderngl.Context, programs: Programs, scene: SceneMesh, world: World
    ) -> None:
        self._context = context
        self._lights = shading.point_lights(world.lights)
        if len(self._lights) > MAX_POINT_LIGHTS:
            raise DomainError(
                f"raster draws at most {MAX_POINT_LIGHTS} point lights, not {len(self._lights)}"
            )
        self.background = world.background
        low, high = (scene.corners.min((0, 1)), scene.corners.max((0, 1))) if len(scene) else (0, 0)
        self.origin: Floats = np.zeros(3) + 0.5 * (low + high)
        self.bodies = MovingBodies(context, programs, world.lights, self.origin)
        corners = scene.corners - self.origin
        self.chunks = make_chunks(corners, (scene.texture_index + 1).astype(np.intp))
        self.chunk_sizes = np.diff(self.chunks.borders)
        self.surroundings = Surroundings(self.chunks, corners)
        self._attributes = self._upload(scene, world, corners)
        self._groups = [self._group(programs, scene, int(g)) for g in np.unique(self.chunks.group)]

    def _upload(
        self, scene: SceneMesh, world: World, corners: Floats
    ) -> dict[str, tuple[moderngl.Buffer, str]]:
        """Return the buffer and the format of each attribute that some group has."""
        attributes = {
            "position": corners,
            "radiance": _at_corners(shading.facet_radiance(scene, world.lights)),
        }
        if scene.textures:
            attributes["uv"] = scene.uv
        if self._lights:
            attributes["normal"] = _at_corners(scene.normals)
            attributes["lit_albedo"] = _at_corners(scene.albedo * ~scene.unlit[:, None])
        return {
            name: (self._buffer(values[self.chunks.order]), f"{values.shape[-1]}f")
            for name, values in attributes.items()
        }

    def _buffer(self, values: Floats) -> moderngl.Buffer:
        data = values.astype(np.float32).tobytes()
        # OpenGL knows no empty buffer, a world without surfaces exists.
        return self._context.buffer(data) if data else self._context.buffer(reserve=4)

    def _group(self, programs: Programs, scene: SceneMesh, index: int) -> Group:
        """Return group `index`: 0 = without a texture, then one for each texture."""
        names = ["position", "radiance"]
        define: Definitions = ()
        if index > 0:
            names, define = [*names, "uv"], (*define, ("TEXTURED", 1))
        if self._lights:
            names = [*names, "normal", "lit_albedo"]
            define = (*define, ("POINT_LIGHTS", len(self._lights)))
        program = programs.get(ProgramSpec("face", "face", define))
        content = [(*self._attributes[name], name) for name in names]
        members = np.flatnonzero(self.chunks.group == index)
        return Group(
            chunks=slice(int(members[0]), int(members[-1]) + 1),
            program=program,
            vertices=self._context.vertex_array(program, content),
            texture=upload_texture(self._context, scene.textures[index - 1]) if index > 0 else None,
        )

    def positions(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Return all corners, chunk by chunk, for a program that needs no more; not freed here."""
        buffer, layout = self._attributes["position"]
        return self._context.vertex_array(program, [(buffer, layout, "position")])

    def place(self, viewpoint: Floats, depth: tuple[float, float]) -> None:
        """Set the uniforms of a frame: a (3,) viewpoint in the scene's frame, and z = a w + b."""
        frame = FrameUniforms.of(viewpoint, depth, lights=self._lights, origin=self.origin)
        for program in {group.program for group in self._groups}:
            frame.set_on(program)
        self.bodies.use(frame)

    def draw(self, clip_from_scene: Floats, visible: Bools) -> int:
        """Draw the visible chunks through a (3, 3) map to clip x, y, w; return the draw calls."""
        calls = 0
        for group in self._groups:
            borders = self.chunks.borders[group.chunks.start : group.chunks.stop + 1]
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
        self.bodies.close()
        for group in self._groups:
            group.vertices.release()
            if group.texture is not None:
                group.texture.release()
        for buffer, _ in self._attributes.values():
            buffer.release()


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
