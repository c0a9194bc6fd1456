"""Where a base stands: the pose in which it touches what is below, and where it cannot go.

A base is a rigid body of six sides, mostly on its wheels. Its underside is a set of points: the
rims of the wheels as far as they can climb, the belly between them, and of each other side a grid.
How it rests on what is below, see `resting.py`.

The motion is quasi-static: no inertia, no suspension, no bouncing. No point sinks faster than it
falls: in a tick of length t by v t + g t^2 / 2, where v has grown by g t for each tick in which the
base found no rest. What is tilted by more than `MaxTilt` slides down along its own plane, as
fast; once in the air it turns on, as fast as a rod that fell to that tilt. A centre beyond all
points of a side lets the base tip over to the next side. A base that lies on another side than its
wheels does not drive.

A base is stopped by what its body meets: the box from `MaxStep` above the wheels' plane, or from
that plane while it turns over or lies on another side, up to the top of what it carries, against
the triangles near to it, with the wheels where it is tilted and walls are beside them, which rays
from above miss; and by a slope above `MaxClimbAngle` that it would climb.

On even ground nothing of this is repeated: how far the base can move before a thing rises above its
plane, the plane ends, or a body may be touched, is remembered and used up.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.elementary import arctan2, cos, hypot, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.chassis import GRAVITY_M_S2, SKIN_M, ChassisShape, shape_chassis
from catoptra_server.simulation.drive import NO_TRAVEL, RobotBody, WheelTravel
from catoptra_server.simulation.resting import (
    DOWN,
    LIFT_M,
    MARGIN_M,
    TOUCH_M,
    Sinking,
    Stance,
    Support,
    depth_of_paint,
    make_support,
    measure_gaps,
    robot_pose,
    snap,
)
from catoptra_server.simulation.robot_description import DriveBase, PlanarPose
from catoptra_server.simulation.sensors import EmptyScene, RayCaster
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.scene_mesh import SceneMesh

REST_DEPTH_M = 10.0
"""Depth below the lowest surface of a world at which whatever falls out of it comes to rest."""
# Two robots compute their contact in axes of their own.
_OVERLAP_M = 1e-6
_ROUNDING_M = 1e-9
# Sideways, of what hangs on something while it falls.
_SLIPS_M = (0.005, 0.02, 0.06)
# Metres and radians of a base that does not move.
_STILL = 1e-6
# A box of cells is searched once: a power of two rounds nothing.
_CELL_M, _MAX_BLOCKS = 0.5, 128
# As far below a requested place is its floor.
_SEARCH_DEPTH_M = 2.0
# Not above: the floor of a place may be as much higher.
_NEAR_M = 0.05
# 2^-7 of at most 14 mm is a tenth of a millimetre.
_BISECTION_STEPS = 7
# Cosine to the vertical of a surface to stand on.
_MIN_FLOOR = 0.5
# Height up to which a triangle that faces up is the floor of a world.
_LOW_M = 0.03
# Vertical share of the normal of a wall: its slope is 5 times as high as wide.
_MAX_WALL = 0.2
# Gaps in even ground that are narrower do not count: a wheel sinks by 2 mm into them.
_BRIDGED_M = 0.05
_MAX_HALVINGS = 4


class _Surfaces(NamedTuple):
    """Triangles that may stop a base."""

    triangles: Floats
    """(n, 3, 3)."""
    walls: Floats
    """(m, 3, 3) those so steep that rays from above miss what wheels lean into."""


class NoStandError(CatoptraError):
    """A base cannot stand at a place; the message says why."""


class _Footing(NamedTuple):
    """What is remembered of a base from one tick to the next."""

    stance: Stance
    world_from_robot: Pose
    contacts: tuple[int, int, int] = (0, 0, 0)
    """Points of the side between which the centre lies."""
    fall_m_s: float = 0.0
    """Speed of the fall; 0 on the ground."""
    floor_z_m: float = 0.0
    """Where it comes to rest if there is nothing below."""
    is_settled: bool = False
    """Whether it lies still until a wheel moves."""
    is_held: bool = False
    """Whether its contacts are surfaces, not the limit of a fall."""
    is_aloft: bool = False
    """Whether it has no contact at all."""
    free_m: float = 0.0
    """How far each point of the body can move before it may touch anything of the scene."""
    tumble: tuple[float, float] = (0.0, 0.0)
    """Level unit axis about which it turns in the air; 0 for none."""
    calm_m: float = 0.0
    """How far it can move before anything rises above its plane."""
    even_m: float = 0.0
    """How far it can move over ground of its plane, without anything that rises above."""
    blocked: _Blocked | None = None
    """What was not possible from here, not in the smallest part."""

    @property
    def is_lying(self) -> bool:
        """Whether it lies on another side than its wheels, or turns over."""
        return self.stance.side != 0 or self.tumble != (0.0, 0.0)


class SceneGround:
    """What bases stand on and meet in a scene, among each other's boxes."""

    def __init__(self, scene: SceneMesh, caster: RayCaster) -> None:
        """Create the ground of a scene.

        Args:
            scene: The scene as triangles, which stop bodies.
            caster: The same scene for rays, which find what wheels touch.
        """
        self._scene, self._caster = scene, caster
        self._depth_m = REST_DEPTH_M + (max(float(scene.box_max[2]), 0.0) if len(scene) else 0.0)

        @lru_cache(maxsize=_MAX_BLOCKS)
        def find_near(cells: tuple[int, ...]) -> _Surfaces:
            low, high = _CELL_M * np.array(cells[:3]), _CELL_M * np.array(cells[3:])
            corners: Floats = scene.corners[scene.hierarchy().find_near(low, high)]
            lows, highs = corners.min(axis=1), corners.max(axis=1)
            near: Floats = corners[((lows <= high) & (highs >= low)).all(axis=1)]
            return _Surfaces(near, near[_are_walls(near)])

        self._find_near = find_near

    @cached_property
    def _support(self) -> Support:
        """Made at the first use: a ray caster may be built then."""
        return make_support(self._caster)

    def place(
        self,
        base: DriveBase,
        pose: PlanarPose,
        z_m: float,
        *,
        height_m: float = 0.0,
        others: Sequence[OrientedBox] = (),
        clearance_m: float = 0.0,
    ) -> RobotBody:
        """Base at rest on the surface at a place.

        The surface is the first one at or below z_m within 2 m, else the nearest above, else the
        next below; in a scene without any floor the plane z = 0.

        Args:
            base: The base.
            pose: Place and heading.
            z_m: Height to begin with, downwards.
            height_m: Height up to which the robot meets things.
            others: Other robots in reach.
            clearance_m: Distance to be kept from all things beside it.

        Raises:
            NoStandError: It has no room there, or would not stand.
        """
        chassis = shape_chassis(base, height_m)
        stance, floor_z_m = self._find_floor(pose, z_m), self._depth_m
        if stance is None:
            if self._has_floor():
                raise NoStandError("there is no floor")
            stance, floor_z_m = Stance(pose.x_m, pose.y_m, pose.yaw_rad), 0.0
        footing = _Footing(stance, stance.world_from_side, floor_z_m=floor_z_m)
        robots = _Robots.around(others, stance.z_m, base.max_step_m)
        settled = self._settle(chassis, footing, stance, math.inf, robots)
        if (
            settled.stance.side
            or settled.stance.steepness > chassis.steepest
            or not settled.is_held
            or settled.stance.z_m > stance.z_m + _SEARCH_DEPTH_M
        ):
            raise NoStandError("the robot would fall")
        where = settled.world_from_robot
        wide = chassis.widen(clearance_m)
        for surfaces in (self._near(wide, where, 0.0), robots.surfaces):
            if self._separations(wide, where, surfaces, where).min(initial=1.0) >= -_OVERLAP_M:
                continue
            raise NoStandError("the robot touches an obstacle")
        if self._is_in_solid(where):
            raise NoStandError("it is inside a solid")
        return _make_body(RobotBody.on_floor(base, pose, height_m), settled)

    def _has_floor(self) -> bool:
        """Whether there is a floor at all; in a test pattern robots stand on the plane z = 0."""
        is_low = (np.abs(self._scene.corners[..., 2]) <= _LOW_M).all(axis=-1)
        is_floor = is_low & (self._scene.normals[:, 2] < 0.0)
        return not isinstance(self._caster, EmptyScene) and bool(is_floor.any())

    def _find_floor(self, pose: PlanarPose, z_m: float) -> Stance | None:
        """The surface on which a base at a height stands, as a plane; None for none at all."""
        at = np.array([[pose.x_m, pose.y_m, z_m - _NEAR_M]])
        below, normals = self._caster.closest_hits(at, DOWN[None])
        distance_m = float(below[0])
        if distance_m > _SEARCH_DEPTH_M + _NEAR_M:
            above, normals_above = self._caster.closest_hits(at, -DOWN[None])
            if math.isfinite(above[0]):
                distance_m, normals = -float(above[0]), normals_above
        if not math.isfinite(distance_m):
            return None
        at[0, 2] += distance_m
        floor_m = float(at[0, 2] + depth_of_paint(self._caster, at)[0])
        nx, ny, nz = normals[0].tolist()
        slopes = (-nx / nz, -ny / nz) if abs(nz) > _MIN_FLOOR else (0.0, 0.0)
        x, y, yaw = pose.x_m, pose.y_m, pose.yaw_rad
        return Stance(x, y, yaw, snap(floor_m), snap(slopes[0]), snap(slopes[1]))

    def may_stand(self, base: DriveBase, places: Floats, yaw_rad: float, z_m: float) -> Bools:
        """(n,) whether a base may have room at (n, 2) places: quick, and wrong at some of them.

        There is a floor, nothing crosses the middle of its body, and it is inside of nothing.
        """
        at = np.column_stack((places, np.full(len(places), z_m - _NEAR_M)))
        down = np.broadcast_to(DOWN, at.shape)
        below = self._caster.distances(at, down)
        has_floor: Bools = np.isfinite(below) if self._has_floor() else np.ones(len(at), dtype=bool)
        at[:, 2] = np.where(np.isfinite(below), at[:, 2] + below, 0.0) - 2.0 * base.max_step_m
        cosine, sine = cos(yaw_rad), sin(yaw_rad)
        x, y = (0.5 * size for size in base.collision_size_m[:2])
        is_free, is_inside = has_floor, np.ones(len(at), dtype=bool)
        for along, across in ((x, 0.0), (-x, 0.0), (0.0, y), (0.0, -y), (x, y), (-x, -y), (x, -y)):
            reach_m = hypot(along, across)
            way = np.array((along * cosine - across * sine, along * sine + across * cosine, 0.0))
            rays = np.broadcast_to(way / reach_m, at.shape)
            distances, normals = self._caster.closest_hits(at, rays)
            is_free = is_free & (distances > reach_m)
            is_inside &= np.isfinite(distances) & ((normals * rays).sum(axis=1) > 0.0)
        return is_free & ~is_inside

    def _is_in_solid(self, where: Pose) -> bool:
        """Whether rays from the chassis to all sides meet the backs of surfaces first."""
        angles = np.arange(8.0) * (math.pi / 4.0)
        rays = np.stack((cos(angles), sin(angles), 0.0 * angles), axis=-1)
        origins = np.repeat(where.translation[None], len(rays), axis=0)
        distances, normals = self._caster.closest_hits(origins, rays)
        return bool((np.isfinite(distances) & ((normals * rays).sum(axis=1) > 0.0)).all())

    def move(
        self,
        body: RobotBody,
        travel: WheelTravel,
        duration_s: float,
        others: Sequence[OrientedBox] = (),
    ) -> RobotBody:
        """Base after some seconds in which its wheels travelled.

        Args:
            body: The base.
            travel: Of the wheels over the surface, slip included.
            duration_s: Length of the tick.
            others: Other robots in reach.
        """
        if body.base.is_tripod:
            return body
        footing = body.footing if isinstance(body.footing, _Footing) else _adopt(body)
        if body.is_flipping:
            return self._flip(body, footing, others)
        if body.is_settled and (travel == NO_TRAVEL or footing.stance.side):
            return body
        chassis = shape_chassis(body.base, body.height_m)
        robots = _Robots.around(others, footing.stance.z_m, body.base.max_step_m)
        fall_m_s = footing.fall_m_s
        distance_m, turn_rad = travel.distance_m, travel.turn_rad(body.base)
        if footing.stance.side:
            distance_m = turn_rad = 0.0
        if footing.is_lying:
            chassis = chassis.as_lying
        # No step is longer than half the base: it cannot jump over a wall.
        shortest_m = 0.5 * min(body.base.collision_size_m[:2])
        count = math.ceil(abs(distance_m) / shortest_m) or 1
        step = _Step(
            distance_m / count,
            turn_rad / count,
            (fall_m_s * duration_s + 0.5 * GRAVITY_M_S2 * duration_s**2) / count,
            duration_s / count,
        )
        before = footing
        for _ in range(count):
            footing, is_free = self._go(body.base, chassis, footing, step, robots)
            if not is_free:
                break
        if footing is before:
            return body if body.footing is footing else replace(body, footing=footing)
        sank_m = footing.world_from_robot.translation[2] - before.world_from_robot.translation[2]
        # What it sank by is the mean speed of the tick, which ends faster by half a tick's gain.
        fall_m_s = max(float(sank_m) / duration_s, 0.0) + 0.5 * GRAVITY_M_S2 * duration_s
        fall_m_s = 0.0 if footing.is_held else fall_m_s
        footing = footing._replace(fall_m_s=fall_m_s)
        return _make_body(body, footing)

    def _flip(self, body: RobotBody, footing: _Footing, others: Sequence[OrientedBox]) -> RobotBody:
        """Base on its wheels at its place, or as it lies where it has no room."""
        still = replace(body, is_flipping=False, is_settled=footing.is_settled)
        if footing.stance.side == 0:
            return still
        z_m = float(body.world_from_robot.translation[2])
        try:
            placed = self.place(body.base, body.pose, z_m, height_m=body.height_m, others=others)
        except NoStandError:
            return still
        return replace(placed, spin=body.spin, tick=body.tick)

    def _go(
        self,
        base: DriveBase,
        chassis: ChassisShape,
        footing: _Footing,
        step: _Step,
        robots: _Robots,
    ) -> tuple[_Footing, bool]:
        """Footing after a step, or before what stops it; and whether nothing did."""

        def attempt(one: _Step) -> _Footing | None:
            return self._attempt(base, chassis, footing, one, robots)

        if footing.blocked is not None and footing.blocked.is_same(step, robots):
            return footing, False
        found = attempt(step)
        if found is None and footing.tumble != (0.0, 0.0):
            footing = footing._replace(tumble=(0.0, 0.0))
            found = attempt(step)
        if found is not None:
            return found._replace(blocked=None), True
        if step.is_rolling:
            rest = attempt(step.scale(0.0))
            if rest is not None:
                # Most bases that are stopped push on: the shortest way first.
                best, low, high = rest, 0.0, 1.0
                fraction = 0.5**_BISECTION_STEPS
                for _ in range(_BISECTION_STEPS):
                    found = attempt(step.scale(fraction))
                    if found is None:
                        high = fraction
                        if low == 0.0 and fraction == 0.5**_BISECTION_STEPS:
                            break
                    else:
                        best, low = found, fraction
                    fraction = 0.5 * (low + high)
                changes = [abs(a - b) for a, b in zip(best.stance, footing.stance, strict=True)]
                if best.is_settled and max(changes) < _STILL:
                    blocked = _Blocked(step, robots.boxes)
                    return footing._replace(blocked=blocked, is_settled=True, is_held=True), False
                return best, False
        if footing.is_aloft:
            # It hangs on something beside it, and slips off.
            for n, slip_m in itertools.product(range(8), _SLIPS_M):
                x, y = (slip_m * turn(0.25 * math.pi * n) for turn in (cos, sin))
                found = attempt(step.scale(0.0)._replace(shift_m=(x, y)))
                if found is not None:
                    return found, False
        # Neither may it sink: it leans on what it meets.
        return footing._replace(is_settled=True, is_held=True), False

    def _attempt(
        self,
        base: DriveBase,
        chassis: ChassisShape,
        footing: _Footing,
        step: _Step,
        robots: _Robots,
    ) -> _Footing | None:
        """Footing after a step; None where something stops it."""
        stance, before = footing.stance, footing.world_from_robot
        moved_m = abs(step.distance_m) + abs(step.turn_rad) * chassis.reach_m
        if footing.is_held and moved_m < min(footing.even_m, footing.free_m) and not robots.below:
            rolled = self._roll(chassis, footing, step, moved_m)
            return rolled if rolled and self._passes(chassis, before, rolled, robots) else None
        turn_rad = 0.0 if footing.is_aloft else step.turn_rad
        goal = stance.drive(step.distance_m, turn_rad) if step.is_rolling else stance
        goal = goal._replace(x_m=goal.x_m + step.shift_m[0], y_m=goal.y_m + step.shift_m[1])
        if not footing.is_held:  # what has no hold keeps its way, and falls
            goal = goal._replace(z_m=min(goal.z_m, stance.z_m))
        is_steep = stance.steepness > chassis.steepest
        sink_m = step.sink_m
        lowest_m = float(before.translation[2]) + max(goal.z_m - stance.z_m, 0.0) + sink_m
        if is_steep:
            goal = goal.slide(sink_m)
            sink_m -= max(goal.z_m - stance.z_m, 0.0)
        if footing.tumble != (0.0, 0.0):
            goal = chassis.tumble(goal, footing.tumble, step.duration_s)
        for _ in range(_MAX_HALVINGS):
            moved = self._settle(chassis, footing, goal, max(sink_m, 0.0), robots, moved_m)
            if float(moved.world_from_robot.translation[2]) <= lowest_m + 0.1 * SKIN_M:
                break
            # A large turn takes the middle further down than any point: less of it in this tick.
            sink_m *= 0.5
        if is_steep or moved.stance.steepness > chassis.steepest:
            moved = moved._replace(is_settled=False, is_held=False)
        if is_steep and moved.is_aloft and footing.tumble == (0.0, 0.0):
            rise = stance.steepness
            turn = (stance.slope_y / rise, -stance.slope_x / rise)
            moved = moved._replace(tumble=turn)
        elif not moved.is_aloft:
            moved = moved._replace(tumble=(0.0, 0.0))
        if moved.stance == stance:
            return moved
        after = moved.world_from_robot
        if (
            step.is_rolling
            and moved.stance.steepness > chassis.steepest_climb
            and after.translation[2] < before.translation[2] - _ROUNDING_M
        ):
            return None
        free_m = footing.free_m - _largest_motion(chassis, before, after)
        if free_m < 0.0:
            near = self._near(chassis, after, MARGIN_M)
            separations = self._separations(chassis, after, near, after)
            free_m = min(float(separations.min(initial=MARGIN_M)), MARGIN_M)
            if free_m < -_OVERLAP_M and self._is_deeper(chassis, before, after, near, separations):
                return None
        if moved.is_lying and not chassis.is_lying:
            free_m = 0.0  # what lies is larger
        moved = moved._replace(free_m=max(free_m, 0.0))
        return moved if self._passes(chassis, before, moved, robots) else None

    def _passes(
        self, chassis: ChassisShape, before: Pose, footing: _Footing, robots: _Robots
    ) -> bool:
        """Whether no other robot stops a base on the way from a pose."""
        if not robots.boxes:
            return True
        after = footing.world_from_robot
        separations = self._separations(chassis, after, robots.surfaces, after)
        return float(separations.min()) >= -_OVERLAP_M or not self._is_deeper(
            chassis, before, after, robots.surfaces, separations
        )

    def _separations(
        self, chassis: ChassisShape, where: Pose, surfaces: _Surfaces, shape: Pose
    ) -> Floats:
        """(n,) gaps between a base and surfaces, negative depths where they overlap: those of the
        body, and those of the second hull if it counts in a pose `shape`.
        """
        body, rest = (
            (half, Pose(where.rotation, where.transform_points(centre)))
            for centre, half in chassis.hulls
        )
        gaps, others = self._support.separations(*body, surfaces.triangles), surfaces.triangles
        if not chassis.is_lying:
            if not len(surfaces.walls) or shape.rotation[2, 2] == 1.0:
                return gaps
            # What does not reach the body is a step.
            centre, half = chassis.hulls[0]
            heights = matmul(surfaces.walls - shape.translation, shape.rotation[:, 2])
            others = surfaces.walls[heights.min(axis=1) < float(centre[2] + half[2])]
        return np.concatenate((gaps, self._support.separations(*rest, others)))

    def _is_deeper(
        self,
        chassis: ChassisShape,
        before: Pose,
        after: Pose,
        surfaces: _Surfaces,
        separations: Floats,
    ) -> bool:
        """Whether a base overlaps any surface by more than it did, or none by less."""
        was = np.minimum(self._separations(chassis, before, surfaces, after), -_OVERLAP_M)
        now = np.minimum(separations, -_OVERLAP_M)
        return bool((now < was).any() or now.min() <= was.min())

    def _roll(
        self, chassis: ChassisShape, footing: _Footing, step: _Step, moved_m: float
    ) -> _Footing | None:
        """Footing after a step over even ground; None for a slope that is too steep to climb."""
        goal = footing.stance.drive(step.distance_m, step.turn_rad)
        if goal.steepness > chassis.steepest_climb and goal.z_m < footing.stance.z_m - _ROUNDING_M:
            return None
        return footing._replace(
            stance=goal,
            world_from_robot=robot_pose(goal, chassis.sides[0]),
            calm_m=footing.calm_m - moved_m,
            even_m=footing.even_m - moved_m,
            free_m=footing.free_m - moved_m,
        )

    def _measure_even(self, chassis: ChassisShape, pose: Pose, calm_m: float) -> float:
        """How far the base can roll over ground of its plane, at most a distance."""
        side = chassis.sides[0]
        reach_m = hypot(*side.half_m) + side.radius_m + calm_m
        count = 2 * math.ceil(reach_m / _BRIDGED_M) + 1
        steps = np.linspace(-reach_m, reach_m, count)
        grid = np.stack(np.meshgrid(steps, steps, [0.0]), axis=-1).reshape(-1, 3)
        points, lifts = pose.transform_points(grid), np.full(len(grid), LIFT_M)
        gaps, _ = measure_gaps(self._caster, points, lifts, math.inf, ())
        return calm_m if float(np.abs(gaps).max()) < 2.0 * TOUCH_M else 0.0

    def _near(self, chassis: ChassisShape, where: Pose, margin_m: float) -> _Surfaces:
        """What of the scene may be within a margin of a base."""
        # Plain floats: in every tick of every robot, where arrays of three are slow.
        (cx, cy, cz), (hx, hy, hz) = (one.tolist() for one in chassis.whole)
        low, high = [], []
        for (a, b, c), t in zip(where.rotation.tolist(), where.translation.tolist(), strict=True):
            middle = a * cx + b * cy + c * cz + t
            reach = abs(a) * hx + abs(b) * hy + abs(c) * hz + margin_m
            low.append(math.floor((middle - reach) / _CELL_M))
            high.append(math.ceil((middle + reach) / _CELL_M))
        return self._find_near((*low, *high))

    def _settle(
        self,
        chassis: ChassisShape,
        footing: _Footing,
        stance: Stance,
        sink_m: float,
        robots: _Robots,
        moved_m: float = 0.0,
    ) -> _Footing:
        """Footing of a base that sinks from a stance, no point by more than some metres.

        The stance is at most `moved_m` from that of the footing.
        """
        is_same_side = stance.side == footing.stance.side
        side, was_tilted = chassis.sides[stance.side], not footing.stance.is_level
        is_lifted = (
            (was_tilted or not stance.is_level)
            and is_same_side
            and not footing.is_aloft
            and not math.isinf(sink_m)
        )
        calm_m = footing.calm_m - moved_m if is_same_side else 0.0
        even_m = min(footing.even_m - moved_m, calm_m)
        rest = self._support.settle(
            Sinking(
                side,
                stance,
                footing.stance if is_lifted else None,
                footing.contacts,
                sink_m,
                calm_m,
                footing.floor_z_m,
                robots.below,
                robots.triangles_below,
            ),
            lambda one: self._near(chassis, robot_pose(one, side), 1.5 * MARGIN_M).triangles,
        )
        stance = rest.stance
        if rest.is_even and even_m <= 0.0 and rest.calm_m > _BRIDGED_M:
            if stance.side == 0 and not robots.below:
                even_m = self._measure_even(chassis, stance.world_from_side, rest.calm_m)
        elif not rest.is_even:
            even_m = 0.0
        is_held = rest.touching == 3
        return footing._replace(
            stance=(chassis.tip(stance) or stance) if rest.is_over else stance,
            world_from_robot=robot_pose(stance, side),
            contacts=rest.contacts,
            calm_m=rest.calm_m,
            even_m=even_m,
            is_settled=is_held and not rest.is_on_robot,
            is_held=is_held,
            is_aloft=rest.touching == 0 and not rest.is_over,
        )


