"""The decision experiment: every effect's decision against the truth, in many situations.

Bundled worlds, places drawn by seed, motions of the shipped robot, the shipped real camera with its
thresholds, in the light, in the air and with the sensors of CONDITIONS. Places are cells of a grid
that the robot's base can reach from a start of the world without a contact, at any heading: half of
them close to an obstacle, half in the open.

The server's own view cache decides. The truth is measured with other rays and references
(`effect_truth`), which know only the names of the effects that are drawn, since each decision is
about the light that reaches the effect. Two processes share the places; the result depends on the
seed alone.
"""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_server.commands.explain import ZERO_VELOCITY, PlanarVelocity, build_camera_state
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.effects import (
    DecisionBasis,
    EffectMode,
    EffectSetting,
    EffectSettings,
    widest_gains,
)
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.ray_table import Float32s, omni_ray_table
from catoptra_server.render.trace.trace_engine import assemble_grid
from catoptra_server.render.trace.trace_renderer import create_engine
from catoptra_server.simulation.floor_plan import draw_floor_plan, measure_robot
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription
from catoptra_server.world.objects import CameraState, NoiseSeed
from catoptra_studies.effects.effect_truth import EffectTruth

# All bundled worlds, so that none is chosen for the result.
WORLDS = (
    "airfield",
    "arena",
    "corridor",
    "corridors_and_rooms",
    "four_legged_2006",
    "incidence_rings",
    "laboratory",
    "legacy",
    "meadow",
    "offices",
    "rescue",
    "rescue_site",
    "warehouse",
    "warehouse_stocked",
    "yard",
)
# Speeds of a P2AT: a metre a second is beyond the wheels.
MOTIONS: Mapping[str, PlanarVelocity] = {
    "at rest": ZERO_VELOCITY,
    "slow": PlanarVelocity(0.05, 0.0, 0.02),
    "driving": PlanarVelocity(0.6, 0.0, 0.1),
    "turning": PlanarVelocity(0.2, 0.0, 1.2),
}
_BY_DAY_S = 1.0 / 60.0
# Light, air and sensor of a place: parameters by effect over those of the robot's file. Effects
# named here are in mode auto; those that the file has in mode never stay so elsewhere. Light
# changes by the time that fills a white pixel's well.
CONDITIONS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "day": {},
    "noon": {"Exposure": {"white_exposure_s": _BY_DAY_S / 4.0}, "Response": {}},
    "night": {"Exposure": {"white_exposure_s": _BY_DAY_S * 25.0}},
    "night, automatic": {
        "Exposure": {"white_exposure_s": _BY_DAY_S * 25.0},
        "AutoExposure": {},
    },
    # A CMOS sensor behind a glass tube, white balance as of a lamp.
    "webcam": {
        "RollingShutter": {"readout_s": 1.0 / 30.0},
        "MirrorHolder": {},
        "VeilingGlare": {},
        "AutoExposure": {},
        "WhiteBalance": {"red_gain": 1.05, "blue_gain": 1.2},
    },
    "haze": {"Fog": {"density_per_m": 0.02}},
}

