"""Where a base stands: the pose in which it touches what is below, and where it cannot go.

A base is a rigid body of six sides, mostly on its wheels. Its underside is a set of points: the
rims of the wheels as far as they can climb, the belly between them, and of each other side a grid.
Rays straight down from just above these points measure how far each is from the surface below it,
whatever that is: triangles, holes of masks, other robots. Edges between the points come from the
triangles themselves, cut by the planes of the wheels and the sides of the belly. Within these gaps
the base sinks as far as its centre of gravity, taken for the origin of the chassis, can sink:

    maximise a   where   a + b x_k + c y_k <= gap_k   for each point k at (x_k, y_k) of the centre

The optimum is the facet of the lower hull of the gaps below the centre: its three points are the
contacts, and the centre lies between them. This is a dual simplex in three unknowns, which begins
with the contacts of the tick before. A centre above the line of two contacts, as on four wheels,
leaves a base free to rock: it rocks until it is most level. The plane's slopes change the places of
the points, so the step is repeated until nothing moves.

The motion is quasi-static: no inertia, no suspension, no bouncing. No point sinks faster than it
falls: in a tick of length t by v t + g t^2 / 2, where v has grown by g t for each tick in which the
base found no rest. What is tilted by more than `MaxTilt` slides down along its own plane, as
fast; once in the air it turns on, as fast as a rod that fell to that tilt. A centre beyond all
points of a side lets the base tip over to the next side. A base that lies on another side than its
wheels does not drive.

A base is stopped by what its body meets: the box from `MaxStep` above the wheels' plane up to the
top of what it carries, against the triangles near to it, by the separating axis theorem
(Gottschalk 1996); and by a slope above `MaxClimbAngle` that it would climb.

On even ground nothing of this is repeated: how far the base can move before a thing rises above its
plane, the plane ends, or a body may be touched, is remembered and used up.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.elementary import arccos, arctan2, cos, hypot, matmul, sin, tan
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.drive import NO_TRAVEL, RobotBody, WheelTravel, integrate_arc
from catoptra_server.simulation.robot_description import DriveBase, PlanarPose
from catoptra_server.simulation.sensors import EmptyScene, RayCaster
from catoptra_server.world.objects import OrientedBox, box_distances
from catoptra_server.world.scene_mesh import SceneMesh

GRAVITY_M_S2 = 9.81
REST_DEPTH_M = 10.0
"""Depth below the lowest surface of a world at which whatever falls out of it comes to rest."""
# Layers as thin are paint, which wheels do not feel: lines of a field, marks of a hall.
_PAINT_M = 0.002
# A contact, and a gap that is none: rays in a scene of 100 m end within 1e-5 m.
_TOUCH_M = 2e-5
# Two robots compute their contact in axes of their own.
_OVERLAP_M = 1e-6
_ROUNDING_M = 1e-9
# Sideways, of what hangs on something while it falls.
_SLIPS_M = (0.005, 0.02, 0.06)
# Metres and radians of a base that does not move.
_STILL = 1e-6
# The box of a body ends as far above the belly, whose points lie some centimetres apart.
_SKIN_M = 0.005
# Rays begin as far above the highest point that wheels can reach.
_LIFT_M = 0.005
_RIM_STEP_RAD = math.radians(7.5)
# A box of cells is searched once: a power of two rounds nothing.
_CELL_M, _MAX_BLOCKS = 0.5, 128
_DOWN = np.array([0.0, 0.0, 1.0])
# As far below a requested place is its floor.
_SEARCH_DEPTH_M = 2.0
# Not above: the floor of a place may be as much higher.
_NEAR_M = 0.05
# Around a body, in which things are looked up at once.
_MARGIN_M = 0.25
# 2^-7 of at most 14 mm is a tenth of a millimetre.
_BISECTION_STEPS = 7
# Cosines to the vertical of a side to tip over to, and of a surface to stand on.
_MIN_FACING, _MIN_FLOOR = 0.05, 0.5
# Edges that are farther below than a base sinks, as it may tilt on the way.
_EDGE_REACH_M = 0.005
# Height up to which a triangle that faces up is the floor of a world.
_LOW_M = 0.03
# Gaps in even ground that are narrower do not count: a wheel sinks by 2 mm into them.
_BRIDGED_M = 0.05
_MAX_HALVINGS = 4
_MAX_ITERATIONS, _MAX_PIVOTS = 12, 60
# Below it a weight of a contact is none, and the base can rock about the other two.
_NO_WEIGHT = 1e-6


class NoStandError(CatoptraError):
    """A base cannot stand at a place; the message says why."""


class _Stance(NamedTuple):
    """The plane on which a base rests, through the middle of its side, and its heading."""

    x_m: float
    y_m: float
    yaw_rad: float
    """Of the x axis of the side, clockwise from above."""
    z_m: float = 0.0
    slope_x: float = 0.0
    """dz/dx of the plane; z points down."""
    slope_y: float = 0.0
    """dz/dy of the plane."""
    side: int = 0
    """Number of the side of the chassis; 0: the wheels."""

    @property
    def is_level(self) -> bool:
        """Whether the plane has no slope at all."""
        return self.slope_x == 0.0 and self.slope_y == 0.0

    @property
    def steepness(self) -> float:
        """Tangent of the plane's angle to the horizon."""
        return 0.0 if self.is_level else hypot(self.slope_x, self.slope_y)

    @property
    def world_from_side(self) -> Pose:
        """Pose of the side: x along the heading, z into the ground."""
        place = (self.x_m, self.y_m, self.z_m)
        if self.is_level:
            return Pose.from_rpy(place, (0.0, 0.0, self.yaw_rad))
        forward, right, down = self._axes()
        return Pose(np.array([forward, right, down]).T.copy(), np.array(place))

    def _axes(self) -> tuple[tuple[float, float, float], ...]:
        """Unit vectors ahead, to the right and into the ground."""
        cosine, sine = cos(self.yaw_rad), sin(self.yaw_rad)
        rise = self.slope_x * cosine + self.slope_y * sine
        length = hypot(1.0, rise)
        fx, fy, fz = cosine / length, sine / length, rise / length
        length = hypot(1.0, self.slope_x, self.slope_y)
        dx, dy, dz = -self.slope_x / length, -self.slope_y / length, 1.0 / length
        right = (dy * fz - dz * fy, dz * fx - dx * fz, dx * fy - dy * fx)
        return (fx, fy, fz), right, (dx, dy, dz)

    def slide(self, distance_m: float) -> _Stance:
        """Stance further down in the plane, by as much as a fall of a distance allows."""
        rise = hypot(self.slope_x, self.slope_y)
        along = distance_m * rise / (1.0 + rise * rise)
        return self._replace(
            x_m=self.x_m + along * self.slope_x / rise,
            y_m=self.y_m + along * self.slope_y / rise,
            z_m=self.z_m + along * rise,
        )

    def drive(self, distance_m: float, turn_rad: float) -> _Stance:
        """Stance at the end of an arc in the plane, exact, see `integrate_arc`."""
        if self.is_level:
            pose = integrate_arc(PlanarPose(self.x_m, self.y_m, self.yaw_rad), distance_m, turn_rad)
            return self._replace(x_m=pose.x_m, y_m=pose.y_m, yaw_rad=pose.yaw_rad)
        forward, right, _ = self._axes()
        step = integrate_arc(PlanarPose(0.0, 0.0, 0.0), distance_m, turn_rad)
        ahead, aside = cos(turn_rad), sin(turn_rad)
        return self._replace(
            x_m=self.x_m + step.x_m * forward[0] + step.y_m * right[0],
            y_m=self.y_m + step.x_m * forward[1] + step.y_m * right[1],
            z_m=self.z_m + step.x_m * forward[2] + step.y_m * right[2],
            yaw_rad=arctan2(
                ahead * forward[1] + aside * right[1], ahead * forward[0] + aside * right[0]
            ),
        )


