"""The first pass of a view: the scene and its dynamic objects, projected from the viewpoint.

For a mirror these are the faces of the cube, in an atlas; for a perspective camera, the image.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.projection.atlas import Atlas, AtlasCell
from catoptra_server.render.projection.frustum import LensProjection
from catoptra_server.render.raster.device import (
    Definitions,
    ProgramSpec,
    SampleSpacing,
    ShaderPrograms,
    make_depth_buffer,
    set_sampler,
    set_uniform,
)
from catoptra_server.render.raster.passes import LINEAR_DTYPE, image_bytes
from catoptra_server.render.raster.scene_batches import Batch
from catoptra_server.render.raster.scene_buffers import LitScene, SceneBuffers
from catoptra_server.world.objects import CameraState
from catoptra_server.world.shading import LEAST_COVERAGE, MAX_LAYERS

# Units 0 to 3 have textures, shadow maps and the map of occlusion.
_DEPTH_UNIT = 4
_LayoutT = TypeVar("_LayoutT", bound=Atlas | LensProjection)
"""Layout of the texture: an atlas of faces, or one perspective image."""


class FacePass(Generic[_LayoutT]):
    """Renders the faces of one view into a texture."""

    name = "faces"

    def __init__(
        self,
        context: moderngl.Context,
        scene: SceneBuffers,
        atlas: _LayoutT,
        samples: int,
        spacing: SampleSpacing | None = None,
    ) -> None:
        """Create the texture and its framebuffers.

        Args:
            context: OpenGL context.
            scene: Scene on the device.
            atlas: Layout of the planar images.
            samples: Multisampling of each texel; 1 for none.
            spacing: Samples of the image that the faces are for; None: the texels themselves.

        Raises:
            DomainError: The device offers fewer samples.
        """
        if samples > context.max_samples:
            raise DomainError(
                f"this OpenGL offers at most {context.max_samples} samples a texel, not {samples}"
            )
        self._context = context
        self._scene = scene
        self._spacing = spacing
        self._least_rad = 0.0 if spacing is None else spacing.least_rad
        if isinstance(atlas, LensProjection):
            self._least_rad = atlas.least_spacing_rad
        self.atlas = atlas
        self._clip_from_mirror = np.stack([cell.clip_from_mirror for cell in atlas.cells])
        self._texels = sum(cell.width * cell.height for cell in atlas.cells)
        size = (atlas.width, atlas.height)
        self.texture = context.texture(size, 4, dtype=LINEAR_DTYPE)
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        # Clamped, since look-ups at the outer border of the atlas must not wrap to the opposite
        # cell.
        self.texture.repeat_x = self.texture.repeat_y = False
        # A multisampled texture cannot be looked up with filtering: samples are resolved into the
        # texture.
        multi = samples if samples > 1 else 0
        colour = (
            context.texture(size, 4, dtype=LINEAR_DTYPE, samples=multi) if multi else self.texture
        )
        depth = make_depth_buffer(context, size, multi)
        self._target = context.framebuffer([colour], depth)
        self._resolved = context.framebuffer([self.texture]) if multi else None
        self._owned = [self._target, depth, *((colour, self._resolved) if multi else ())]
        self.memory_bytes = image_bytes(self.texture, depth, *((colour,) if multi else ()))
        """Size of the images of the faces."""
        self._layers: _Layers | None = None
        if scene.blended.any():
            self._layers = _Layers(context, scene.programs, self._target, size, multi)
            self.memory_bytes += image_bytes(*self._layers.images)
        self._sky: moderngl.VertexArray | None = None
        if scene.sky is not None:
            program = scene.programs.get(ProgramSpec("fullscreen_triangle", "sky"))
            self._sky = context.vertex_array(program, [])
        self.counts = DrawCounts(0, 0, 0, 0)

    def draw(self, camera_state: CameraState) -> None:
        """Render the faces from the viewpoint of a camera state."""
        viewpoint = camera_state.world_from_mirror.translation - self._scene.origin
        self._scene.textures.refine(viewpoint, self._least_rad)
        self._draw(camera_state)

    def compile(self) -> None:
        """Let the driver compile all programs, by a frame of no content at the scene's centre."""
        self._draw(CameraState(Pose.from_rpy(self._scene.origin)))

    def _draw(self, camera_state: CameraState) -> None:
        pose = camera_state.world_from_mirror
        viewpoint = pose.translation - self._scene.origin
        scene = self._scene.with_lighting(camera_state)
        # Before set_frame: whether objects' programs need uniforms depends on the upload.
        scene.dynamic_objects.upload(camera_state.objects, pose.translation)
        definitions = () if self._layers is None else self._layers.definitions
        batches = scene.batches.layer_batches(definitions) if definitions else []
        scene.batches.set_light(has_bake=camera_state.has_baked_light)
        scene.set_frame(viewpoint)
        scene.set_fog(camera_state.fog)
        scene.set_spacing(self._spacing, pose.rotation[:, 2])
        fog = camera_state.fog
        self._begin(self._scene.background if fog is None else fog.airlight)
        clip_from_scene = self._clip_from_mirror @ pose.rotation.T
        if fog is None and camera_state.has_sky:
            self._draw_sky(clip_from_scene)
        calls, triangles = self._draw_cells(scene, clip_from_scene, viewpoint)
        if self._layers is not None:
            drops_layers = self._layers.draw(
                batches, lambda: self._draw_cells(scene, clip_from_scene, viewpoint, batches)
            )
            if drops_layers:
                self._scene.report_dropped_layers()
        # The resolve averages samples of a texel in linear light, since the texture is not sRGB.
        if self._resolved is not None:
            self._context.copy_framebuffer(self._resolved, self._target)
        self.counts = DrawCounts(len(self.atlas.cells), self._texels, calls, triangles)

    def _begin(self, background: tuple[float, float, float]) -> None:
        """Clear the whole target at once, which drivers do much faster than a part."""
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = ">"
        self._target.viewport = (0, 0, self.atlas.width, self.atlas.height)
        self._target.clear(*background, 1.0, depth=0.0)
        self._target.use()

    def _draw_sky(self, clip_from_scene: Floats) -> None:
        """Fill all faces, by their (n, 3, 3) maps, with the sky of each direction."""
        if self._sky is None or self._scene.sky is None:
            return
        self._context.enable_only(moderngl.NOTHING)
        self._scene.sky.use(0)
        cells: tuple[AtlasCell | LensProjection, ...] = self.atlas.cells
        for cell, scene_from_clip in zip(cells, np.linalg.inv(clip_from_scene), strict=True):
            self._context.viewport = cell.viewport
            set_uniform(self._sky.program, "viewport", cell.viewport)
            set_uniform(self._sky.program, "scene_from_clip", scene_from_clip.T)
            self._sky.render(vertices=3)
        self._context.enable_only(moderngl.DEPTH_TEST)

    def _draw_cells(
        self,
        scene: LitScene,
        clip_from_scene: Floats,
        viewpoint: Floats,
        batches: list[Batch] | None = None,
    ) -> tuple[int, int]:
        """Draw all faces by their (n, 3, 3) maps; return the draw calls and the triangles sent.

        Batches of what blends are drawn alone; None for all else.
        """
        planes = frustum_planes(clip_from_scene)
        visible = self._scene.clusters.in_front_of_planes(planes, viewpoint)
        if batches is not None:
            visible = visible & self._scene.blended
        cells: tuple[AtlasCell | LensProjection, ...] = self.atlas.cells
        pieces = self._scene.split_large_triangles(viewpoint)
        calls = triangles = 0
        for cell, clip, cell_planes, visible_clusters in zip(
            cells, clip_from_scene, planes, visible, strict=True
        ):
            self._context.viewport = cell.viewport
            counts = [scene.batches.draw(clip, visible_clusters, pieces, batches)]
            if batches is None:
                counts.append(scene.dynamic_objects.draw(clip, cell_planes, viewpoint))
            calls += sum(each[0] for each in counts)
            triangles += sum(each[1] for each in counts)
        return calls, triangles

    def close(self) -> None:
        """Free the texture and its framebuffers."""
        for resource in (*self._owned, self.texture):
            resource.release()
        if self._layers is not None:
            self._layers.close()
        if self._sky is not None:
            self._sky.release()