# Fine enough for the corridor's doors, which leave 9 cm on either side of a turning base.
_CELL_M = 0.1
_CLEARANCE_M = 0.02
# Free ground around the base at a place in the open.
_OPEN_CLEARANCE_M = 0.4
_PLAN_PX_PER_M = 25.0


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a world."""

    world: str
    """Name of the bundled file."""
    number: int
    """Index among the places of the world; seed of the noise."""
    pose: PlanarPose
    is_near: bool
    """Whether an obstacle is close to the robot."""


def choose_places(
    world: str, startup: StartupConfig, num_places: int, *, seed: int
) -> tuple[Place, ...]:
    """Places of a world, near obstacles and in the open by turns.

    Args:
        world: Name of the bundled file.
        startup: Content of the file, with the robot.
        num_places: Number of places.
        seed: Seed of cells and headings.
    """
    near, in_the_open = _find_cells(startup)
    generator = np.random.default_rng((seed, *world.encode()))
    places = []
    for number in range(num_places):
        # A world without obstacles, or one that is narrow everywhere, has cells of one kind alone.
        is_near = bool(len(near)) and (number % 2 == 0 or not len(in_the_open))
        cells = near if is_near else in_the_open
        x_m, y_m = (
            cells[generator.integers(len(cells))] + generator.uniform(-1.0, 1.0, 2) * _CLEARANCE_M
        )
        yaw_rad = float(generator.uniform(-math.pi, math.pi))
        places.append(Place(world, number, PlanarPose(float(x_m), float(y_m), yaw_rad), is_near))
    return tuple(places)


def _find_cells(startup: StartupConfig) -> tuple[Floats, Floats]:
    """(n, 2) centres of reachable cells near obstacles, and (m, 2) of those in the open."""
    outlines = startup.scene.corners[..., :2]
    low, high = outlines.min(axis=(0, 1)), outlines.max(axis=(0, 1))
    columns, rows = (np.arange(a, b, _CELL_M) for a, b in zip(low, high, strict=True))
    centres = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1)
    flat = centres.reshape(-1, 2)
    is_free = _are_free(startup, flat, _CLEARANCE_M).reshape(centres.shape[:2])
    # The origin is the start of a world without starts.
    starts = [start.location_m[:2] for start in startup.world.starts] or [(0.0, 0.0)]
    reachable = centres[_flood(is_free, np.rint((np.array(starts) - low) / _CELL_M).astype(int))]
    is_open = _are_free(startup, reachable, _OPEN_CLEARANCE_M)
    return reachable[~is_open], reachable[is_open]


def _are_free(startup: StartupConfig, places: Floats, clearance_m: float) -> Bools:
    """(n,) whether the base of the robot has free ground around it at (n, 2) places."""
    robot: RobotDescription = startup.robots[0]
    height_m, radius_m = measure_robot(robot)
    low, high = places.min(axis=0), places.max(axis=0)
    size_px = math.ceil(_PLAN_PX_PER_M * float((high - low).max()) + 1.0)
    plan = draw_floor_plan(startup.scene, height_m=height_m, points_m=places, size_px=size_px)
    plan.has_floor[:] = True
    # A square about the circle that the base turns in: free at any heading.
    columns, rows = plan.pixels(places).astype(np.intp).T
    free: Bools = plan.find_free(radius_m + clearance_m)[rows, columns]
    return free


def _flood(is_free: Bools, starts: npt.NDArray[np.intp]) -> Bools:
    """(n, m) free cells that are connected by their sides with a free one of (k, 2) starts."""
    reached = np.zeros_like(is_free)
    reached[*starts.T] = is_free[*starts.T]
    while True:
        grown = reached.copy()
        grown[1:] |= reached[:-1]
        grown[:-1] |= reached[1:]
        grown[:, 1:] |= reached[:, :-1]
        grown[:, :-1] |= reached[:, 1:]
        grown &= is_free
        if np.array_equal(grown, reached):
            return reached
        reached = grown


_ROBOT = "p2at_omni_real"
# Of the camera; the place is the tick.
_CAMERA_KEY = (1, 2)
_NOTHING_M = np.float32(np.inf)


@dataclass(frozen=True, slots=True)
class TrialDecision:
    """Decision about one effect in one situation, and the truth."""

    world: str
    place: int
    condition: str
    motion: str
    effect: str
    enabled: bool
    is_measured: bool
    """Whether the frame decided; else the bound did, before the frame."""
    bound: float
    """Grey levels."""
    change: float | None
    """Change that the renderer measured, grey levels."""
    visible_share: float
    """Share of pixels that change visibly, by the decision."""
    threshold: float
    share_threshold: float
    truth: float
    """Largest true change of any pixel, grey levels."""
    true_share: float
    """True share of pixels that change visibly."""

    def exceeds(self, fraction: float, *, levels: float = 0.0, share: float = 0.0) -> bool:
        """Whether the truth is above either threshold times a fraction, by a tolerance.

        All pixels are no threshold: the largest change alone decides.
        """
        allowed = self.share_threshold * (1.0 if self.share_threshold == 1.0 else fraction)
        is_larger = self.truth > fraction * self.threshold + levels
        return is_larger or self.true_share > allowed + share


class _TrialWorld:
    """A world with the shipped real camera: decisions by the server, truth by the study."""

    def __init__(self, name: str, study: DecisionStudy) -> None:
        """Read a bundled world."""
        width_px = study.width_px
        self._name = name
        self.startup = read_startup_config(
            [find_configuration("robots", _ROBOT)], find_configuration("worlds", name)
        )
        robot = self.startup.robots[0]
        assert robot.omni_camera is not None, f"{_ROBOT} has a mirror camera"
        omni = robot.omni_camera
        if width_px is not None:
            # The same mirror in a square image.
            camera = camera_with_inscribed_rim(
                omni.camera.mirror,
                width_px=width_px,
                height_px=width_px,
                rim_rad=omni.camera.rim_rad,
            )
            omni = replace(omni, camera=camera)
        self._robot, self._omni = robot, omni
        self._settings = [_adapt(omni.effects, changes) for changes in CONDITIONS.values()]
        scene, world = self.startup.scene, self.startup.world
        # One thread: the pool's processes share the processors.
        gains = widest_gains(self._settings)
        choice = choose_renderer("trace", scene, world, threads=1, gains=gains)
        self._views = ViewCache(RenderPlanner(RendererPool(choice)), SceneSummarizer(scene, world))
        spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
        self._truth = _make_truth(self.startup, spec)

    def run(self, place: Place) -> Iterator[TrialDecision]:
        """Yield the decisions at a place, in all motions."""
        # Each condition meets places near obstacles and in the open.
        number = (place.number + place.number // len(CONDITIONS)) % len(CONDITIONS)
        condition, settings = tuple(CONDITIONS)[number], self._settings[number]
        spec = OmniCameraSpec(self._omni.camera, self._omni.render_settings, settings)
        effects = tuple(one.effect for one in settings.settings if one.mode is not EffectMode.NEVER)
        for motion, velocity in MOTIONS.items():
            state = build_camera_state(self._robot, self._omni, place.pose, velocity)
            state = replace(state, noise_seed=NoiseSeed(_CAMERA_KEY, place.number))
            decisions = self._views.render(ViewRequest(spec, state)).effect_decisions
            drawn = frozenset(one.effect for one in decisions if one.enabled or _follows_frame(one))
            truths = self._truth.measure(state, effects, drawn)
            for one in decisions:
                if one.effect in truths:
                    yield TrialDecision(
                        self._name,
                        place.number,
                        condition,
                        motion,
                        one.effect,
                        one.enabled,
                        _follows_frame(one),
                        one.bound,
                        one.change,
                        one.visible_share,
                        one.threshold,
                        one.share_threshold,
                        truths[one.effect].largest,
                        truths[one.effect].visible_share,
                    )

    def close(self) -> None:
        """Free the renderers."""
        self._views.close()


def _adapt(settings: EffectSettings, changes: Mapping[str, Mapping[str, float]]) -> EffectSettings:
    """Settings with parameters of a condition."""
    adapted = tuple(
        EffectSetting(replace(one.effect, **changes[one.effect.name]), EffectMode.AUTO)  # type: ignore[type-var]
        if one.effect.name in changes
        else one
        for one in settings.settings
    )
    return replace(settings, settings=adapted)


def _follows_frame(decision: EffectDecision) -> bool:
    return decision.basis is DecisionBasis.MEASURED


def _make_truth(startup: StartupConfig, spec: OmniCameraSpec) -> EffectTruth:
    """Truth by separate rays, under all lights of the world, without culling."""
    plan = plan_from_settings(
        spec.render_settings, spec.camera, kind=RendererKind.TRACE, reason="truth"
    )
    _, engine = create_engine(
        "auto",
        startup.scene,
        startup.world,
        threads=1,
        scene_lights=startup.world.lights,
    )
    table = omni_ray_table(spec.camera, plan)
    rays = engine.prepare(table)

    def measure_ranges(state: CameraState) -> Float32s:
        """Inverse of the mean inverse range of each pixel's samples: the discs grow with it."""
        ranges = assemble_grid(table, rays.find_hits(state).range_m[..., None], fill=_NOTHING_M)
        rows, columns, samples = spec.camera.height_px, spec.camera.width_px, plan.samples
        inverse = 1.0 / ranges.astype(np.float64).reshape(rows, samples, columns, samples)
        with np.errstate(divide="ignore"):  # a pixel that shows nothing is infinitely far away
            return np.asarray(1.0 / inverse.mean(axis=(1, 3)), dtype=np.float32)

    lights = startup.world.lights
    return EffectTruth(spec.camera, rays.render_linear, measure_ranges, lights)