class _Side(NamedTuple):
    """One of the six sides on which a chassis can lie."""

    robot_from_side: Pose
    """z points out of the robot."""
    side_from_robot: Pose
    points: Floats
    """(k, 3) that may touch what is below; in the side's frame."""
    lifts: Floats
    """(k,) how far above the points rays begin, vertically."""
    half_m: tuple[float, float]
    """Half sides of the plane part of the side, along x and y."""
    rise_m: float
    """Height of the plane part above the plane z = 0, up."""
    wheels_m: tuple[tuple[float, float], ...] = ()
    radius_m: float = 0.0
    """Of the wheels, at (x, y)."""


class _Chassis(NamedTuple):
    """Shape of a base, as it stands and as it collides."""

    sides: tuple[_Side, ...]
    centre: Floats
    """(3,) middle of the box that things stop, chassis frame."""
    half_m: Floats
    """(3,)."""
    reach_m: float
    """Distance of the farthest corner from the origin of the chassis."""
    steepest: float
    """Tangent of the largest tilt at which it lies still."""
    steepest_climb: float
    """Tangent of the steepest plane that it climbs."""
    tumble_rad_s: float
    """Speed at which it turns on after it slid off an edge."""


@cache
def _shape_chassis(base: DriveBase, height_m: float) -> _Chassis:
    length, width, body_height = base.collision_size_m
    height = max(height_m, body_height, base.max_step_m + 0.05)
    ride, belly = base.ride_height_m, base.max_step_m
    low, high = ride - belly - _SKIN_M, ride - height  # z of the box, which points down
    half = np.array((0.5 * length, 0.5 * width, 0.5 * (low - high)))
    centre = np.array((0.0, 0.0, 0.5 * (low + high)))
    identity = np.eye(3)
    pose = Pose(identity, np.array((0.0, 0.0, ride)))
    sides = [
        _Side(pose, pose.inverse(), *_underside(base), base.wheel_places_m, base.wheel_radius_m)
    ]
    # Columns: x, y and z of a side in the chassis; the roof first.
    for axes in (
        ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
        ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
        ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
        ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
        ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ):
        rotation = np.array(axes, dtype=float).T
        reach = np.abs(matmul(half, rotation))
        middle = centre + rotation[:, 2] * (reach[2] + 0.4 * _SKIN_M)
        grid = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 3)] * 2, [0.0]), axis=-1)
        points = grid.reshape(-1, 3) * reach
        lifts, pose = np.full(len(points), _LIFT_M), Pose(rotation, middle)
        sides.append(_Side(pose, pose.inverse(), points, lifts, (reach[0], reach[1]), 0.0))
    corner = hypot(half[0], half[1], max(abs(low), abs(high)))
    # A rod that has turned about its middle from level to the largest tilt: v^2 = 2 g h.
    lost_m = 0.5 * length * (1.0 - cos(base.max_tilt_rad))
    return _Chassis(
        tuple(sides),
        centre,
        half,
        float(corner),
        tan(base.max_tilt_rad),
        tan(base.max_climb_rad),
        math.sqrt(1.5 * GRAVITY_M_S2 * lost_m) / (0.5 * length),
    )


