"""How a rigid body comes to rest: the plane of three contacts, and what separates it from things.

The underside of a body is a set of points. Rays straight down from just above them measure how far
each is from the surface below it; edges between the points come from the triangles themselves, cut
by the planes of the wheels and the sides of the belly. Within these gaps the body sinks as far as
its centre of gravity can sink:

    maximise a   where   a + b x_k + c y_k <= gap_k   for each point k at (x_k, y_k) of the centre

The optimum is the facet of the lower hull of the gaps below the centre: its three points are the
contacts, and the centre lies between them. This is a dual simplex in three unknowns, which begins
with the contacts of the tick before. A centre above the line of two contacts, as on four wheels,
leaves a body free to rock: it rocks until it is most level. The plane's slopes change the places of
the points, so the step is repeated until nothing moves.

This is the definition; the kernel computes the same, see `kernel/src/resting.c`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arctan2, cos, hypot, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.drive import integrate_arc
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors import RayCaster
from catoptra_server.world.objects import OrientedBox, box_distances

if TYPE_CHECKING:
    from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster

# A contact, and a gap that is none: rays in a scene of 100 m end within 1e-5 m.
TOUCH_M = 2e-5
LIFT_M = 0.005
"""Rays begin as far above the highest point that wheels can reach."""
MARGIN_M = 0.25
"""Around a body, in which things are looked up at once."""
# Layers as thin are paint, which wheels do not feel: lines of a field, marks of a hall.
_PAINT_M = 0.00102
DOWN = np.array([0.0, 0.0, 1.0])
# Edges that are farther below than a base sinks, as it may tilt on the way.
_EDGE_REACH_M = 0.005
_MAX_ITERATIONS, _MAX_PIVOTS = 12, 60
# Below it a weight of a contact is none, and the base can rock about the other two.
_NO_WEIGHT = 1e-6


class Stance(NamedTuple):
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
            # To the last bit `Pose.from_rpy`, signs of zeros too, in a fifth of its time.
            c, s = cos(self.yaw_rad), sin(self.yaw_rad)
            z = c * 0.0 + s * 0.0
            rotation = ((c, c * 0.0 - s, z), (s, s * 0.0 + c, s * 0.0 - c * 0.0), (-0.0, 0.0, 1.0))
            return Pose(np.array(rotation), np.array(place))
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

    def slide(self, distance_m: float) -> Stance:
        """Stance further down in the plane, by as much as a fall of a distance allows."""
        rise = hypot(self.slope_x, self.slope_y)
        along = distance_m * rise / (1.0 + rise * rise)
        return self._replace(
            x_m=self.x_m + along * self.slope_x / rise,
            y_m=self.y_m + along * self.slope_y / rise,
            z_m=self.z_m + along * rise,
        )

    def drive(self, distance_m: float, turn_rad: float) -> Stance:
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


class Sinking(NamedTuple):
    """A base that sinks from a stance."""

    side: Side
    goal: Stance
    before: Stance | None
    """Where a tilted base comes from: what the arc alone lifts has not to fall."""
    contacts: tuple[int, int, int]
    sink_m: float
    """How far no point sinks deeper."""
    calm_m: float
    """How far away the nearest thing is that rises above the plane, as far as is known."""
    floor_z_m: float
    boxes: tuple[OrientedBox, ...] = ()
    """Other robots, to stand on."""
    obstacles: Floats = np.zeros((0, 3, 3))
    """(n, 3, 3) their triangles."""


class Rest(NamedTuple):
    """Where a base ends that sinks."""

    stance: Stance
    contacts: tuple[int, int, int] = (0, 0, 0)
    """Points of the side between which the centre lies."""
    touching: int = 0
    """Number of contacts that are surfaces, not the limit of the fall."""
    calm_m: float = 0.0
    is_even: bool = False
    """Whether it did not move, and the ground is its plane wherever it has a point."""
    is_on_robot: bool = False
    is_over: bool = False
    """Whether its centre is beyond all its points, so that it tips over."""


class Side(NamedTuple):
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


def robot_pose(stance: Stance, side: Side) -> Pose:
    """Pose of a robot whose side has a stance."""
    pose = stance.world_from_side
    if stance.side:
        return pose @ side.side_from_robot
    # The wheels' plane has the axes of the robot.
    return Pose(pose.rotation, pose.transform_points(side.side_from_robot.translation))


def find_facet(
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


def separations(half: Floats, where: Pose, triangles: Floats) -> Floats:
    """(n,) largest gap between a box and each of (n, 3, 3) triangles along any axis that may
    separate the two (Gottschalk 1996); negative: the depth of the overlap.

    Args:
        half: (3,) half sides of the box.
        where: Pose of the box; float64 twin of `catoptra_separate`.
        triangles: In the world.
    """
    corners = matmul(triangles - where.translation, where.rotation)
    low, high = corners.min(axis=1), corners.max(axis=1)
    apart: Floats = (np.maximum(low, -high) - half).max(axis=1, initial=-math.inf)
    close = np.flatnonzero(apart < MARGIN_M)
    if not len(close):
        return apart
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
    apart[close] = np.maximum(apart[close], gaps.max(axis=1))
    return apart


def snap(value: float) -> float:
    """Value, or 0 for what rounding leaves of it: a level floor is level to the last bit."""
    return 0.0 if abs(value) < 1e-6 else float(value)


FindNear = Callable[[Stance], Floats]
"""(n, 3, 3) triangles of the scene near a base in a stance."""


class Support(Protocol):
    """What bases rest on: the scene, by the kernel or by NumPy."""

    def settle(self, sinking: Sinking, find_near: FindNear) -> Rest:
        """Where a base comes to rest, or how far it falls."""

    def separations(self, half: Floats, where: Pose, triangles: Floats) -> Floats:
        """(n,) largest gaps between a box and triangles, see `separations`."""


@runtime_checkable
class _HasKernel(Protocol):
    """A ray caster of the native kernel, or one that may be."""

    @property
    def kernel(self) -> KernelMeshCaster | None: ...


def make_support(caster: RayCaster) -> Support:
    """Support by the kernel where a caster has it."""
    if isinstance(caster, _HasKernel) and caster.kernel is not None:
        from catoptra_server.simulation.kernel_support import KernelSupport

        return KernelSupport(caster.kernel)
    return ReferenceSupport(caster)


class ReferenceSupport:
    """The definition, in NumPy."""

    def __init__(self, caster: RayCaster) -> None:
        """Rest on what rays meet."""
        self._caster = caster

    def separations(self, half: Floats, where: Pose, triangles: Floats) -> Floats:
        """As of the function."""
        return separations(half, where, triangles)

    def settle(self, sinking: Sinking, find_near: FindNear) -> Rest:
        """Where a base comes to rest, or how far it falls."""
        side, stance, contacts = sinking.side, sinking.goal, sinking.contacts
        calm_m, sink_m, boxes = sinking.calm_m, sinking.sink_m, sinking.boxes
        goal_z = start_z = stance.world_from_side.transform_points(side.points)[:, 2]
        if sinking.before is not None:
            here = sinking.before.world_from_side.transform_points(side.points)
            start_z = np.maximum(start_z, here[:, 2])
        has_moved, gaps, is_robot = False, np.zeros(0), np.zeros(0, dtype=bool)
        for step in range(_MAX_ITERATIONS):
            pose = stance.world_from_side
            points = pose.transform_points(side.points)
            if max(contacts) >= len(points):  # an edge, which lies elsewhere now
                contacts = (0, 0, 0)
            # A step of the search may take a point below the floor: rays begin where it came from.
            lifts = side.lifts + np.maximum(points[:, 2] - goal_z, 0.0)
            gaps, is_robot = measure_gaps(self._caster, points, lifts, sinking.floor_z_m, boxes)
            limits = np.minimum(gaps, sink_m - (points[:, 2] - start_z))
            edges, heights = None, gaps * pose.rotation[2, 2] + side.points[:, 2]
            if calm_m <= 0.0 or boxes or np.abs(heights).max() > 2.0 * TOUCH_M:
                triangles = np.concatenate((find_near(stance), sinking.obstacles))
                edges, calm_m = self._find_edges(side, pose, sink_m, triangles)
            if edges is None:
                i, j, k = contacts
                is_low = gaps.min() >= -TOUCH_M and i != j
                if is_low and max(limits[i], limits[j], limits[k]) <= TOUCH_M:
                    break
            else:
                points = np.concatenate((points, edges[0]))
                gaps = np.concatenate((gaps, edges[1]))
                limits = np.concatenate((limits, np.minimum(edges[1], sink_m)))
            if step == _MAX_ITERATIONS - 1:
                # What does not end, between corners, ends above all of them.
                raised_m = min(float(gaps.min()), 0.0)
                gaps, has_moved = gaps - raised_m, True
                stance = stance._replace(z_m=stance.z_m + raised_m)
                break
            if sinking.before is None and gaps.min() > sink_m + TOUCH_M:
                return Rest(stance._replace(z_m=stance.z_m + sink_m))
            centre = pose.transform_points(side.side_from_robot.translation)
            x, y = points[:, 0] - centre[0], points[:, 1] - centre[1]
            found = find_facet(x, y, limits, contacts, (stance.slope_x, stance.slope_y))
            if found is None:
                # It falls as it is while it can, and then tips over to another side.
                room_m = float(limits.min())
                if room_m > TOUCH_M:
                    return Rest(stance._replace(z_m=stance.z_m + room_m))
                return Rest(stance, is_over=True)
            sink, by_x, by_y, contacts = found
            dx, dy = stance.x_m - float(centre[0]), stance.y_m - float(centre[1])
            has_moved = True
            calm_m = 0.0 if max(abs(by_x), abs(by_y)) > TOUCH_M else calm_m
            stance = stance._replace(
                z_m=snap(stance.z_m + sink + by_x * dx + by_y * dy),
                slope_x=snap(stance.slope_x + by_x),
                slope_y=snap(stance.slope_y + by_y),
            )
            if edges is not None and max(abs(sink), abs(by_x), abs(by_y)) < TOUCH_M:
                break
        is_robot = np.append(is_robot, np.full(len(gaps) - len(is_robot), len(boxes) > 0))
        return Rest(
            stance,
            contacts,
            sum(bool(gaps[one] <= 2.0 * TOUCH_M) for one in contacts),
            calm_m,
            not has_moved and edges is None,
            any(bool(is_robot[one]) for one in contacts),
        )

    def _find_edges(
        self, side: Side, pose: Pose, sink_m: float, triangles: Floats
    ) -> tuple[tuple[Floats, Floats] | None, float]:
        """Points of the underside above edges and corners of surfaces, and their gaps; and how far
        away the nearest thing is that rises above the plane of the side.

        A polygon is nearest to a plane at a corner: that of a triangle, or where its edges pass the
        border of the plane part; to a wheel at an edge that passes the plane of the wheel, or
        where rays find it.
        """
        corners = matmul(triangles - pose.translation, pose.rotation)
        top, bottom = -side.rise_m - LIFT_M, sink_m + _EDGE_REACH_M
        z = corners[..., 2]
        corners = corners[(z.min(axis=1) < bottom) & (z.max(axis=1) > top)]
        if not len(corners):
            return None, MARGIN_M
        rising = corners[corners[..., 2].min(axis=1) < -2.0 * TOUCH_M][..., :2]
        # The rims of wheels are within the sides of the body, or little outside.
        reach = np.array(side.half_m) + side.radius_m
        away = np.maximum(rising.min(axis=1), -rising.max(axis=1)) - reach
        calm_m = min(MARGIN_M - side.radius_m, float(away.max(axis=1).min(initial=MARGIN_M)))
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
        raised = np.flatnonzero(gaps < -TOUCH_M)
        if len(raised):
            hits = points[raised]
            hits[:, 2] += gaps[raised]
            gaps[raised] += depth_of_paint(self._caster, hits)
        return (points, gaps), calm_m


def measure_gaps(
    caster: RayCaster,
    points: Floats,
    lifts: Floats,
    floor_z_m: float,
    others: Sequence[OrientedBox],
) -> tuple[Floats, Bools]:
    """(k,) heights of points above what is below, and whether that is a robot."""
    origins = points.copy()
    origins[:, 2] -= lifts
    down = np.broadcast_to(DOWN, points.shape)
    gaps = caster.distances(origins, down) - lifts
    raised = np.flatnonzero(gaps < -TOUCH_M)
    if len(raised):
        hits = points[raised]
        hits[:, 2] += gaps[raised]
        gaps[raised] += depth_of_paint(caster, hits)
    gaps = np.minimum(gaps, floor_z_m - points[:, 2])
    if not others:
        return gaps, np.zeros(len(gaps), dtype=bool)
    boxes = box_distances(others, origins, down)
    # What a ray begins in is beside the base, not below.
    boxes = np.where(boxes > 0.0, boxes - lifts, math.inf)
    return np.minimum(gaps, boxes), boxes < gaps


def depth_of_paint(caster: RayCaster, hits: Floats) -> Floats:
    """(n,) thickness of thin layers at (n, 3) points on surfaces, 0 for none."""
    origins = hits + np.array((0.0, 0.0, 1e-5))
    depths = caster.distances(origins, np.broadcast_to(DOWN, hits.shape)) + 1e-5
    return np.where(depths <= _PAINT_M, depths, 0.0)
