"""One trial of the decision experiment: a situation's decisions, each beside its truth.

The decisions are those of the server's own view cache. The truth is measured with rays and
references of its own (`effect_truth`), which know nothing of them but the names of the effects that
are drawn, since each decision is about the light that reaches its effect.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.capture.noise_seed import NoiseSeed
from catoptra_server.config.bundled_files import find_configuration
from catoptra_server.effects.effect import DecisionBasis, Effect, EffectMode
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.explain import build_camera_state
from catoptra_server.frames.frame_request import ViewRequest
from catoptra_server.frames.view_cache import ViewCache
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.engine_choice import create_engine
from catoptra_server.render.trace.ray_table import Float32s, omni_ray_table
from catoptra_server.render.trace.trace_engine import assemble_grid
from catoptra_server.startup import StartupConfig, read_startup_config
from catoptra_studies.effects.effect_truth import EffectTruth
from catoptra_studies.effects.situations import MOTIONS, Place, choose_places

ROBOT = "p2at_omni_real"
# Of the camera; the place is the tick.
_CAMERA_KEY = (1, 2)
_NOTHING_M = np.float32(np.inf)


@dataclass(frozen=True, slots=True)
class TrialDecision:
    """Decision about one effect in one situation, and the truth."""

    world: str
    place: int
    motion: str
    effect: str
    enabled: bool
    is_measured: bool
    """Whether the frame decided; else the bound did, before the frame."""
    bound: float
    """Grey levels."""
    change: float | None
    """Change that the renderer measured, grey levels."""
    threshold: float
    truth: float
    """Largest true change of any pixel, grey levels."""


class TrialWorld:
    """A world with the shipped real camera: decisions by the server's code, truth by its own."""

    def __init__(self, name: str, *, width_px: int | None = None) -> None:
        """Read a bundled world.

        Args:
            width_px: Side of a square image; None for the shipped camera's own size.
        """
        self._name = name
        self._startup = _read_world(name)
        robot = self._startup.robots[0]
        assert robot.omni_camera is not None, f"{ROBOT} has a mirror camera"
        omni = robot.omni_camera
        if width_px is not None:
            omni = replace(omni, camera=_resize(omni.camera, width_px))
        self._robot, self._omni = robot, omni
        self._spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
        settings = self._omni.effects.settings
        self._effects: tuple[Effect, ...] = tuple(
            one.effect for one in settings if one.mode is not EffectMode.NEVER
        )
        scene, world = self._startup.scene, self._startup.world
        # One thread: the pool's processes share the processors.
        choice = choose_renderer("trace", scene, world, threads=1)
        self._views = ViewCache(RenderPlanner(RendererPool(choice)), SceneSummarizer(scene, world))
        self._truth = _make_truth(self._startup, self._spec)

    def choose_places(self, num_places: int, *, seed: int) -> tuple[Place, ...]:
        """Places of this world."""
        return choose_places(self._name, self._startup, num_places, seed=seed)

    def run(self, place: Place) -> Iterator[TrialDecision]:
        """Yield the decisions at a place, in all motions."""
        for motion, velocity in MOTIONS.items():
            state = build_camera_state(self._robot, self._omni, place.pose, velocity)
            state = replace(state, noise_seed=NoiseSeed(_CAMERA_KEY, place.number))
            decisions = self._views.render(ViewRequest(self._spec, state)).effect_decisions
            drawn = frozenset(one.effect for one in decisions if one.enabled or _follows_frame(one))
            truths = self._truth.measure(state, self._effects, drawn)
            for one in decisions:
                if one.effect in truths:
                    yield TrialDecision(
                        self._name,
                        place.number,
                        motion,
                        one.effect,
                        one.enabled,
                        _follows_frame(one),
                        one.bound,
                        one.change,
                        self._omni.effects.threshold_grey_levels,
                        truths[one.effect],
                    )

    def close(self) -> None:
        """Free the renderers."""
        self._views.close()


def _follows_frame(decision: EffectDecision) -> bool:
    return decision.basis is DecisionBasis.MEASURED


def _read_world(name: str) -> StartupConfig:
    return read_startup_config(
        [find_configuration("robots", ROBOT)], find_configuration("worlds", name)
    )


def _resize(camera: OmniCamera, width_px: int) -> OmniCamera:
    """Same mirror in a square image."""
    return camera_with_inscribed_rim(
        camera.mirror, width_px=width_px, height_px=width_px, rim_rad=camera.rim_rad
    )


def _make_truth(startup: StartupConfig, spec: OmniCameraSpec) -> EffectTruth:
    """Truth by rays of its own, under all lights of the world, none of them culled."""
    plan = plan_from_settings(
        spec.render_settings, spec.camera, kind=RendererKind.TRACE, reason="truth"
    )
    _, engine = create_engine(
        "auto",
        startup.scene,
        startup.world,
        threads=1,
        scene_lights=startup.world.lights,
        instruction_set="auto",
    )
    table = omni_ray_table(spec.camera, plan)
    rays = engine.prepare(table)

    def measure_ranges(state: CameraState) -> Float32s:
        """Inverse of the mean inverse range of each pixel's samples: their discs grow with it."""
        ranges = assemble_grid(table, rays.find_hits(state).range_m[..., None], fill=_NOTHING_M)
        rows, columns, samples = spec.camera.height_px, spec.camera.width_px, plan.samples
        inverse = 1.0 / ranges.astype(np.float64).reshape(rows, samples, columns, samples)
        with np.errstate(divide="ignore"):  # a pixel that shows nothing is infinitely far away
            return np.asarray(1.0 / inverse.mean(axis=(1, 3)), dtype=np.float32)

    return EffectTruth(spec.camera, rays.render_linear, measure_ranges)
