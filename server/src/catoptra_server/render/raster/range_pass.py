"""How far away is what each pixel sees, found on the device: ranges in an atlas of their own.

The same faces once more, one sample a texel, and looked up without interpolation: a range between
two surfaces would be that of neither. At a border a pixel may so show what is half a texel aside.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.chunks import runs
from catoptra_server.render.raster.atlas import Atlas
from catoptra_server.render.raster.faces import edge_planes, frame_depth
from catoptra_server.render.raster.programs import Programs, ProgramSpec, set_sampler, set_uniform
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.renderer import Exposure
from catoptra_server.scene.bodies import Body


class RangePass:
    """From the scene to the texture of each pixel's range. places: the pass frees them."""

    name = "ranges"

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        scene: SceneBuffers,
        atlas: Atlas,
        camera: OmniCamera,
        places: moderngl.Texture,
    ) -> None:
        self._context = context
        self._scene = scene
        self._atlas = atlas
        self._places = places
        self._clip_from_mirror = np.stack([cell.clip_from_mirror for cell in atlas.cells])
        self._spread = max(cell.spread for cell in atlas.cells)
        size = (atlas.width, atlas.height)
        self._texels = _texture(context, size)
        self._depth = context.depth_renderbuffer(size)
        self._target = context.framebuffer([self._texels], self._depth)
        self.texture = _texture(context, (camera.width_px, camera.height_px))
        self._seen = context.framebuffer([self.texture])
        self._surfaces = programs.get(ProgramSpec("range", "range"))
        self._vertices = scene.positions(self._surfaces)
        self._bodies = BodyPlaces(context, self._surfaces, scene.origin)
        self._look_up = programs.get(ProgramSpec("cover", "pixel_range"))
        self._cover = context.vertex_array(self._look_up, [])

    def draw(self, exposure: Exposure) -> None:
        """Fill the texture with what is seen in an exposure."""
        self._draw_faces(exposure)
        self._context.enable_only(moderngl.NOTHING)
        self._seen.use()
        set_sampler(self._look_up, "places", 1)
        self._texels.use(0)
        self._places.use(1)
        self._cover.render(vertices=3)

    def _draw_faces(self, exposure: Exposure) -> None:
        pose = exposure.world_from_mirror
        viewpoint = pose.translation - self._scene.origin
        depth = frame_depth(self._scene, exposure, self._spread)
        set_uniform(self._surfaces, "viewpoint", viewpoint)
        set_uniform(self._surfaces, "depth_from_forward", depth.clip_z_from_w)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = "<"
        self._target.viewport = (0, 0, self._atlas.width, self._atlas.height)
        self._target.clear(math.inf, depth=1.0)
        self._target.use()
        self._bodies.place(exposure.bodies)
        clip_from_scene = self._clip_from_mirror @ pose.rotation.T
        visible = self._scene.chunks.in_front(edge_planes(clip_from_scene), viewpoint)
        for cell, clip, seen in zip(self._atlas.cells, clip_from_scene, visible, strict=True):
            self._context.viewport = cell.viewport
            set_uniform(self._surfaces, "clip_from_scene", clip.T)
            self._draw_scene(seen)
            self._bodies.draw()

    def _draw_scene(self, visible: Bools) -> None:
        for first, count in runs(visible, self._scene.chunks.borders):
            self._vertices.render(vertices=3 * count, first=3 * first)

    def read(self) -> npt.NDArray[np.float32]:
        """Return the (h, w) ranges of the last frame, metres."""
        width, height = self.texture.size
        data = self._seen.read(components=1, dtype="f4", alignment=1)
        return np.frombuffer(data, dtype=np.float32).reshape(height, width)

    def close(self) -> None:
        """Free what the pass holds; the scene's vertices stay the scene's."""
        self._bodies.close()
        for resource in (
            self._vertices,
            self._cover,
            self._target,
            self._seen,
            self._texels,
            self._depth,
            self.texture,
            self._places,
        ):
            resource.release()


class BodyPlaces:
    """The corners of an exposure's bodies where they stand; without any there is no buffer."""

    def __init__(
        self, context: moderngl.Context, program: moderngl.Program, origin: Floats
    ) -> None:
        self._context = context
        self._program = program
        self._origin = origin
        self._held: list[tuple[moderngl.VertexArray, moderngl.Buffer]] = []

    def place(self, bodies: tuple[Body, ...]) -> None:
        """Take over the bodies of an exposure and where they are."""
        self.close()
        for body in bodies:
            places = body.world_from_body.points(body.mesh.corners) - self._origin
            buffer = self._context.buffer(places.astype(np.float32).tobytes())
            content = [(buffer, "3f", "position")]
            self._held.append((self._context.vertex_array(self._program, content), buffer))

    def draw(self) -> None:
        """Draw all of them."""
        for vertices, _ in self._held:
            vertices.render()

    def close(self) -> None:
        """Free the buffers."""
        for pair in self._held:
            for resource in pair:
                resource.release()
        self._held.clear()


def _texture(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Texture:
    texture = context.texture(size, 1, dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