def _underside(base: DriveBase) -> tuple[Floats, Floats, tuple[float, float], float]:
    """Points, lifts, half sides and rise of the side of the wheels: rims, and the belly."""
    radius, step = base.wheel_radius_m, base.max_step_m
    # What is higher on a rim than a step is touched by no step.
    steep_rad = arccos(max(1.0 - step / radius, -1.0))
    count = max(math.ceil(steep_rad / _RIM_STEP_RAD), 1)
    angles: Floats = steep_rad / count * np.arange(-count, count + 1.0)
    rim = np.stack((radius * sin(angles), 0.0 * angles, -radius * (1.0 - cos(angles))), axis=-1)
    places = [np.array((x, y, 0.0)) for x, y in base.wheel_places_m]
    # Within the sides of the body, which touch walls.
    x, y = (0.5 * (size - _SKIN_M) for size in base.collision_size_m[:2])
    belly = np.stack(np.meshgrid([-x, 0.0, x], [-y, 0.0, y], [-step]), axis=-1).reshape(-1, 3)
    points = np.concatenate((*(rim + place for place in places), belly))
    return points, step + _LIFT_M + points[:, 2], (x, y), step


class _Footing(NamedTuple):
    """What is remembered of a base from one tick to the next."""

    stance: _Stance
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
        def find_near(cells: tuple[int, ...]) -> Floats:
            low, high = _CELL_M * np.array(cells[:3]), _CELL_M * np.array(cells[3:])
            corners: Floats = scene.corners[scene.hierarchy().find_near(low, high)]
            lows, highs = corners.min(axis=1), corners.max(axis=1)
            near: Floats = corners[((lows <= high) & (highs >= low)).all(axis=1)]
            return near

        self._find_near = find_near

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
        chassis = _shape_chassis(base, height_m)
        stance, floor_z_m = self._find_floor(pose, z_m), self._depth_m
        if stance is None:
            if self._has_floor():
                raise NoStandError("there is no floor")
            stance, floor_z_m = _Stance(pose.x_m, pose.y_m, pose.yaw_rad), 0.0
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
        box = chassis._replace(half_m=chassis.half_m + np.array((clearance_m, clearance_m, 0.0)))
        triangles = np.concatenate((self._near(box, where, 0.0), robots.triangles))
        if _separations(box, where, triangles).min(initial=1.0) < -_OVERLAP_M:
            raise NoStandError("the robot touches an obstacle")
        if self._is_in_solid(where):
            raise NoStandError("it is inside a solid")
        return _make_body(RobotBody.on_floor(base, pose, height_m), settled)

    def _has_floor(self) -> bool:
        """Whether there is a floor at all; in a test pattern robots stand on the plane z = 0."""
        is_low = (np.abs(self._scene.corners[..., 2]) <= _LOW_M).all(axis=-1)
        is_floor = is_low & (self._scene.normals[:, 2] < 0.0)
        return not isinstance(self._caster, EmptyScene) and bool(is_floor.any())

    def _find_floor(self, pose: PlanarPose, z_m: float) -> _Stance | None:
        """The surface on which a base at a height stands, as a plane; None for none at all."""
        at = np.array([[pose.x_m, pose.y_m, z_m - _NEAR_M]])
        below, normals = self._caster.closest_hits(at, _DOWN[None])
        distance_m = float(below[0])
        if distance_m > _SEARCH_DEPTH_M + _NEAR_M:
            above, normals_above = self._caster.closest_hits(at, -_DOWN[None])
            if math.isfinite(above[0]):
                distance_m, normals = -float(above[0]), normals_above
        if not math.isfinite(distance_m):
            return None
        at[0, 2] += distance_m
        floor_m = float(at[0, 2] + self._depth_of_paint(at)[0])
        nx, ny, nz = normals[0].tolist()
        slopes = (-nx / nz, -ny / nz) if abs(nz) > _MIN_FLOOR else (0.0, 0.0)
        x, y, yaw = pose.x_m, pose.y_m, pose.yaw_rad
        return _Stance(x, y, yaw, _snap(floor_m), _snap(slopes[0]), _snap(slopes[1]))

    def may_stand(self, base: DriveBase, places: Floats, yaw_rad: float, z_m: float) -> Bools:
        """(n,) whether a base may have room at (n, 2) places: quick, and wrong at some of them.

        There is a floor, nothing crosses the middle of its body, and it is inside of nothing.
        """
        at = np.column_stack((places, np.full(len(places), z_m - _NEAR_M)))
        down = np.broadcast_to(_DOWN, at.shape)
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
        footing = body.footing if isinstance(body.footing, _Footing) else _adopt(body)
        if body.is_flipping:
            return self._flip(body, footing, others)
        if body.is_settled and (travel == NO_TRAVEL or footing.stance.side):
            return body
        chassis = _shape_chassis(body.base, body.height_m)
        robots = _Robots.around(others, footing.stance.z_m, body.base.max_step_m)
        fall_m_s = footing.fall_m_s
        distance_m, turn_rad = travel.distance_m, travel.turn_rad(body.base)
        if footing.stance.side:
            distance_m = turn_rad = 0.0
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
        chassis: _Chassis,
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
        chassis: _Chassis,
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
        if is_steep:
            goal = goal.slide(sink_m)
            sink_m -= max(goal.z_m - stance.z_m, 0.0)
        if footing.tumble != (0.0, 0.0):
            goal = _tumble(chassis, goal, footing.tumble, chassis.tumble_rad_s * step.duration_s)
        lowest_m = float(before.translation[2]) + max(goal.z_m - stance.z_m, 0.0) + step.sink_m
        for _ in range(_MAX_HALVINGS):
            moved = self._settle(chassis, footing, goal, max(sink_m, 0.0), robots, moved_m)
            if float(moved.world_from_robot.translation[2]) <= lowest_m + 0.1 * _SKIN_M:
                break
            # A large turn takes the middle further down than any point: less of it in this tick.
            sink_m *= 0.5
        if is_steep or moved.stance.steepness > chassis.steepest:
            moved = moved._replace(is_settled=False, is_held=False)
        if is_steep and moved.is_aloft and footing.tumble == (0.0, 0.0):
            rise = stance.steepness
            moved = moved._replace(tumble=(stance.slope_y / rise, -stance.slope_x / rise))
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
            near = self._near(chassis, after, _MARGIN_M)
            separations = _separations(chassis, after, near)
            free_m = min(float(separations.min(initial=_MARGIN_M)), _MARGIN_M)
            if free_m < -_OVERLAP_M and _is_deeper(chassis, before, near, separations):
                return None
        return (
            moved._replace(free_m=max(free_m, 0.0))
            if self._passes(chassis, before, moved, robots)
            else None
        )

    def _passes(self, chassis: _Chassis, before: Pose, footing: _Footing, robots: _Robots) -> bool:
        """Whether no other robot stops a base on the way from a pose."""
        if not len(robots.triangles):
            return True
        separations = _separations(chassis, footing.world_from_robot, robots.triangles)
        return float(separations.min()) >= -_OVERLAP_M or not _is_deeper(
            chassis, before, robots.triangles, separations
        )

    def _roll(
        self, chassis: _Chassis, footing: _Footing, step: _Step, moved_m: float
    ) -> _Footing | None:
        """Footing after a step over even ground; None for a slope that is too steep to climb."""
        goal = footing.stance.drive(step.distance_m, step.turn_rad)
        if goal.steepness > chassis.steepest_climb and goal.z_m < footing.stance.z_m - _ROUNDING_M:
            return None
        return footing._replace(
            stance=goal,
            world_from_robot=goal.world_from_side @ chassis.sides[0].side_from_robot,
            calm_m=footing.calm_m - moved_m,
            even_m=footing.even_m - moved_m,
            free_m=footing.free_m - moved_m,
        )

    def _measure_even(self, chassis: _Chassis, pose: Pose, calm_m: float) -> float:
        """How far the base can roll over ground of its plane, at most a distance."""
        side = chassis.sides[0]
        reach_m = hypot(*side.half_m) + side.radius_m + calm_m
        count = 2 * math.ceil(reach_m / _BRIDGED_M) + 1
        steps = np.linspace(-reach_m, reach_m, count)
        grid = np.stack(np.meshgrid(steps, steps, [0.0]), axis=-1).reshape(-1, 3)
        points, lifts = pose.transform_points(grid), np.full(len(grid), _LIFT_M)
        gaps, _ = self._measure_gaps(points, lifts, math.inf, ())
        return calm_m if float(np.abs(gaps).max()) < 2.0 * _TOUCH_M else 0.0

    def _near(self, chassis: _Chassis, where: Pose, margin_m: float) -> Floats:
        """(n, 3, 3) triangles of the scene that may be within a margin of a body."""
        centre = where.transform_points(chassis.centre)
        reach = matmul(np.abs(where.rotation), chassis.half_m) + margin_m
        low, high = np.floor((centre - reach) / _CELL_M), np.ceil((centre + reach) / _CELL_M)
        return self._find_near((*map(int, low.tolist()), *map(int, high.tolist())))

    def _settle(
        self,
        chassis: _Chassis,
        footing: _Footing,
        stance: _Stance,
        sink_m: float,
        robots: _Robots,
        moved_m: float = 0.0,
    ) -> _Footing:
        """Footing of a base that sinks from a stance, no point by more than some metres.

        The stance is at most `moved_m` from that of the footing.
        """
        contacts, start_z, goal_z = footing.contacts, None, np.zeros(0)
        calm_m = footing.calm_m - moved_m if stance.side == footing.stance.side else 0.0
        even_m = min(footing.even_m - moved_m, calm_m)
        gaps, is_robot = np.zeros(0), np.zeros(0, dtype=bool)
        for _ in range(_MAX_ITERATIONS):
            side, pose = chassis.sides[stance.side], stance.world_from_side
            points = pose.transform_points(side.points)
            if start_z is None:
                start_z = goal_z = points[:, 2]
                is_tilted = not (stance.is_level and footing.stance.is_level)
                if (
                    is_tilted
                    and not footing.is_aloft
                    and stance.side == footing.stance.side
                    and not math.isinf(sink_m)
                ):
                    # What the arc alone lifts, in the plane of a tilted base, has not to fall.
                    here = footing.stance.world_from_side.transform_points(side.points)
                    start_z = np.maximum(start_z, here[:, 2])
            if max(contacts) >= len(points):  # an edge, which lies elsewhere now
                contacts = (0, 0, 0)
            # A step of the search may take a point below the floor: rays begin where it came from.
            lifts = side.lifts + np.maximum(points[:, 2] - goal_z, 0.0)
            gaps, is_robot = self._measure_gaps(points, lifts, footing.floor_z_m, robots.below)
            limits = np.minimum(gaps, sink_m - (points[:, 2] - start_z))
            edges, heights = None, gaps * pose.rotation[2, 2] + side.points[:, 2]
            if calm_m <= 0.0 or robots.below or np.abs(heights).max() > 2.0 * _TOUCH_M:
                edges, calm_m = self._find_edges(
                    chassis, side, pose, sink_m, robots.triangles_below
                )
            if edges is None:
                i, j, k = contacts
                is_low = gaps.min() >= -_TOUCH_M and i != j
                if is_low and max(limits[i], limits[j], limits[k]) <= _TOUCH_M:
                    if (
                        even_m <= 0.0
                        and calm_m > _BRIDGED_M
                        and stance.side == 0
                        and not robots.below
                    ):
                        even_m = self._measure_even(chassis, pose, calm_m)
                    break
            else:
                points = np.concatenate((points, edges[0]))
                gaps = np.concatenate((gaps, edges[1]))
                limits = np.concatenate((limits, np.minimum(edges[1], sink_m)))
            if start_z is goal_z and gaps.min() > sink_m + _TOUCH_M:
                return self._fall(footing, stance, side, sink_m)
            centre = pose.transform_points(side.side_from_robot.translation)
            x, y = points[:, 0] - centre[0], points[:, 1] - centre[1]
            found = _find_facet(x, y, limits, contacts, (stance.slope_x, stance.slope_y))
            if found is None:
                # It falls as it is while it can, and then tips over to another side.
                room_m = float(limits.min())
                if room_m > _TOUCH_M:
                    return self._fall(footing, stance, side, room_m)
                return footing._replace(
                    stance=_tip(chassis, stance) or stance,
                    world_from_robot=pose @ side.side_from_robot,
                    contacts=(0, 0, 0),
                    is_settled=False,
                    is_held=False,
                    is_aloft=False,
                )
            sink, by_x, by_y, contacts = found
            dx, dy = stance.x_m - float(centre[0]), stance.y_m - float(centre[1])
            even_m = 0.0
            calm_m = 0.0 if max(abs(by_x), abs(by_y)) > _TOUCH_M else calm_m
            stance = stance._replace(
                z_m=_snap(stance.z_m + sink + by_x * dx + by_y * dy),
                slope_x=_snap(stance.slope_x + by_x),
                slope_y=_snap(stance.slope_y + by_y),
            )
            if edges is not None and max(abs(sink), abs(by_x), abs(by_y)) < _TOUCH_M:
                pose = stance.world_from_side
                break
        rests = [gaps[one] <= 2.0 * _TOUCH_M for one in contacts]
        is_robot = np.append(is_robot, np.full(len(gaps) - len(is_robot), len(robots.below) > 0))
        stands_on_robot = any(is_robot[one] for one in contacts)
        return footing._replace(
            stance=stance,
            world_from_robot=pose @ side.side_from_robot,
            contacts=contacts,
            calm_m=calm_m,
            even_m=even_m,
            is_settled=all(rests) and not stands_on_robot,
            is_held=all(rests),
            is_aloft=not any(rests),
        )

    def _fall(self, footing: _Footing, stance: _Stance, side: _Side, sink_m: float) -> _Footing:
        """Footing of a base that nothing is below within some metres."""
        stance = stance._replace(z_m=stance.z_m + sink_m)
        return footing._replace(
            stance=stance,
            world_from_robot=stance.world_from_side @ side.side_from_robot,
            contacts=(0, 0, 0),
            is_settled=False,
            is_held=False,
            is_aloft=True,
        )

    def _find_edges(
        self,
        chassis: _Chassis,
        side: _Side,
        pose: Pose,
        sink_m: float,
        obstacles: Floats,
    ) -> tuple[tuple[Floats, Floats] | None, float]:
        """Points of the underside above edges and corners of surfaces, and their gaps; and how far
        away the nearest thing is that rises above the plane of the side.

        A polygon is nearest to a plane at a corner: that of a triangle, or where its edges pass the
        border of the plane part; to a wheel at an edge that passes the plane of the wheel, or
        where rays find it.
        """
        triangles = self._near(chassis, pose @ side.side_from_robot, _MARGIN_M)
        if len(obstacles):
            triangles = np.concatenate((triangles, obstacles))
        corners = matmul(triangles - pose.translation, pose.rotation)
        top, bottom = -side.rise_m - _LIFT_M, sink_m + _EDGE_REACH_M
        z = corners[..., 2]
        corners = corners[(z.min(axis=1) < bottom) & (z.max(axis=1) > top)]
        if not len(corners):
            return None, _MARGIN_M
        rising = corners[corners[..., 2].min(axis=1) < -2.0 * _TOUCH_M][..., :2]
        # The rims of wheels are within the sides of the body, or little outside.
        reach = np.array(side.half_m) + side.radius_m
        away = np.maximum(rising.min(axis=1), -rising.max(axis=1)) - reach
        calm_m = min(_MARGIN_M - side.radius_m, float(away.max(axis=1).min(initial=_MARGIN_M)))
        begins, ends = corners.reshape(-1, 3), corners[:, [1, 2, 0]].reshape(-1, 3)
        (x, y), tolerance = side.half_m, 1e-9
        wheels_y = sorted({wheel_y for _, wheel_y in side.wheels_m})
        ahead, _ = _cross(begins, ends, 0, (-x, x))
        aside, plane = _cross(begins, ends, 1, (-y, y, *wheels_y))
        flat = np.concatenate((begins, ahead, aside[plane < 2]))
        flat = flat[(np.abs(flat[:, :2]) <= np.array((x, y)) + tolerance).all(axis=1)]
        places = [np.column_stack((flat[:, :2], np.full(len(flat), -side.rise_m), flat[:, 2]))]
        for wheel_x, wheel_y in side.wheels_m if len(aside) else ():
            along = aside[:, 0] - wheel_x
            is_near = (plane == 2 + wheels_y.index(wheel_y)) & (np.abs(along) < side.radius_m)
            hits, along = aside[is_near], along[is_near]
            rise = side.radius_m - np.sqrt(side.radius_m**2 - along * along)
            places.append(np.column_stack((hits[:, :2], -rise, hits[:, 2]))[rise < side.rise_m])
        on_side = np.concatenate(places)
        gaps = (on_side[:, 3] - on_side[:, 2]) / float(pose.rotation[2, 2])
        chosen = (on_side[:, 3] > top) & (gaps < bottom)
        if not chosen.any():
            return None, calm_m
        points, gaps = pose.transform_points(on_side[chosen, :3]), gaps[chosen]
        raised = np.flatnonzero(gaps < -_TOUCH_M)
        if len(raised):
            hits = points[raised]
            hits[:, 2] += gaps[raised]
            gaps[raised] += self._depth_of_paint(hits)
        return (points, gaps), calm_m

    def _measure_gaps(
        self,
        points: Floats,
        lifts: Floats,
        floor_z_m: float,
        others: Sequence[OrientedBox],
    ) -> tuple[Floats, Bools]:
        """(k,) heights of points above what is below, and whether that is a robot."""
        origins = points.copy()
        origins[:, 2] -= lifts
        down = np.broadcast_to(_DOWN, points.shape)
        gaps = self._caster.distances(origins, down) - lifts
        raised = np.flatnonzero(gaps < -_TOUCH_M)
        if len(raised):
            hits = points[raised]
            hits[:, 2] += gaps[raised]
            gaps[raised] += self._depth_of_paint(hits)
        gaps = np.minimum(gaps, floor_z_m - points[:, 2])
        if not others:
            return gaps, np.zeros(len(gaps), dtype=bool)
        boxes = box_distances(others, origins, down)
        # What a ray begins in is beside the base, not below.
        boxes = np.where(boxes > 0.0, boxes - lifts, math.inf)
        return np.minimum(gaps, boxes), boxes < gaps

    def _depth_of_paint(self, hits: Floats) -> Floats:
        """(n,) thickness of thin layers at (n, 3) points on surfaces, 0 for none."""
        origins = hits + np.array((0.0, 0.0, 1e-5))
        depths = self._caster.distances(origins, np.broadcast_to(_DOWN, hits.shape)) + 1e-5
        return np.where(depths <= _PAINT_M, depths, 0.0)


