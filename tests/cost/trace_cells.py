"""Rows of the comparison of ray tracers: one scene, size and number of samples each."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import RendererChoice, choose_renderer
from catoptra_server.render.renderer import Image, RenderPlan, RenderSettings, View
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from cost.bare_packets import BarePacketScene
from cost.embree_packets import EmbreePackets
from cost.race import Quartiles, RaceTimes, RenderCall, race
from measurements.scenes import make_camera

HAS_EMBREEX = importlib.util.find_spec("embreex") is not None
if HAS_EMBREEX:
    from cost.embreex_numpy import EmbreexNumpy

STATES = 60  # camera states, a cycle
COMPARED_STATES = 3


@dataclass(frozen=True, slots=True)
class Cell:
    """One scene at one size, and what is required there."""

    scene: str
    size_px: int
    samples: int
    """Samples along a pixel's side."""
    required_factor: float
    """Least time of embreex with NumPy over ours."""
    required_bare_share: float | None = None
    """Least time of our bare rays over ours; None where nothing is required."""
    max_bare_ratio: float | None = None
    """Greatest time of our bare rays over Embree's packets; None where nothing is required."""


@dataclass(frozen=True, slots=True)
class CellRow:
    """Frame times of ours, of embreex with NumPy and of bare rays: ours and Embree's packets."""

    cell: Cell
    rounds: int
    wall_ms: dict[str, float]
    """Median elapsed time by contestant: ours and, where there are such, embreex, bare, packets."""
    processor_ms: dict[str, float]
    """Median processor time of all threads."""
    factor: Quartiles | None
    """Elapsed time of embreex with NumPy over ours; None without embreex, as what follows."""
    processor_factor: Quartiles | None
    """The same of processor times."""
    bare_share: Quartiles | None
    """Elapsed time of our bare rays over ours."""
    bare_ratio: Quartiles | None
    """Elapsed time of our bare rays over Embree's packets."""
    max_difference: int | None
    """Largest difference of the pictures, grey levels."""
    different_share: float | None
    """Share of pixels that differ by more than one grey level."""
    embreex_chunks: str | None
    """The fastest division of embreex's rays."""


@dataclass(frozen=True, slots=True)
class CostRow:
    """Frame times of ours with something and without."""

    what: str
    size_px: int
    samples: int
    """Samples along a pixel's side."""
    max_ratio: float
    rounds: int
    wall_ms: dict[str, float]
    """Median elapsed time `with` and `without`."""
    ratio: Quartiles
    """Elapsed time with over without."""
    processor_ratio: Quartiles
    """The same of processor times."""


@dataclass(frozen=True, slots=True, eq=False)
class Racers:
    """The product's renderer, its bare rays and the yardsticks, each with the scene."""

    choice: RendererChoice
    bare: BarePacketScene
    embreex: EmbreexNumpy | None
    packets: EmbreePackets | None

    @classmethod
    def open(cls, world: World) -> Racers:
        """Build the scene for all."""
        scene = build_scene(world)
        choice = choose_renderer("trace", scene, world)
        bare = BarePacketScene(scene, world)
        if not HAS_EMBREEX:
            return cls(choice, bare, None, None)
        return cls(choice, bare, EmbreexNumpy(scene, world), EmbreePackets(scene))

    def plan(self, camera: OmniCamera, samples: int) -> RenderPlan:
        """Plan with a number of samples along a pixel's side, defaults for the rest."""
        settings = RenderSettings(samples=samples)
        return plan_from_settings(settings, camera, kind=self.choice.kind, reason="race")

    def prepare(self, size_px: int, samples: int) -> View:
        """View of the product."""
        camera = make_camera(size_px)
        return self.choice.renderer.prepare(camera, self.plan(camera, samples))

    def close(self) -> None:
        """End all threads."""
        self.choice.renderer.close()
        if self.embreex is not None:
            self.embreex.close()
        self.bare.close()