class _Layers:
    """Blended facets over what is opaque: one layer after the other, the nearest first.

    Each layer is the nearest of what lies behind the one before, sample by sample (Everitt 2001,
    "Interactive Order-Independent Transparency"). Sums are half floats: eight layers may lose half
    a grey level. Where two surfaces are nearer to each other than float32 depths tell, as where
    they coincide, one of them is shown, and trace may show the other.
    """

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        opaque: moderngl.Framebuffer,
        size: tuple[int, int],
        multi: int,
    ) -> None:
        """Create the images over an opaque one of a size, and of samples if it has several."""
        self._context = context
        self._opaque = opaque
        samples: Definitions = (("MULTISAMPLED", 1),) if multi else ()
        self.definitions: Definitions = (("LEAST_LAYER", round(1.0 / LEAST_COVERAGE)), *samples)
        """Definitions of programs that draw a layer."""
        self._colour, self._sum = (
            context.texture(size, 4, dtype=LINEAR_DTYPE, samples=multi) for _ in range(2)
        )
        self._depths = [context.texture(size, 1, dtype="f4", samples=multi) for _ in range(2)]
        buffer = make_depth_buffer(context, size, multi)
        self._start = context.framebuffer([self._colour], buffer)
        self._cleared = [context.framebuffer([self._colour, depth]) for depth in self._depths]
        self._targets = [
            context.framebuffer([self._colour, depth], buffer) for depth in self._depths
        ]
        self._blended = context.framebuffer([self._sum])
        self._program = programs.get(ProgramSpec("fullscreen_triangle", "layer", samples))
        self._triangle = context.vertex_array(self._program, [])
        self._query = context.query(samples=True)
        self.images: list[Any] = [self._colour, self._sum, *self._depths, buffer]
        """All images of layers."""
        self._owned: list[Any] = [
            self._start,
            *self._cleared,
            *self._targets,
            self._blended,
            self._triangle,
        ]

    def draw(self, batches: list[Batch], draw_facets: Callable[[], object]) -> bool:
        """Draw the layers by batches, which a function draws into all faces.

        Returns:
            Whether there are more layers than are drawn.
        """
        for program in {batch.program for batch in batches}:
            set_sampler(program, "depth_before", _DEPTH_UNIT)
        # Nothing yet, which lets all light through; and nothing is nearer than depth 1.
        self._blended.clear(0.0, 0.0, 0.0, 1.0)
        self._cleared[1].clear(1.0, 1.0, 1.0, 1.0)
        for layer in range(MAX_LAYERS + 1):
            target, cleared = self._targets[layer % 2], self._cleared[layer % 2]
            # The depths of what is opaque; its colours are overwritten.
            self._context.copy_framebuffer(self._start, self._opaque)
            cleared.clear(0.0, 0.0, 0.0, 0.0)
            self._context.enable_only(moderngl.DEPTH_TEST)
            target.use()
            self._depths[1 - layer % 2].use(_DEPTH_UNIT)
            with self._query:
                draw_facets()
            has_layer = self._query.samples > 0
            if not has_layer or layer == MAX_LAYERS:
                break
            self._add(
                self._colour,
                self._blended,
                (moderngl.DST_ALPHA, moderngl.ONE, moderngl.ZERO, moderngl.ONE_MINUS_SRC_ALPHA),
            )
        self._add(self._sum, self._opaque, (moderngl.ONE, moderngl.SRC_ALPHA))
        return has_layer

    def _add(self, image: moderngl.Texture, target: moderngl.Framebuffer, factors: Any) -> None:
        """Blend an image into another by factors of colours, or of these and opacities."""
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = factors
        target.viewport = (0, 0, *target.size)
        target.use()
        image.use(0)
        self._triangle.render(vertices=3)

    def close(self) -> None:
        """Free the images."""
        for resource in (*self._owned, *self.images):
            resource.release()


@dataclass(frozen=True, slots=True)
class DrawCounts:
    """Cost of a frame's faces."""

    num_cells: int
    """Planar images rendered."""
    num_texels: int
    """Texels of all cells, guard bands included."""
    num_draw_calls: int
    """OpenGL draw calls."""
    num_triangles: int
    """Triangles sent to the device."""


def frustum_planes(clip_from_scene: Floats) -> Floats:
    """(n, 5, 3) inward normals of the frustum planes of (n, 3, 3) maps to clip x, y, w."""
    x, y, w = np.moveaxis(clip_from_scene, 1, 0)
    # Clipping keeps -w <= x, y <= w and w > 0; each inequality is linear in the direction, so its
    # coefficients are the plane's normal (Gribb and Hartmann 2001).
    return np.stack((w + x, w - x, w + y, w - y, w), axis=1)