class _Robots(NamedTuple):
    """Other robots in reach."""

    boxes: tuple[OrientedBox, ...]
    triangles: Floats
    """(12 n, 3, 3) of all."""
    below: tuple[OrientedBox, ...]
    """Those whose top is low enough to stand on."""
    triangles_below: Floats

    @classmethod
    def around(cls, boxes: Sequence[OrientedBox], z_m: float, max_step_m: float) -> _Robots:
        """Robots around a base whose wheels are at a height, downwards."""
        if not boxes:
            return _NO_ROBOTS
        below = tuple(box for box in boxes if _top_of(box) > z_m - max_step_m - _LIFT_M)
        return cls(tuple(boxes), _box_triangles(boxes), below, _box_triangles(below))


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


def _snap(value: float) -> float:
    """Value, or 0 for what rounding leaves of it: a level floor is level to the last bit."""
    return 0.0 if abs(value) < 1e-6 else float(value)


def _adopt(body: RobotBody) -> _Footing:
    """Footing of a base on the plane z = 0."""
    stance = _Stance(body.pose.x_m, body.pose.y_m, body.pose.yaw_rad)
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


def _tip(chassis: _Chassis, stance: _Stance) -> _Stance | None:
    """The same pose as a stance on the side that faces the ground next; None if none does."""
    where = stance.world_from_side @ chassis.sides[stance.side].side_from_robot
    facing = _face_ground(chassis, where)
    facing[stance.side] = -1.0
    side = max(range(len(facing)), key=facing.__getitem__)
    return _stand_on(chassis, where, side) if facing[side] > _MIN_FACING else None


