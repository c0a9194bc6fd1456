"""The trace renderer: one ray a sample, traced and shaded by an engine.

The engine is the native kernel where it can run, else its float64 reference in NumPy, two hundred
times slower. A frame without image effects is encoded by the engine itself; else the engine's image
changer applies the effects to linear light, by native stages or the formulas of `effects/`.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Literal

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects import CaptureContext, ImageEffect, LightSource, Threshold
from catoptra_server.render.image_changer import ExposedImage, narrow_thresholds
from catoptra_server.render.renderer import (
    NO_THRESHOLDS,
    FaceCamera,
    LinearImage,
    RenderedImage,
    RenderPlan,
)
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.ray_table import (
    RayTable,
    face_ray_table,
    lens_ray_table,
    omni_ray_table,
)
from catoptra_server.render.trace.trace_engine import (
    LabelRequest,
    PixelLabels,
    TracedFrame,
    TracedRays,
    TraceEngine,
    TraceRequest,
)
from catoptra_server.runtime.memory import count_processors
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import Light, World

log = logging.getLogger(__name__)
EngineName = Literal["kernel", "reference"]
EngineRequest = Literal["auto", "kernel", "reference"]
# A prime: the sampled tiles are in all columns of an image.
_TILES_PER_SAMPLE, _MIN_SAMPLED_TILES = 17, 64


class TraceRenderer:
    """A scene in an engine."""

    def __init__(
        self,
        scene: SceneMesh,
        world: World,
        *,
        threads: int = 0,
        scene_lights: tuple[Light, ...] | None = None,
        engine: EngineRequest = "auto",
    ) -> None:
        """Commit a scene.

        Args:
            scene: Triangles of the static scene.
            world: Lights and background.
            threads: Threads of the engine; 0 for one per processor that this process may use.
            scene_lights: Lights that change the static scene visibly; None for all of the world.
            engine: Engine; "auto" for the kernel where it can run.

        Raises:
            KernelUnavailableError: The kernel was requested and cannot run.
        """
        self.engine_name: EngineName
        """Engine that traces."""
        self.engine_name, self._engine = create_engine(
            engine,
            scene,
            world,
            threads=threads or count_processors(),
            scene_lights=world.lights if scene_lights is None else scene_lights,
        )
        self._triangles = len(scene)
        self._lights = world.lights
        self.has_sky = world.sky is not None
        """Whether rays that meet nothing show a sky."""

    def describe(self) -> str:
        """One-line description for logs: engine, threads and scene size."""
        return f"trace: {self._engine.description}, {self._triangles} triangles"

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> TraceView:
        """Prepare a view of an omnidirectional camera."""
        return self._make_view(camera, omni_ray_table(camera, plan))

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> TraceView:
        """Prepare a view of a perspective camera; samples: along a side of each pixel."""
        return self._make_view(camera, lens_ray_table(camera, samples))

    def prepare_face(self, camera: FaceCamera, samples: int) -> TraceView:
        """Prepare a view of one virtual camera of the cube; samples: along a side of each pixel."""
        return self._make_view(camera.perspective_camera, face_ray_table(camera, samples))

    def prepare_rays(self, table: RayTable) -> TracedRays:
        """Prepare rays whose hits are wanted, instead of an image."""
        return self._engine.prepare(table)

    def _make_view(self, camera: RadialCamera, table: RayTable) -> TraceView:
        """View of a camera's rays."""
        return TraceView(camera, table, self._engine, lambda: self._lights)

    def repaint(self, scene: SceneMesh, world: World) -> None:
        """Show the same triangles in other looks and light; views stay prepared."""
        self._engine.repaint(scene, world)
        self._lights = world.lights

    def close(self) -> None:
        """Free the engine."""
        self._engine.close()


def create_engine(
    request: EngineRequest,
    scene: SceneMesh,
    world: World,
    *,
    threads: int,
    scene_lights: tuple[Light, ...],
) -> tuple[EngineName, TraceEngine]:
    """Create an engine, with its name.

    Args:
        request: Engine; "auto" takes the kernel and falls back on the reference, with a warning.
        scene: Triangles of the static scene.
        world: Lights of dynamic objects, and background.
        threads: Threads, at least one.
        scene_lights: Lights of the static scene.

    Raises:
        KernelUnavailableError: The kernel was requested and cannot run.
    """
    if request not in ("auto", "kernel", "reference"):
        raise DomainError(f"an engine is auto, kernel or reference, not {request!r}")
    if request != "reference":
        # Loaded where the engine is needed: see `commands/server.py`.
        from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine

        try:
            return "kernel", KernelEngine(
                scene,
                world,
                threads=threads,
                scene_lights=scene_lights,
            )
        except KernelUnavailableError as error:
            if request == "kernel":
                raise
            # The message names the missing part and the remedy.
            log.warning("%s; tracing with the NumPy reference, many times slower", error)
    # Loaded late, as the kernel.
    from catoptra_server.render.trace.reference.reference_engine import ReferenceEngine

    return "reference", ReferenceEngine(scene, world, threads=threads, scene_lights=scene_lights)