class _Robots(NamedTuple):
    """Other robots in reach."""

    boxes: tuple[OrientedBox, ...]
    surfaces: _Surfaces
    """Of all."""
    below: tuple[OrientedBox, ...]
    """Those whose top is low enough to stand on."""
    triangles_below: Floats

    @classmethod
    def around(cls, boxes: Sequence[OrientedBox], z_m: float, max_step_m: float) -> _Robots:
        """Robots around a base whose wheels are at a height, downwards."""
        if not boxes:
            return _NO_ROBOTS
        below = tuple(box for box in boxes if _top_of(box) > z_m - max_step_m - LIFT_M)
        surfaces = _Surfaces(_box_triangles(boxes), _NO_TRIANGLES)
        return cls(tuple(boxes), surfaces, below, _box_triangles(below))


def _top_of(box: OrientedBox) -> float:
    """z of the highest corner of a box."""
    reach = np.abs(box.world_from_box.rotation[2]).tolist()
    x, y, z = (0.5 * size * share for size, share in zip(box.size_m, reach, strict=True))
    top_m: float = float(box.world_from_box.translation[2]) - (x + y + z)
    return top_m


class _Blocked(NamedTuple):
    """A step that was not possible, among robots where they were."""

    step: _Step
    boxes: tuple[OrientedBox, ...]

    def is_same(self, step: _Step, robots: _Robots) -> bool:
        """Whether it is tried again, and no robot has moved."""
        return (
            step == self.step
            and len(robots.boxes) == len(self.boxes)
            and all(one is other for one, other in zip(robots.boxes, self.boxes, strict=True))
        )