def _tumble(
    chassis: _Chassis, stance: _Stance, axis: tuple[float, float], angle_rad: float
) -> _Stance:
    """Stance after a turn about a level axis through the robot's origin."""
    where = stance.world_from_side @ chassis.sides[stance.side].side_from_robot
    turn = _rotate_about(*axis, angle_rad)
    turned = Pose(matmul(turn, where.rotation), where.translation)
    facing = _face_ground(chassis, turned)
    return _stand_on(chassis, turned, max(range(len(facing)), key=facing.__getitem__))


def _rotate_about(x: float, y: float, angle_rad: float) -> Floats:
    """Rotation about a level unit axis, by Rodrigues' formula."""
    c, s = cos(angle_rad), sin(angle_rad)
    d = 1.0 - c
    return np.array(
        ((c + d * x * x, d * x * y, s * y), (d * x * y, c + d * y * y, -s * x), (-s * y, s * x, c))
    )


def _face_ground(chassis: _Chassis, where: Pose) -> list[float]:
    """Cosine of the angle between the normal of each side and straight down."""
    normals = np.array([one.robot_from_side.rotation[:, 2] for one in chassis.sides])
    facing: list[float] = matmul(normals, where.rotation[2]).tolist()
    return facing


def _stand_on(chassis: _Chassis, where: Pose, side: int) -> _Stance:
    """A pose as a stance on a side that faces the ground."""
    pose = where @ chassis.sides[side].robot_from_side
    (fx, fy, _), (nx, ny, nz) = pose.rotation[:, 0].tolist(), pose.rotation[:, 2].tolist()
    x, y, z = pose.translation.tolist()
    return _Stance(x, y, arctan2(fy, fx), z, -nx / nz, -ny / nz, side)


