"""The trace renderer: a scene in Embree, and views of it on a few threads. Embree releases the GIL.

A sample's light is looked up by the triangle that it meets; samples are summed in linear light and
encoded last, by one more look-up: a frame costs little more than its rays. `ray_view` traces them
all; `cell_view` those of a mirror camera that are not known beforehand.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.plan.render_plan import RenderPlan
from catoptra_server.render.reaching_lights import reaching_lights
from catoptra_server.render.renderer import Exposure, FaceCamera
from catoptra_server.render.summaries import SceneSummaries
from catoptra_server.render.trace.cell_view import CellView
from catoptra_server.render.trace.cells import CellGrid
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.lens_view import TraceLensView
from catoptra_server.render.trace.moving_bodies import BodyScenes
from catoptra_server.render.trace.omni_view import TraceOmniView
from catoptra_server.render.trace.packed_light import LightScale, LinearScale, Scale
from catoptra_server.render.trace.pixel_law import PixelLaw
from catoptra_server.render.trace.pixel_ranges import PixelRanges
from catoptra_server.render.trace.ray_colours import Colouring, RayColours
from catoptra_server.render.trace.ray_view import RayView
from catoptra_server.render.trace.samples import (
    RaySamples,
    face_samples,
    lens_samples,
    omni_samples,
)
from catoptra_server.render.trace.seen_surfaces import SurfacePlanes
from catoptra_server.render.trace.shadowed_colours import LitTriangles, ShadowedColours
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh


class TraceRenderer:
    """Embree on a thread pool. `threads` 0: one for each processor this process may use."""

    def __init__(self, scene: SceneMesh, world: World, *, threads: int = 0) -> None:
        self._threads = threads or len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="trace")
        reaching = reaching_lights(scene, world.lights)
        self._scene = EmbreeScene(scene, replace(world, lights=reaching))
        self._bodies = BodyScenes(world.lights)
        self._summaries = SceneSummaries(scene, world)
        self._mesh = scene
        self._world = world

    @property
    def body_meshes(self) -> int:
        """Return how many meshes of bodies were committed so far."""
        return len(self._bodies)

    @property
    def light_varies(self) -> bool:
        """Return whether light varies over any triangle: by textures, or lamps that reach it."""
        return self._scene.light_varies

    def describe(self) -> str:
        """Return what draws, for logs."""
        return f"trace: Embree, {self._threads} threads, {len(self._mesh)} triangles"

    def summary(self, exposure: Exposure, camera: OmniCamera) -> SceneSummary:
        """Return what an exposure can show at most."""
        return self._summaries.of(exposure, camera)

    def light_summary(self, exposure: Exposure) -> SceneSummary:
        """Return the brightest light that an exposure can show, and of the rest nothing."""
        return self._summaries.of_light()

    @cached_property
    def _planes(self) -> SurfacePlanes:
        """Return the scene's surfaces: 1.5 s of work for a million triangles, if asked for."""
        return SurfacePlanes(self._mesh)

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> TraceOmniView:
        """Return a view of the scene by an omnidirectional camera."""
        samples = omni_samples(camera, plan)
        grid, law = self._cells(camera, plan, samples)

        def source(scale: Scale, has_shadows: bool) -> RayView | CellView:
            colours = self._colours(scale, has_shadows)
            if grid is None or law is None:
                return RayView(colours, samples, self._pool)
            return CellView(self._planes, colours, grid, law, self._pool)

        def greys(has_shadows: bool) -> RayView | CellView:
            return source(LightScale.for_samples(samples.per_pixel), has_shadows)

        def linear(has_shadows: bool) -> RayView | CellView:
            largest = self._summaries.largest_radiance
            return source(LinearScale.for_samples(samples.per_pixel, largest=largest), has_shadows)

        return TraceOmniView(
            camera,
            greys=greys,
            linear=linear,
            ranges=lambda: PixelRanges(self._scene, self._bodies, camera, plan, self._pool).of,
        )

    def _colours(self, scale: Scale, has_shadows: bool) -> Colouring:
        if has_shadows:
            return ShadowedColours(self._scene, self._bodies, scale, self._lit)
        return RayColours(self._scene, self._bodies, scale)

    @cached_property
    def _lit(self) -> LitTriangles:
        """Return what lights can reach, for shadows, if asked for."""
        return LitTriangles(self._scene, self._mesh, self._world)

    def _cells(
        self, camera: OmniCamera, plan: RenderPlan, samples: RaySamples
    ) -> tuple[CellGrid | None, PixelLaw | None]:
        """Return the cells whose corners are asked before their rays; None: all rays are traced."""
        if plan.stride_px == 1:
            return None, None
        grid = CellGrid.of(camera, samples, side_px=plan.stride_px)
        return grid, PixelLaw.of(camera) if len(grid.pixels) else None

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> TraceLensView:
        """Return a view of the scene by an ordinary camera."""
        return self._view(lens_samples(camera, samples))

    def prepare_face(self, camera: FaceCamera, samples: int) -> TraceLensView:
        """Return a view of the scene by one virtual camera of the cube."""
        return self._view(face_samples(camera, samples))

    def _view(self, samples: RaySamples) -> TraceLensView:
        scale = LightScale.for_samples(samples.per_pixel)

        def source(has_shadows: bool) -> RayView:
            return RayView(self._colours(scale, has_shadows), samples, self._pool)

        return TraceLensView(source)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()
