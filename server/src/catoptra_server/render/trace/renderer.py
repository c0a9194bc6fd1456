"""The trace renderer: a scene in Embree, and views of it on a few threads. Embree releases the GIL.

A sample's light is looked up by the triangle that it meets; samples are summed in linear light and
encoded last, by one more look-up: a frame costs little more than its rays. `ray_view` traces them
all; `cell_view` those of a mirror camera that are not known beforehand.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.effects.effect import Effect
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.plan.render_plan import RenderPlan
from catoptra_server.render.brightness import summarise
from catoptra_server.render.renderer import EffectView, FaceCamera, View
from catoptra_server.render.trace.cell_view import CellView
from catoptra_server.render.trace.cells import CellGrid
from catoptra_server.render.trace.effect_view import TraceEffectView
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.moving_bodies import BodyScenes
from catoptra_server.render.trace.packed_light import LightScale, LinearScale, Scale
from catoptra_server.render.trace.pixel_law import PixelLaw
from catoptra_server.render.trace.ray_colours import RayColours
from catoptra_server.render.trace.ray_view import RayView
from catoptra_server.render.trace.samples import (
    RaySamples,
    face_samples,
    lens_samples,
    omni_samples,
)
from catoptra_server.render.trace.seen_surfaces import SurfacePlanes
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh


class TraceRenderer:
    """Embree on a thread pool. `threads` 0: one for each processor this process may use."""

    def __init__(self, scene: SceneMesh, world: World, *, threads: int = 0) -> None:
        self._threads = threads or len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self._threads, thread_name_prefix="trace")
        self._scene = EmbreeScene(scene, world)
        self._bodies = BodyScenes(world.lights)
        self._mesh = scene
        self._world = world

    @property
    def body_meshes(self) -> int:
        """Return how many meshes of bodies were committed so far."""
        return len(self._bodies)

    def describe(self) -> str:
        """Return what draws, for logs."""
        return f"trace: Embree, {self._threads} threads, {len(self._mesh)} triangles"

    @cached_property
    def summary(self) -> SceneSummary:
        """Return what the scene can show at most."""
        return summarise(self._mesh, self._world)

    @cached_property
    def _planes(self) -> SurfacePlanes:
        """Return the scene's surfaces: 1.5 s of work for a million triangles, if asked for."""
        return SurfacePlanes(self._mesh)

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> View:
        """Return a view of the scene by an omnidirectional camera."""
        return self._omni_view(camera, plan, LightScale.for_samples)

    def prepare_with_effects(
        self, camera: OmniCamera, plan: RenderPlan, effects: tuple[Effect, ...]
    ) -> EffectView:
        """Return a view whose picture stays in linear light until all effects have changed it."""
        scale_of = partial(LinearScale.for_samples, largest=self.summary.largest_radiance)
        view = self._omni_view(camera, plan, scale_of)
        return TraceEffectView(view, effects, camera)

    def _omni_view(
        self, camera: OmniCamera, plan: RenderPlan, scale_of: Callable[[int], Scale]
    ) -> RayView | CellView:
        samples = omni_samples(camera, plan)
        scale = scale_of(samples.per_pixel)
        if plan.stride_px == 1:
            return self._view(samples, scale)
        grid = CellGrid.of(camera, samples, side_px=plan.stride_px)
        law = PixelLaw.of(camera) if len(grid.pixels) else None
        if law is None:
            return self._view(samples, scale)
        colours = RayColours(self._scene, self._bodies, scale)
        return CellView(self._planes, colours, grid, law, self._pool)

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> RayView:
        """Return a view of the scene by an ordinary camera."""
        return self._greys_view(lens_samples(camera, samples))

    def prepare_face(self, camera: FaceCamera, samples: int) -> RayView:
        """Return a view of the scene by one virtual camera of the cube."""
        return self._greys_view(face_samples(camera, samples))

    def _greys_view(self, samples: RaySamples) -> RayView:
        return self._view(samples, LightScale.for_samples(samples.per_pixel))

    def _view(self, samples: RaySamples, scale: Scale) -> RayView:
        colours = RayColours(self._scene, self._bodies, scale)
        return RayView(colours, samples, self._pool)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()