def _find_facet(
    x: Floats,
    y: Floats,
    gaps: Floats,
    contacts: tuple[int, int, int],
    slopes: tuple[float, float],
) -> tuple[float, float, float, tuple[int, int, int]] | None:
    """Facet of the lower hull of (k,) gaps below the origin: a, b, c of its plane, and its points.

    None where no points lie around the origin.
    """
    if contacts[0] == contacts[1] or min(_weights(x, y, contacts)) < -_NO_WEIGHT:
        first = _surround(x, y)
        if first is None:
            return None
        contacts = first
    for _ in range(_MAX_PIVOTS):
        sink, by_x, by_y = _plane(x, y, gaps, contacts)
        above = gaps - sink - by_x * x - by_y * y
        lowest = int(above.argmin())
        weights = _weights(x, y, contacts)
        if min(weights) < _NO_WEIGHT:
            rocked = _rock(x, y, above, contacts, weights, (slopes[0] + by_x, slopes[1] + by_y))
            if rocked is not None:
                a, b, c, third = rocked
                line = tuple(p for p, w in zip(contacts, weights, strict=True) if w > min(weights))
                if len(line) == 2:
                    return sink + a, by_x + b, by_y + c, (line[0], line[1], third)
        if above[lowest] >= -1e-9:
            break
        if lowest in contacts:
            break
        i, j, k = contacts
        options = ((lowest, j, k), (i, lowest, k), (i, j, lowest))
        around = [one for one in options if min(_weights(x, y, one)) > -_NO_WEIGHT]
        if not around:
            break
        # Of two triangles with the centre on a side, only one takes the plane below the point.
        contacts = min(around, key=lambda one: _plane(x, y, gaps, one)[0])
    return sink, by_x, by_y, contacts