class _Step(NamedTuple):
    """Motion that is tried at once."""

    distance_m: float
    turn_rad: float
    sink_m: float
    """How far it falls in this time."""
    duration_s: float
    shift_m: tuple[float, float] = (0.0, 0.0)
    """In x and y."""

    @property
    def is_rolling(self) -> bool:
        return self.distance_m != 0.0 or self.turn_rad != 0.0

    def scale(self, fraction: float) -> _Step:
        """Part of the way in the same time."""
        return self._replace(
            distance_m=fraction * self.distance_m, turn_rad=fraction * self.turn_rad
        )


def _adopt(body: RobotBody) -> _Footing:
    """Footing of a base on the plane z = 0."""
    stance = Stance(body.pose.x_m, body.pose.y_m, body.pose.yaw_rad)
    return _Footing(stance, body.world_from_robot)


def _make_body(body: RobotBody, footing: _Footing) -> RobotBody:
    where, yaw_rad = footing.world_from_robot, footing.stance.yaw_rad
    x, y, _ = where.translation.tolist()
    if footing.stance.side:
        yaw_rad = arctan2(float(where.rotation[1, 0]), float(where.rotation[0, 0]))
    return replace(
        body,
        pose=PlanarPose(x, y, yaw_rad),
        world_from_robot=where,
        footing=footing,
        is_settled=footing.is_settled,
        mishap=_describe_rest(footing) if footing.is_settled else body.mishap,
    )