def make_states(
    *,
    has_shadows: bool = False,
    make_objects: Callable[[float], tuple[DynamicObject, ...]] = lambda turn_rad: (),
) -> list[CameraState]:
    """States along a path around the centre of a world, 0.6 m above the floor.

    Args:
        has_shadows: whether surfaces occlude lights.
        make_objects: dynamic objects in view, turned by an angle.
    """
    states = []
    for t in np.linspace(0.0, 2.0 * math.pi, STATES, endpoint=False).tolist():
        location_m = (0.5 * math.sin(t), 0.3 * math.cos(t), -0.6)
        pose = Pose.from_rpy(location_m, (0.0, 0.0, 0.5 * t))
        states.append(CameraState(pose, make_objects(t), has_shadows=has_shadows))
    return states


def measure_cell(racers: Racers, cell: Cell, *, seconds: float) -> CellRow:
    """Race one scene at one size for some seconds, then compare the pictures."""
    states, camera = make_states(), make_camera(cell.size_px)
    ours = racers.prepare(cell.size_px, cell.samples)
    plan = racers.plan(camera, cell.samples)
    bare = racers.bare.prepare(camera, plan)
    calls: dict[str, RenderCall] = {"ours": ours.render}
    other = None
    if racers.embreex is not None:
        other = racers.embreex.prepare(camera, cell.samples, states[0])
        calls["embreex"] = other.render
    if bare is not None:
        calls["bare"] = bare.trace
    if racers.packets is not None:
        calls["packets"] = partial(racers.packets.trace, omni_ray_table(camera, plan))
    times = race(calls, states, seconds=seconds)
    differences = None
    if other is not None:
        compared = states[:: STATES // COMPARED_STATES]
        pairs = [(ours.render(state).rgb, other.render(state)) for state in compared]
        differences = compare_pictures(pairs)
    ours.close()
    if bare is not None:
        bare.close()
    return _make_row(cell, times, differences, None if other is None else other.describe())


def _make_row(
    cell: Cell, times: RaceTimes, differences: tuple[int, float] | None, chunks: str | None
) -> CellRow:
    has_embreex, has_bare = "embreex" in times.wall_ms, "bare" in times.wall_ms
    return CellRow(
        cell=cell,
        rounds=times.rounds,
        wall_ms=times.median_wall_ms(),
        processor_ms=times.median_processor_ms(),
        factor=times.ratio("embreex", "ours") if has_embreex else None,
        processor_factor=times.processor_ratio("embreex", "ours") if has_embreex else None,
        bare_share=times.ratio("bare", "ours") if has_bare else None,
        bare_ratio=times.ratio("bare", "packets") if has_bare and has_embreex else None,
        max_difference=None if differences is None else differences[0],
        different_share=None if differences is None else differences[1],
        embreex_chunks=chunks,
    )


def compare_pictures(pairs: Sequence[tuple[Image, Image]]) -> tuple[int, float]:
    """Largest difference in grey levels, and share of pixels that differ by more than one."""
    differences = np.stack([np.abs(a.astype(np.int16) - b).max(axis=-1) for a, b in pairs])
    return int(differences.max()), float((differences > 1).mean())


def measure_cost(
    view: View,
    what: str,
    *,
    changed: list[CameraState],
    max_ratio: float,
    shape: tuple[int, int],
    seconds: float,
) -> CostRow:
    """Race frames of changed states against plain ones on the same path.

    Args:
        view: view of the product.
        what: name of the change.
        changed: states of `make_states` with something that costs time.
        max_ratio: greatest ratio allowed.
        shape: pixels and samples along a side.
        seconds: time for the rounds.
    """
    plain = make_states()
    # The race hands both calls one state: the plain state stands for both.
    changed_by_plain = {id(a): b for a, b in zip(plain, changed, strict=True)}
    calls: dict[str, RenderCall] = {
        "with": lambda state: view.render(changed_by_plain[id(state)]),
        "without": view.render,
    }
    times = race(calls, plain, seconds=seconds)
    return CostRow(
        what=what,
        size_px=shape[0],
        samples=shape[1],
        max_ratio=max_ratio,
        rounds=times.rounds,
        wall_ms=times.median_wall_ms(),
        ratio=times.ratio("with", "without"),
        processor_ratio=times.processor_ratio("with", "without"),
    )