def _weights(x: Floats, y: Floats, contacts: tuple[int, int, int]) -> tuple[float, float, float]:
    """Shares of the weight that three contacts carry; negative outside them."""
    (a, b), (c, d), (e, f) = ((float(x[i]), float(y[i])) for i in contacts)
    parts = (c * f - e * d, e * b - a * f, a * d - c * b)
    total = sum(parts)
    if abs(total) < 1e-12:
        return (-1.0, -1.0, -1.0)
    return parts[0] / total, parts[1] / total, parts[2] / total


def _plane(
    x: Floats, y: Floats, gaps: Floats, contacts: tuple[int, int, int]
) -> tuple[float, float, float]:
    """a, b, c of the plane a + b x + c y through three points."""
    (xi, yi, gi), (xj, yj, gj), (xk, yk, gk) = (
        (float(x[i]), float(y[i]), float(gaps[i])) for i in contacts
    )
    dx, dy, dg = xj - xi, yj - yi, gj - gi
    ex, ey, eg = xk - xi, yk - yi, gk - gi
    area = dx * ey - ex * dy
    by_x, by_y = (dg * ey - eg * dy) / area, (dx * eg - ex * dg) / area
    return gi - by_x * xi - by_y * yi, by_x, by_y


def _rock(
    x: Floats,
    y: Floats,
    above: Floats,
    contacts: tuple[int, int, int],
    weights: tuple[float, float, float],
    slopes: tuple[float, float],
) -> tuple[float, float, float, int] | None:
    """Most level rotation about the two contacts that carry all: a, b, c to add, and the third."""
    free = weights.index(min(weights))
    i, j = (contacts[n] for n in range(3) if n != free)
    dx, dy = float(x[j] - x[i]), float(y[j] - y[i])
    length = hypot(dx, dy)
    across = (-dy / length, dx / length)
    # Height gained by a slope of 1 across the line.
    lever = across[0] * (x - x[i]) + across[1] * (y - y[i])
    with np.errstate(divide="ignore", invalid="ignore"):
        limits = above / lever
    right, left = lever > 1e-6, lever < -1e-6
    highest = float(limits[right].min(initial=math.inf))
    lowest = float(limits[left].max(initial=-math.inf))
    if highest < lowest - 1e-9:
        return None
    wanted = -(slopes[0] * across[0] + slopes[1] * across[1])
    slope = min(max(wanted, lowest), highest)
    candidates = np.where(right, limits - slope, np.where(left, slope - limits, math.inf))
    third = int(np.abs(candidates).argmin())
    if not math.isfinite(slope):
        return None
    base = -(across[0] * float(x[i]) + across[1] * float(y[i])) * slope
    return base, slope * across[0], slope * across[1], third


