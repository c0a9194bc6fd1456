"""The trace renderer: a scene in Embree, and views of it on a thread pool.

A sample's radiance comes from a table, by the triangle that the ray hits; samples are summed in
linear light and encoded last, by one more table: a frame costs little more than its rays.
`ray_view` traces all rays; `cell_view` only those of an omnidirectional camera that the scene's
silhouettes leave open.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property

from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.cell_view import CellView
from catoptra_server.render.trace.cells import CellGrid
from catoptra_server.render.trace.embree_objects import EmbreeObjectScenes
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.lens_view import TraceLensView
from catoptra_server.render.trace.omni_view import TraceOmniView
from catoptra_server.render.trace.packed_light import LinearScale, RadianceScale, SrgbScale
from catoptra_server.render.trace.pixel_ranges import PixelRangeTracer
from catoptra_server.render.trace.projection_table import ProjectionTable
from catoptra_server.render.trace.ray_samples import (
    RaySamples,
    face_rays,
    lens_rays,
    omni_rays,
)
from catoptra_server.render.trace.ray_shader import RayShader, UnshadowedShader
from catoptra_server.render.trace.ray_view import RayView
from catoptra_server.render.trace.shadowed_shader import ShadowedShader, ShadowReceivers
from catoptra_server.render.trace.visible_surfaces import SurfacePlanes
from catoptra_server.scene.radiance_bounds import max_radiance
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import Light, World


class TraceRenderer:
    """A scene in Embree and a thread pool."""

    def __init__(
        self,
        scene: SceneMesh,
        world: World,
        *,
        threads: int = 0,
        scene_lights: tuple[Light, ...] | None = None,
    ) -> None:
        """Commit a scene.

        Args:
            scene: Triangles of the static scene.
            world: Lights and background.
            threads: Threads of the pool; 0 for one per processor that this process may use.
            scene_lights: Lights that change the static scene visibly; None for all of the world.
        """
        # Affinity, not cpu_count(): containers and tests may restrict the process to fewer
        # processors.
        self._threads = threads or len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="trace")
        lights = world.lights if scene_lights is None else scene_lights
        self._scene = EmbreeScene(scene, replace(world, lights=lights))
        # All lights for dynamic objects: they move and turn towards lights that the static scene
        # culls.
        self._object_scenes = EmbreeObjectScenes(world.lights)
        self._mesh = scene
        self._world = world

    @property
    def num_object_meshes(self) -> int:
        """Number of object meshes committed so far."""
        return len(self._object_scenes)

    @property
    def has_varying_light(self) -> bool:
        """Whether radiance varies over any triangle, by textures or by point lights."""
        return self._scene.has_varying_light

    def describe(self) -> str:
        """One-line description for logs: library, threads and scene size."""
        return f"trace: Embree, {self._threads} threads, {len(self._mesh)} triangles"

    @cached_property
    def _max_radiance(self) -> float:
        """Greatest radiance of the scene: the range of the fixed-point sums of linear images."""
        return max_radiance(self._mesh, self._world)

    @cached_property
    def _planes(self) -> SurfacePlanes:
        """The scene's surfaces: 1.5 s of work for a million triangles, done at the first use."""
        return SurfacePlanes(self._mesh)

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> TraceOmniView:
        """Prepare a view of an omnidirectional camera."""
        make_source, ray_bytes = self._make_source_factory(camera, plan)
        per_pixel = plan.samples**2

        def make_srgb(has_shadows: bool) -> RayView | CellView:
            return make_source(SrgbScale.for_samples(per_pixel), has_shadows)

        def make_linear(has_shadows: bool) -> RayView | CellView:
            scale = LinearScale.for_samples(per_pixel, max_radiance=self._max_radiance)
            return make_source(scale, has_shadows)

        return TraceOmniView(
            camera,
            make_encoded_source=make_srgb,
            make_linear_source=make_linear,
            make_ranges=lambda: PixelRangeTracer(
                self._scene, self._object_scenes, camera, plan, self._pool
            ),
            ray_bytes=ray_bytes,
        )

    def _make_source_factory(
        self, camera: OmniCamera, plan: RenderPlan
    ) -> tuple[Callable[[RadianceScale, bool], RayView | CellView], int]:
        """Function from a scale, and shadows or none, to a source; and the size of the rays."""
        samples = omni_rays(camera, plan)
        grid, table = self._make_cell_grid(camera, plan, samples)
        if grid is None or table is None:
            return (
                lambda scale, has_shadows: RayView(
                    self._make_shader(scale, has_shadows), samples, self._pool
                ),
                samples.memory_bytes,
            )
        # The cells have copies of all rays: `samples` ends here, and half the memory with it.
        return (
            lambda scale, has_shadows: CellView(
                self._planes, self._make_shader(scale, has_shadows), grid, table, self._pool
            ),
            grid.memory_bytes + table.memory_bytes,
        )

    def _make_shader(self, scale: RadianceScale, has_shadows: bool) -> RayShader:
        """Shading on a scale, with or without shadows."""
        if has_shadows:
            return ShadowedShader(self._scene, self._object_scenes, scale, self._shadow_receivers)
        return UnshadowedShader(self._scene, self._object_scenes, scale)

    @cached_property
    def _shadow_receivers(self) -> ShadowReceivers:
        """Triangles that shadows can change, found at the first use."""
        return ShadowReceivers(self._scene, self._mesh, self._world)

    def _make_cell_grid(
        self, camera: OmniCamera, plan: RenderPlan, samples: RaySamples
    ) -> tuple[CellGrid | None, ProjectionTable | None]:
        """Cells whose corners are traced before their rays; None where all rays are traced."""
        if plan.stride_px == 1:
            return None, None
        grid = CellGrid.from_camera(camera, samples, side_px=plan.stride_px)
        # A rim near the antipode has no table: then all rays are traced, as at a stride of one
        # pixel.
        return grid, ProjectionTable.from_camera(camera) if len(grid.pixels) else None

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> TraceLensView:
        """Prepare a view of a perspective camera; samples: along a side of each pixel."""
        return self._make_lens_view(lens_rays(camera, samples))

    def prepare_face(self, camera: FaceCamera, samples: int) -> TraceLensView:
        """Prepare a view of one virtual camera of the cube; samples: along a side of each pixel."""
        return self._make_lens_view(face_rays(camera, samples))

    def _make_lens_view(self, samples: RaySamples) -> TraceLensView:
        """View of prepared rays, with and without shadows."""
        scale = SrgbScale.for_samples(samples.samples_per_pixel)

        def make_view(has_shadows: bool) -> RayView:
            return RayView(self._make_shader(scale, has_shadows), samples, self._pool)

        return TraceLensView(make_view, ray_bytes=samples.memory_bytes)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()