_NUM_PROCESSES = 2


@dataclass(frozen=True, slots=True)
class DecisionStudy:
    """Size of the experiment."""

    num_places: int
    """Places of each world; each in four motions."""
    worlds: tuple[str, ...] = WORLDS
    seed: int = 0
    width_px: int | None = None
    """Side of a square image; None for the camera's own size."""
    num_processes: int = field(default=_NUM_PROCESSES, compare=False)


def run_decision_study(
    study: DecisionStudy, *, on_place: Callable[[], None] = lambda: None
) -> tuple[TrialDecision, ...]:
    """Decisions and truths of all situations, by world, place, motion and optical order.

    Args:
        on_place: Called after each place.
    """
    tasks = [(study, world, number) for world in study.worlds for number in range(study.num_places)]
    if study.num_processes == 1:
        return _collect(map(_run_place, tasks), on_place)
    # Spawned: a forked process would share the locks of a library's threads.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(study.num_processes, mp_context=context) as pool:
        try:
            return _collect(pool.map(_run_place, tasks), on_place)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _run_place(task: tuple[DecisionStudy, str, int]) -> Sequence[TrialDecision]:
    """Decisions at one place of a world, in all motions."""
    study, world, number = task
    trial_world = _keep_world(study, world)
    places = choose_places(world, trial_world.startup, study.num_places, seed=study.seed)
    return tuple(trial_world.run(places[number]))


def _collect(
    results: Iterable[Sequence[TrialDecision]], on_place: Callable[[], None]
) -> tuple[TrialDecision, ...]:
    decisions: list[TrialDecision] = []
    for result in results:
        decisions += result
        on_place()
    return tuple(decisions)


# The world that this process used last: tasks come world by world.
_kept: dict[tuple[str, DecisionStudy], _TrialWorld] = {}


def _keep_world(study: DecisionStudy, world: str) -> _TrialWorld:
    key = (world, study)
    if key not in _kept:
        for other in _kept.values():
            other.close()
        _kept.clear()
        _kept[key] = _TrialWorld(world, study)
    return _kept[key]