def _surround(x: Floats, y: Floats) -> tuple[int, int, int] | None:
    """Three points around the origin, or None."""
    directions = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
    corners = list(dict.fromkeys(int((p * x + q * y).argmax()) for p, q in directions))
    best, most = None, -_NO_WEIGHT
    for one in itertools.combinations(corners, 3):
        least = min(_weights(x, y, one))
        if least > most:
            best, most = one, least
    return best


def _cross(
    begins: Floats, ends: Floats, axis: int, values: tuple[float, ...]
) -> tuple[Floats, npt.NDArray[np.intp]]:
    """(m, 3) points at which edges of (n, 3) ends pass planes across an axis, and which planes."""
    planes = np.array(values)
    starts, stops = begins[:, axis, None] - planes, ends[:, axis, None] - planes
    edge, plane = np.nonzero((starts < 0.0) != (stops < 0.0))
    start = starts[edge, plane]
    share = start / (start - stops[edge, plane])
    points: Floats = begins[edge] + share[:, None] * (ends[edge] - begins[edge])
    return points, plane


def _largest_motion(chassis: _Chassis, before: Pose, after: Pose) -> float:
    """Upper bound on the motion of any point of a body."""
    shift = (after.translation - before.translation).tolist()
    turn = (after.rotation - before.rotation).ravel()
    # No point turns by more than the norm of the change of the rotation.
    turned: float = hypot(*turn.tolist())
    moved: float = hypot(*shift)
    return moved + chassis.reach_m * turned


def _separations(chassis: _Chassis, where: Pose, triangles: Floats) -> Floats:
    """(n,) largest gap between a body and each of (n, 3, 3) triangles along any axis that may
    separate the two; negative: the depth of the overlap.
    """
    half = chassis.half_m
    corners = matmul(triangles - where.translation, where.rotation) - chassis.centre
    low, high = corners.min(axis=1), corners.max(axis=1)
    separations: Floats = (np.maximum(low, -high) - half).max(axis=1, initial=-math.inf)
    close = np.flatnonzero(separations < _MARGIN_M)
    if not len(close):
        return separations
    corners = corners[close]
    edges = np.roll(corners, -1, axis=1) - corners
    zero = np.zeros(edges.shape[:2])
    ex, ey, ez = edges[..., 0], edges[..., 1], edges[..., 2]
    axes = np.stack(
        [
            np.stack((zero, ez, -ey), axis=-1),
            np.stack((-ez, zero, ex), axis=-1),
            np.stack((ey, -ex, zero), axis=-1),
        ],
        axis=1,
    ).reshape(len(close), 9, 3)
    a, b = edges[:, 0], edges[:, 1]
    normals = a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
    axes = np.concatenate((axes, normals[:, None]), axis=1)
    lengths = np.sqrt((axes * axes).sum(axis=-1))
    projected = matmul(axes, corners.swapaxes(1, 2))
    reach = matmul(np.abs(axes), half)
    gaps = np.maximum(projected.min(axis=-1), -projected.max(axis=-1)) - reach
    # An axis of no length separates nothing.
    with np.errstate(divide="ignore", invalid="ignore"):
        gaps = np.where(lengths > 1e-12, gaps / lengths, -math.inf)
    separations[close] = np.maximum(separations[close], gaps.max(axis=1))
    return separations


def _is_deeper(chassis: _Chassis, before: Pose, triangles: Floats, separations: Floats) -> bool:
    """Whether a body overlaps any triangle by more than it did, or none by less."""
    was = np.minimum(_separations(chassis, before, triangles), -_OVERLAP_M)
    now = np.minimum(separations, -_OVERLAP_M)
    return bool((now < was).any() or now.min() <= was.min())


_BOX_FACES = np.array(
    [
        (0, 1, 3), (0, 3, 2), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 3, 7), (1, 7, 5),
    ]
)  # fmt: skip
_BOX_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


def _box_triangles(boxes: Sequence[OrientedBox]) -> Floats:
    """(12 n, 3, 3) triangles of boxes."""
    corners = [pose.transform_points(_BOX_CORNERS * size)[_BOX_FACES] for pose, size in boxes]
    return np.concatenate(corners) if corners else np.zeros((0, 3, 3))


_NO_ROBOTS = _Robots((), _box_triangles(()), (), _box_triangles(()))