class TraceView:
    """The rays of one camera."""

    def __init__(
        self,
        camera: RadialCamera,
        table: RayTable,
        engine: TraceEngine,
        find_lights: Callable[[], tuple[Light, ...]],
    ) -> None:
        """Prepare the rays.

        Args:
            camera: Camera model, for the effects.
            table: Rays of the image.
            engine: Engine of the rays, whose image changer applies image effects.
            find_lights: Lights of the world, which may be in view.
        """
        self._camera = camera
        self._table = table
        self._rays = engine.prepare(table)
        self._sampled_rays: TracedRays | None = None
        """Rays of some tiles: made at the first automatic exposure."""
        self._engine = engine
        self._find_lights = find_lights

    @property
    def memory_bytes(self) -> int:
        """Size of all arrays."""
        sampled = self._sampled_rays
        return self._rays.memory_bytes + (sampled.memory_bytes if sampled else 0)

    def render(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...] = (),
        thresholds: Mapping[str, Threshold] = NO_THRESHOLDS,
    ) -> RenderedImage:
        """Render one exposure of the camera, changed by effects; each effect is a stage."""
        return self.render_with_labels(camera_state, effects, thresholds, None)[0]

    def render_with_labels(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
        labels: LabelRequest | None,
    ) -> tuple[RenderedImage, PixelLabels | None]:
        """Render one exposure, and find labels along its rays where the engine can."""
        # The engine encodes a frame without image effects itself, without any float image: the
        # usual case, and the fastest.
        is_linear = bool(effects)
        thresholds = narrow_thresholds(
            thresholds, effects, self._camera, partial(self._sample_light, camera_state)
        )
        frame, stage_ms = self._trace(
            camera_state, effects, thresholds, labels, is_linear=is_linear
        )
        if not effects:
            return RenderedImage(frame.image, stage_ms, frame.changes), frame.labels
        exposed = self._expose_image(camera_state, frame, effects)
        encoded = self._engine.image_changer.encode(exposed, effects, thresholds)
        changes = {**frame.changes, **encoded.changes}
        return RenderedImage(encoded.image, stage_ms | encoded.stage_ms, changes), frame.labels

    def render_linear(
        self, camera_state: CameraState, effects: tuple[ImageEffect, ...] = ()
    ) -> LinearImage:
        """Render one exposure in linear light, after all effects and before the encoding."""
        frame, _ = self._trace(camera_state, effects, NO_THRESHOLDS, None, is_linear=True)
        exposed = self._expose_image(camera_state, frame, effects)
        return self._engine.image_changer.change(exposed, effects, NO_THRESHOLDS).image

    def _sample_light(self, camera_state: CameraState) -> tuple[LinearImage, float]:
        """Light of some tiles of the sharp frame, and the number of all over that of these."""
        num_tiles = len(self._table.tiles)
        step = min(_TILES_PER_SAMPLE, max(1, num_tiles // _MIN_SAMPLED_TILES))
        if self._sampled_rays is None:
            self._sampled_rays = self._engine.prepare(self._table.sample_tiles(step))
        light = self._sampled_rays.render_linear(replace(camera_state, shutter=None))
        # An image that shows nothing of the mirror has no tiles.
        return light, num_tiles / max(1, len(range(0, num_tiles, step)))

    def _expose_image(
        self, camera_state: CameraState, frame: TracedFrame, effects: tuple[ImageEffect, ...]
    ) -> ExposedImage:
        """Linear image at the sensor."""
        sources: tuple[LightSource, ...] = ()
        if frame.range_m is not None and any(one.name == "VeilingGlare" for one in effects):
            # Loaded for the effect that reads sources: most cameras have none.
            from catoptra_server.effects.kernels.light_sources import find_light_sources

            sources = find_light_sources(
                self._find_lights(), self._camera, camera_state, frame.range_m
            )
        context = CaptureContext(camera_state.noise_seed, frame.range_m, sources)
        return ExposedImage(frame.image, self._camera, context)

    def _trace(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
        labels: LabelRequest | None,
        *,
        is_linear: bool,
    ) -> tuple[TracedFrame, dict[str, float]]:
        """A frame with all that the effects need, and milliseconds: the engine's own stages apart
        from the rest."""
        has_ranges = any(effect.needs_range for effect in effects)
        request = TraceRequest(is_linear, has_ranges, thresholds, labels)
        begin_s = time.perf_counter()
        frame = self._rays.render(camera_state, request)
        rest_ms = 1e3 * (time.perf_counter() - begin_s) - sum(frame.stage_ms.values())
        return frame, {"trace": rest_ms, **frame.stage_ms}

    def close(self) -> None:
        """Free the rays."""
        self._rays.close()
        if self._sampled_rays is not None:
            self._sampled_rays.close()
