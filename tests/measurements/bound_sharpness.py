"""Largest displacement of outlines in traced frames, beside the bound that the frames state.

Run: .venv/bin/python tests/measurements/bound_sharpness.py [WIDTH_PX=640]

Between two neighbouring pixels that show different surfaces an outline passes. It is found by
bisection twice: with the kernel's rays, from the ray table of a picture on, and with rays of
float64 among the triangles that the kernel meets nearby. Their distance across the outline is a
displacement; its largest value is "seen". Worlds are the shipped ones at their start poses and a
few places around, and made ones with something near in a wide plane. "stated" is `max_px` of the
frame, without the spacing of the samples. Each row adds the parts of the bound. A displacement of
more than a pixel is not found.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.plan.error_bound import (
    ErrorBound,
    add_scene,
    angle_error,
    coordinate_errors,
    error_bound,
)
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.trace_engine import TraceEngine
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import Box, Item, Material, Rectangle, World
from helpers.trace_engines import make_row_table, open_engine
from helpers.worlds import make_omni_camera

WORLDS = Path(__file__).parents[2] / "configs/worlds"
SHIPPED = ("four_legged_2006", "corridor", "rescue", "warehouse", "incidence_rings")
HEIGHT_M = 0.6
# Around each start pose, metres.
PLACES = ((0.01317, -0.00773), (0.71239, 0.20191), (-0.33171, 0.51713))
MAX_PAIRS, STEPS = 1000, 26
GREY = Material((0.5, 0.5, 0.5))


def make_plain(extent_m: float, near_m: float) -> World:
    """A ground of one rectangle near its edge, and boxes around the viewpoint at a distance."""
    ground = Pose.from_rpy((0.5 * extent_m - 1.0, 0.3 * extent_m, 0.0))
    items = [Item("ground", Rectangle((extent_m, extent_m)), ground, GREY)]
    for index, turn in enumerate(np.arange(0.0, 6.0, 0.7)):
        place = (0.02 + near_m) * np.array((np.cos(turn), np.sin(turn), 0.3 * np.sin(9 * turn)))
        pose = Pose.from_rpy(place - (0.0, 0.0, HEIGHT_M), (turn, 0.3, 2 * turn))
        items.append(Item(f"box {index}", Box((0.02, 0.02, 0.02)), pose, GREY))
    return World("plain", tuple(items))


def make_states(world: World) -> Iterator[CameraState]:
    for start in world.starts[:1] or [None]:
        x, y, _ = start.location_m if start else (0.0, 0.0, 0.0)
        for index, (dx, dy) in enumerate(PLACES):
            place = (x + dx, y + dy, -HEIGHT_M - 0.013 * index)
            yield CameraState(Pose.from_rpy(place, (0.01, -0.02, 0.7 * index)))


class Outlines:
    """Pairs of neighbouring pixels between which an outline passes."""

    def __init__(
        self, engine: TraceEngine, scene: SceneMesh, camera: OmniCamera, state: CameraState
    ) -> None:
        self._engine, self._camera, self._state = engine, camera, state
        normals = np.round(scene.normals * np.sign(scene.normals[:, :1] + 1e-9), 3) + 0.0
        keys = np.column_stack((scene.item_index, normals))
        self._surface = np.append(np.unique(keys, axis=0, return_inverse=True)[1].ravel(), -1)
        # Relative to the eye, in its frame: float64 loses nothing there.
        pose = state.world_from_mirror
        self._corners = (scene.corners - pose.translation) @ pose.rotation
        pixels = pixel_sample_positions(camera)[:, :, 0]
        shown, is_seen = self._meet(pixels.reshape(-1, 2))
        shown, is_seen = shown.reshape(pixels.shape[:2]), is_seen.reshape(pixels.shape[:2])
        begins, steps, around = [], [], []
        padded = np.pad(shown, 2, mode="edge")
        near = np.lib.stride_tricks.sliding_window_view(padded, (5, 5)).reshape(*shown.shape, 25)
        for step in ((1, 0), (0, 1)):
            du, dv = step
            first, second = (
                shown[: len(shown) - dv or None, : shown.shape[1] - du or None],
                shown[dv:, du:],
            )
            both = (
                is_seen[: len(shown) - dv or None, : shown.shape[1] - du or None]
                & is_seen[dv:, du:]
            )
            rows, columns = np.nonzero(both & (self._surface[first] != self._surface[second]))
            begins.append(pixels[rows, columns])
            steps.append(np.broadcast_to(np.array(step, dtype=float), (len(rows), 2)))
            around.append(near[rows, columns])
        self._begin, self._step, self._near = map(np.concatenate, (begins, steps, around))
        if len(self._begin) > MAX_PAIRS:
            kept = np.random.default_rng(1).choice(len(self._begin), MAX_PAIRS, replace=False)
            self._begin, self._step, self._near = (
                one[kept] for one in (self._begin, self._step, self._near)
            )

    def _meet(self, pixels: Floats) -> tuple[np.ndarray, Bools]:
        """(n,) triangles that the kernel meets at pixels, -1 for none; and which have a ray."""
        directions, valid = direction_from_pixel(self._camera, pixels)
        table = make_row_table(np.where(valid[:, None], directions, (0.0, 0.0, 1.0)))
        rays = self._engine.prepare(table)
        hits = rays.find_hits(self._state).triangle[:, 0, :4].reshape(-1)[: len(pixels)]
        rays.close()
        return np.where(hits >= 0, hits, -1), valid

    def _meet_exactly(self, pixels: Floats) -> tuple[np.ndarray, Floats]:
        """(n,) triangles that rays of float64 meet, of those nearby; and (n,) ranges."""
        rays, _ = direction_from_pixel(self._camera, pixels)
        a, b, c = np.moveaxis(self._corners[self._near], 2, 0)
        d = rays[:, None]
        # Scalar triple products of the ray with each edge: of one sign inside.
        sides = [(np.cross(p, q) * d).sum(-1) for p, q in ((b, c), (c, a), (a, b))]
        volume = (np.cross(a, b) * c).sum(-1)
        total = sides[0] + sides[1] + sides[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = volume / total
        signs = np.sign(np.stack(sides)) * np.sign(total)
        is_met = (signs >= 0.0).all(0) & (total != 0.0) & (range_m > 0.0) & (self._near >= 0)
        range_m = np.where(is_met, range_m, np.inf)
        best = range_m.argmin(axis=1)
        found = self._near[np.arange(len(best)), best]
        nearest_m = range_m.min(axis=1)
        return np.where(np.isfinite(nearest_m), found, -1), nearest_m

    def _bisect(self, is_exact: bool, offset_px: float = 0.0) -> tuple[Floats, Bools]:
        """(n,) places between the pixels where the first surface ends, and whether it does."""
        across = self._step[:, ::-1] * offset_px
        find = self._meet_exactly if is_exact else self._meet
        first = self._surface[find(self._begin + across)[0]]
        ends = self._surface[find(self._begin + across + self._step)[0]] != first
        low, high = np.zeros(len(first)), np.ones(len(first))
        for _ in range(STEPS):
            middle = 0.5 * (low + high)
            places = self._begin + across + middle[:, None] * self._step
            same = self._surface[find(places)[0]] == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return high, ends & (first == self._surface[find(self._begin)[0]])

    def displacements_px(self) -> Floats:
        """(n,) displacements across the outlines."""
        if not len(self._begin):
            return np.zeros(1)
        seen, is_seen = self._bisect(is_exact=False)
        # What is thinner than a pixel may lie between the pixels around.
        places = [np.full(len(seen), place) for place in np.linspace(0.0, 1.0, 33)]
        places += [seen + offset for offset in (-1e-3, -1e-5, 1e-5, 1e-3)]
        between = [self._meet(self._at(place))[0] for place in places]
        self._near = np.column_stack((self._near, *between))
        for _ in range(2):
            exact, is_exact = self._bisect(is_exact=True)
            # What only the kernel meets between both outlines, float64 must have looked at.
            places = [seen + part * (exact - seen) for part in (0.1, 0.3, 0.5, 0.7, 0.9)]
            between = [self._meet(self._at(place))[0] for place in places]
            self._near = np.column_stack((self._near, *between))
        left, right = (self._bisect(is_exact=True, offset_px=offset)[0] for offset in (1e-3, -1e-3))
        slope = (left - right) / 2e-3
        # Straight outlines of one thing before another: not where things touch or lie in a plane.
        is_straight = np.abs(left + right - 2.0 * exact) < 1e-5
        ranges = [self._meet_exactly(self._at(exact + offset))[1] for offset in (1e-5, -1e-5)]
        is_step = np.minimum(*ranges) < 0.98 * np.maximum(*ranges)
        usable = is_seen & is_exact & is_straight & is_step & (np.abs(slope) < 5.0)
        return (np.abs(seen - exact) / np.hypot(1.0, slope))[usable]

    def _at(self, place: Floats) -> Floats:
        return self._begin + place[:, None] * self._step


def bound_frame(
    camera: OmniCamera, scene: SceneMesh, world: World, state: CameraState
) -> ErrorBound:
    plan = plan_from_settings(RenderSettings(), camera, kind=RendererKind.TRACE, reason="")
    errors = coordinate_errors(plan.renderer, is_large=scene.is_large)
    angle_rad = SceneSummarizer(scene, world).max_rounding_angle_rad(state, errors)
    return add_scene(error_bound(camera, plan), angle_error(camera, angle_rad))


def main() -> None:
    width_px = int(sys.argv[1]) if len(sys.argv) > 1 else 640
    camera = make_omni_camera(width_px=width_px)
    worlds = {name: read_world(WORLDS / f"{name}.ini")[0] for name in SHIPPED}
    for extent_m in (10.0, 100.0, 2e3, 2e4, 2e5):
        worlds[f"plain {extent_m:g} m"] = make_plain(extent_m, 0.03)
    print(f"{'world':18} {'median px':>9} {'seen px':>9} {'stated px':>9} {'ratio':>6}  parts")
    for name, world in worlds.items():
        scene = build_scene(world)
        seen_px, medians_px, bounds = [], [], []
        with open_engine("kernel", world, scene=scene) as engine:
            for state in make_states(world):
                found_px = Outlines(engine, scene, camera, state).displacements_px()
                seen_px.append(float(found_px.max(initial=0.0)))
                medians_px.append(float(np.median(found_px)))
                bounds.append(bound_frame(camera, scene, world, state))
                if seen_px[-1] > bounds[-1].geometric.max_px:
                    print(f"{name}: EXCEEDED at {state.world_from_mirror.translation}")
        widest = max(bounds, key=lambda bound: bound.geometric.max_px)
        stated_px = widest.geometric.max_px
        parts = ", ".join(f"{one.name} {one.max_px:.2g}" for one in widest.components)
        numbers = f"{max(medians_px):9.2g} {max(seen_px):9.2g} {stated_px:9.2g}"
        print(f"{name:18} {numbers} {stated_px / max(seen_px):6.1f}  {parts}", flush=True)


if __name__ == "__main__":
    main()