def _describe_rest(footing: _Footing) -> str:
    if footing.floor_z_m > 0.0 and footing.stance.z_m > footing.floor_z_m - 0.5 * REST_DEPTH_M:
        return f"has nothing below: it rests {REST_DEPTH_M:g} m below the world"
    sides = (
        "",
        "on its roof",
        "on its front",
        "on its back",
        "on its right side",
        "on its left side",
    )
    return f"has fallen, and lies {sides[footing.stance.side]}" if footing.stance.side else ""


def _are_walls(triangles: Floats) -> Bools:
    """(n,) whether (n, 3, 3) triangles are nearly vertical."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normals = a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
    are: Bools = normals[:, 2] ** 2 <= _MAX_WALL**2 * (normals**2).sum(axis=1)
    return are


def _largest_motion(chassis: ChassisShape, before: Pose, after: Pose) -> float:
    """Upper bound on the motion of any point of a body."""
    shift = (after.translation - before.translation).tolist()
    turn = (after.rotation - before.rotation).ravel()
    # No point turns by more than the norm of the change of the rotation.
    turned: float = hypot(*turn.tolist())
    moved: float = hypot(*shift)
    return moved + chassis.reach_m * turned


_BOX_FACES = np.array(
    [
        (0, 1, 3), (0, 3, 2), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 3, 7), (1, 7, 5),
    ]
)  # fmt: skip
_BOX_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


def _box_triangles(boxes: Sequence[OrientedBox]) -> Floats:
    """(12 n, 3, 3) triangles of boxes."""
    return np.concatenate([_NO_TRIANGLES, *map(_triangles_of, boxes)])


@lru_cache(maxsize=256)
def _triangles_of(box: OrientedBox) -> Floats:
    """(12, 3, 3) triangles of a box; several robots meet the same one."""
    triangles: Floats = box.world_from_box.transform_points(_BOX_CORNERS * box.size_m)[_BOX_FACES]
    return triangles


_NO_TRIANGLES = np.zeros((0, 3, 3))
_NO_ROBOTS = _Robots((), _Surfaces(_NO_TRIANGLES, _NO_TRIANGLES), (), _NO_TRIANGLES)
