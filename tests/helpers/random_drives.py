"""Random drives over worlds of steps, ramps and edges, judged by rays of their own.

The judge knows the shape of a robot from its file alone: a box above the wheels' step, and four
discs. Segments along the edges and faces of the box, and chords of the discs, all within the shape
by a millimetre, may meet no surface; those of the discs count while the base stands or rolls, since
wheels of what falls over an edge hang beside it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.ray_caster import SceneRayCaster, commit_ray_caster
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.drive import STANDARD_BASES, RobotBody, WheelSpin, step_body
from catoptra_server.simulation.ground import NoStandError, SceneGround
from catoptra_server.simulation.robot_description import DriveBase, PlanarPose
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import Box, Item, Material, Rectangle, World

TICK_S = 0.02
_GRAVITY_M_S2 = 9.81
_INSIDE_M = 1e-3
# What turns over in the air sinks by up to two millimetres more in a tick.
_SPEED_M_S = 0.12
_GREY = Material((0.5, 0.5, 0.5))
BASES = tuple(STANDARD_BASES[name] for name in ("p2at", "p2dx", "p3at"))
NUM_WORLDS = 6


def make_rough_world(number: int) -> World:
    """A floor of 8 m with an edge, blocks from 1 cm to 1 m, ramps of any slope, and walls."""
    rng = np.random.default_rng((40, number))
    items = [_item("floor", Box((8.0, 8.0, 0.2)), (0.0, 0.0, 0.1))]
    if number % 2:
        # The ground lies below the floor, by less or more than a robot's length.
        depth_m = (0.25, 1.0, 0.6)[number // 2]
        items.append(_item("ground", Rectangle((30.0, 30.0)), (0.0, 0.0, depth_m)))
    for index in range(12):
        size = (
            *rng.uniform(0.3, 1.5, 2).tolist(),
            float(rng.choice((0.01, 0.04, 0.06, 0.1, 0.4, 1.0))),
        )
        x, y = rng.uniform(-3.5, 3.5, 2).tolist()
        yaw = float(rng.uniform(-math.pi, math.pi))
        items.append(_item(f"block {index}", Box(size), (x, y, -0.5 * size[2]), (0.0, 0.0, yaw)))
    for index in range(8):
        x, y = rng.uniform(-3.0, 3.0, 2).tolist()
        slope, yaw = float(rng.uniform(0.05, 0.7)), float(rng.uniform(-math.pi, math.pi))
        size = (1.6, 1.2, 0.05)
        height = -0.5 * size[0] * math.sin(slope) + 0.5 * size[2] * math.cos(slope)
        items.append(_item(f"ramp {index}", Box(size), (x, y, height), (0.0, slope, yaw)))
    return World(f"rough {number}", tuple(items))


def _item(
    name: str,
    shape: Box | Rectangle,
    place: tuple[float, float, float],
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Item:
    return Item(name, shape, Pose.from_rpy(place, rpy), _GREY)


class Stage(NamedTuple):
    """A world to drive in."""

    scene: SceneMesh
    caster: SceneRayCaster
    ground: SceneGround

    @classmethod
    def of_world(cls, world: World) -> Stage:
        scene = build_scene(world)
        caster = commit_ray_caster(scene)
        return cls(scene, caster, SceneGround(scene, caster))


class Judge:
    """What a base may not do."""

    def __init__(self, base: DriveBase, height_m: float) -> None:
        self._begins, self._ends, self._num_of_box = _make_segments(base, height_m)

    def find_depth(self, stage: Stage, body: RobotBody) -> str:
        """Where the base is inside of something; empty for nowhere."""
        count = len(self._begins) if body.is_settled else self._num_of_box
        begins, ends = (
            body.world_from_robot.transform_points(one[:count])
            for one in (self._begins, self._ends)
        )
        lengths = np.linalg.norm(ends - begins, axis=1)
        ways = (ends - begins) / lengths[:, None]
        distances, normals = stage.caster.closest_hits(begins, ways)
        hits = np.flatnonzero(distances < lengths)
        # Discs are thin: they are inside of what is beside them by their depth below its surface.
        slopes = (normals[hits] * ways[hits]).sum(axis=1)
        parts = np.where(slopes > 0.0, distances[hits], lengths[hits] - distances[hits])
        hits = hits[(hits < self._num_of_box) | (parts * np.abs(slopes) > _INSIDE_M)]
        if not len(hits):
            return ""
        begin, end = (one[int(hits[0])].round(4) for one in (self._begins, self._ends))
        return f"segment {begin} to {end} of the chassis meets a surface"


def _make_segments(base: DriveBase, height_m: float) -> tuple[Floats, Floats, int]:
    """(n, 3) begins and ends of segments inside of a base, chassis frame; those of the box first,
    and their number.
    """
    length, width, body_height = base.collision_size_m
    low = base.ride_height_m - base.max_step_m - 0.005 - _INSIDE_M
    high = base.ride_height_m - max(height_m, body_height, base.max_step_m + 0.05) + _INSIDE_M
    x, y = 0.5 * length - _INSIDE_M, 0.5 * width - _INSIDE_M
    begins, ends = [], []
    for share in np.linspace(-1.0, 1.0, 9):
        for z in (low, 0.5 * (low + high), high):
            begins += [(-x, share * y, z), (share * x, -y, z)]
            ends += [(x, share * y, z), (share * x, y, z)]
        for corner in (-1.0, 1.0):
            begins += [(corner * x, share * y, low), (share * x, corner * y, low)]
            ends += [(corner * x, share * y, high), (share * x, corner * y, high)]
    num_of_box, radius = len(begins), base.wheel_radius_m
    for wheel_x, wheel_y in base.wheel_places_m:
        for rise in np.linspace(0.004, base.max_step_m, 8):
            # A chord of the disc whose rim is as far inside.
            half = math.sqrt((radius - _INSIDE_M) ** 2 - (radius - rise) ** 2)
            z = base.ride_height_m - rise
            begins.append((wheel_x - half, wheel_y, z))
            ends.append((wheel_x + half, wheel_y, z))
    return np.array(begins), np.array(ends), num_of_box


def drive_at_random(stage: Stage, seed: int, *, ticks: int = 250) -> str:
    """What was wrong with a drive of a seed; empty for nothing."""
    rng = np.random.default_rng((41, seed))
    base = BASES[seed % len(BASES)]
    height_m = float(rng.choice((0.0, 0.8)))
    judge = Judge(base, height_m)
    body = _spawn(stage, base, height_m, rng)
    if body is None:
        return ""
    if place := judge.find_depth(stage, body):
        return f"spawned at {body.pose}: {place}"
    slip = RandomSource.from_names(seed, "slip")
    speed = base.max_speed_rad_s * base.wheel_radius_m
    fall_m_s = 0.0
    for tick in range(ticks):
        if tick % 50 == 0:
            left, right = (base.max_speed_rad_s * rng.uniform(-0.3, 1.0, 2)).tolist()
            body = replace(body, spin=WheelSpin(left, right))
        before = body
        body, _ = step_body(body, TICK_S, move=stage.ground.move, random_source=slip)
        where = f"tick {tick} at {body.pose}, z {body.world_from_robot.translation[2]:.4f}"
        if (
            not np.isfinite(body.world_from_robot.rotation).all()
            or not np.isfinite(body.world_from_robot.translation).all()
        ):
            return f"{where}: no number"
        if place := judge.find_depth(stage, body):
            return f"{where}: {place}"
        sank_m = float((body.world_from_robot.translation - before.world_from_robot.translation)[2])
        now_m_s = sank_m / TICK_S
        if now_m_s > max(fall_m_s, speed) + _GRAVITY_M_S2 * TICK_S + _SPEED_M_S:
            return f"{where}: sinks by {now_m_s:.3f} m/s after {fall_m_s:.3f} m/s"
        fall_m_s = max(now_m_s, 0.0)
    return ""


def _spawn(
    stage: Stage, base: DriveBase, height_m: float, rng: np.random.Generator
) -> RobotBody | None:
    for _ in range(50):
        x_m, y_m, z_m = rng.uniform((-3.8, -3.8, -1.5), (3.8, 3.8, 0.0)).tolist()
        pose = PlanarPose(x_m, y_m, float(rng.uniform(-math.pi, math.pi)))
        try:
            return stage.ground.place(base, pose, z_m, height_m=height_m)
        except NoStandError:
            continue
    return None
