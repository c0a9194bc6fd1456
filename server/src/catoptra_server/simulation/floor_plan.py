"""A world from above: what a robot's heights meet, and where its base has floor and room.

A raster, for pictures and for a first free place; robots are placed and stopped in three dimensions
(`simulation/ground.py`). Columns run along x, rows along y. A picture of it is pale; what is
within the heights of the robot is dark, and the floor is green where the base has room to turn.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import hypot, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.simulation.collision_index import collision_height_m
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.textures import linear_light
from catoptra_server.world.triangles import first_occurrences
from catoptra_server.world.world_description import srgb_from_linear

_Indices = npt.NDArray[np.intp]

if TYPE_CHECKING:
    from catoptra_server.render.trace.ray_caster import SceneRayCaster

# Beyond the outermost obstacle or point; for a start a robot may have room beside all of them.
_MARGIN_M, _START_MARGIN_M = 0.5, 1.0
# Obstacles lower than this are driven over: carpets, lines, sills.
_GROUND_CLEARANCE_M = 0.03
# What a base stands on may be as far from the plane z = 0: a rug, a settled floor.
_FLOOR_DEPTH_M = 0.05
# Triangles of which corners and middles of the sides are drawn: of a fine mesh there are many.
_SMALL_PX = 2.0
# Rays that are cast at once: with their hits 10 MB.
_BLOCK = 65536
# Thickness of a wall, and what a block rises above half a robot. A room is wider and higher.
_MAX_WALL_M, _MAX_BLOCK_M = 1.0, 1.5
# Narrower gaps are no floor: no base turns in them.
_MAX_GAP_M = 0.2
# Colours in sRGB, with the shares of what is seen from above and of free floor.
PAPER, OBSTACLE = (250, 250, 248), (74, 80, 92)
_GREEN = (116, 190, 120)
_SEEN_SHARE, _FREE_SHARE = 0.4, 0.45
FREE = tuple(
    round(_FREE_SHARE * a + (1.0 - _FREE_SHARE) * b) for a, b in zip(_GREEN, PAPER, strict=True)
)
# A mast that carries an omnidirectional camera; a Pioneer turns within 0.36 m.
_START_HEIGHT_M = 1.0
# Plan by which a larger one is cut, and what is shown around the free places of that.
_COARSE_PX, _SURROUNDINGS_M = 160, 1.5
# Free on all sides of a start, as much as there is.
_START_RADII_M = (2.0, 1.2, 0.8, 0.6, 0.4)
_START_PLAN_PX = 800


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """Raster of a world from above."""

    origin_m: tuple[float, float]
    """x and y of the first column and row."""
    px_per_m: float
    triangles: npt.NDArray[np.int32]
    """(h, w) triangle of the scene below the robot's heights, or in them; -1 for none."""
    has_floor: Bools
    """(h, w) whether there is floor at z = 0, and nothing between it and the robot's top."""
    obstacles: Bools
    """(h, w) what is within the robot's heights."""

    def pixels(self, points_m: Floats) -> Floats:
        """(n, 2) column and row of (n, 2) points."""
        pixels: Floats = (points_m - np.array(self.origin_m)) * self.px_per_m
        return pixels

    def find_free(self, radius_m: float) -> Bools:
        """(h, w) places with floor and no obstacle all over a square of a half size."""
        return _has_none_near(self.obstacles | ~self.has_floor, math.ceil(radius_m * self.px_per_m))

    def find_reach(self, points_m: Floats, radius_m: float) -> tuple[Floats, Floats] | None:
        """Least and largest x and y, (2,) each, of the free places to which (n, 2) points lead.

        None where no point is near a free place.
        """
        free, reached = self.find_free(radius_m), np.zeros_like(self.obstacles)
        sides = np.array(reached.shape[::-1]) - 1
        columns, rows = self.pixels(points_m).clip(0, sides).astype(np.intp).T
        reached[rows, columns] = True
        grown = ~_has_none_near(reached, 2) & free
        while (grown != reached).any():
            reached, grown = grown, ~_has_none_near(grown, 1) & free
        if not reached.any():
            return None
        rows, columns = np.nonzero(reached)
        pixels = np.stack((columns, rows), axis=-1)
        origin_m = np.array(self.origin_m)
        low_m: Floats = origin_m + pixels.min(axis=0) / self.px_per_m
        high_m: Floats = origin_m + (pixels.max(axis=0) + 1) / self.px_per_m
        return low_m, high_m

    def colour(self, scene: SceneMesh, radius_m: float) -> npt.NDArray[np.uint8]:
        """(h, w, 3) picture, free for a base of a radius."""
        # One colour a triangle; that of a texture is its mean. The last row is for no triangle.
        means = [linear_light(one).mean(axis=(0, 1)) for one in scene.textures]
        tints = np.array([*means, np.ones(3)])
        seen = srgb_from_linear(scene.albedo * tints[scene.texture_index])
        paper = np.array(PAPER)
        seen = np.concatenate((255.0 * seen, paper[None]))[self.triangles]
        picture = _SEEN_SHARE * seen + (1.0 - _SEEN_SHARE) * paper
        free = self.find_free(radius_m)
        picture[free] = _FREE_SHARE * np.array(_GREEN) + (1.0 - _FREE_SHARE) * picture[free]
        picture[self.obstacles] = OBSTACLE
        return picture.round().astype(np.uint8)


def _has_none_near(mask: Bools, reach: int) -> Bools:
    """(h, w) pixels without one of a mask in the square of `reach` pixels on all sides."""
    counts = mask.astype(np.int32)
    for axis, size in enumerate(counts.shape):
        # Sums over a stretch, as differences of sums from the first pixel.
        sums = np.insert(counts.cumsum(axis=axis), 0, 0, axis=axis)
        first = np.arange(size) - reach
        counts = sums.take((first + 2 * reach + 1).clip(max=size), axis)
        counts -= sums.take(first.clip(min=0), axis)
    none: Bools = counts == 0
    return none


def measure_robot(robot: RobotDescription) -> tuple[float, float]:
    """Height of a robot, and the radius of the circle in which its base turns; metres."""
    length_m, width_m, _ = robot.drive.collision_size_m
    return collision_height_m(robot), 0.5 * hypot(length_m, width_m)


def find_start(scene: SceneMesh) -> tuple[float, float] | None:
    """Place with the most room, nearest to the middle of the plan; None without a free one.

    On the floor; anywhere between obstacles in a scene without any.
    """
    points_m = np.zeros((0 if len(scene) else 1, 2))
    plan = draw_floor_plan(
        scene,
        height_m=_START_HEIGHT_M,
        points_m=points_m,
        size_px=_START_PLAN_PX,
        margin_m=_START_MARGIN_M,
    )
    if not (plan.has_floor & ~plan.obstacles).any():
        plan.has_floor[:] = True
    height, width = plan.has_floor.shape
    middle = np.array((0.5 * width, 0.5 * height)) / plan.px_per_m + plan.origin_m
    for radius_m in _START_RADII_M:
        rows, columns = np.nonzero(plan.find_free(radius_m))
        if len(rows):
            points = np.stack((columns + 0.5, rows + 0.5), axis=-1) / plan.px_per_m
            points += plan.origin_m
            x, y = points[np.square(points - middle).sum(axis=1).argmin()].round(2).tolist()
            return x + 0.0, y + 0.0  # no negative zeros
    return None


def draw_floor_plan(
    scene: SceneMesh,
    *,
    height_m: float,
    points_m: Floats,
    size_px: int,
    margin_m: float = _MARGIN_M,
    radius_m: float | None = None,
) -> FloorPlan:
    """Floor plan of a scene.

    Args:
        scene: The scene, with its floor at z = 0.
        height_m: Height of the robot, which meets what is lower.
        points_m: (n, 2) points that the plan contains, too.
        size_px: Number of pixels of the longer side.
        margin_m: Distance from the outermost obstacle or point to the border.
        radius_m: Radius of a base: the plan ends behind what it reaches from the points, and leaves
            out a garden behind windows. None: it shows all.
    """
    # Loaded by who needs plans: with Pillow in 20 ms.
    from PIL import Image, ImageDraw

    from catoptra_server.render.trace.ray_caster import commit_ray_caster

    outlines = _find_outlines(scene, height_m)
    extent = np.concatenate((outlines.reshape(-1, 2), points_m))
    if not len(outlines) and len(scene):
        extent = np.concatenate((extent, scene.box_min[None, :2], scene.box_max[None, :2]))
    low, high = extent.min(axis=0) - margin_m, extent.max(axis=0) + margin_m
    if radius_m is not None:
        coarse = draw_floor_plan(scene, height_m=height_m, points_m=points_m, size_px=_COARSE_PX)
        if (reach := coarse.find_reach(points_m, radius_m)) is not None:
            low = np.maximum(low, np.minimum(reach[0], points_m.min(axis=0)) - _SURROUNDINGS_M)
            high = np.minimum(high, np.maximum(reach[1], points_m.max(axis=0)) + _SURROUNDINGS_M)
    px_per_m = size_px / float((high - low).max())
    width, height = (max(round(float(side) * px_per_m), 1) for side in high - low)
    image = Image.new("1", (width, height))
    draw = ImageDraw.Draw(image)
    outlines = (outlines - low) * px_per_m
    is_small = (outlines.max(axis=1) - outlines.min(axis=1) < _SMALL_PX).all(axis=1)
    for outline in outlines[~is_small].reshape(-1, 6).tolist():
        # The border, too: a wall seen on edge has no area.
        draw.polygon(outline, fill=1, outline=1)
    obstacles = np.array(image, dtype=bool)
    small = outlines[is_small]
    middles = 0.5 * (small + np.roll(small, -1, axis=1))
    columns, rows = np.concatenate((small, middles)).reshape(-1, 2).astype(np.intp).T
    obstacles[rows.clip(0, height - 1), columns.clip(0, width - 1)] = True
    plan = FloorPlan(
        (float(low[0]), float(low[1])),
        px_per_m,
        np.zeros((height, width), dtype=np.int32),
        np.zeros((height, width), dtype=bool),
        obstacles,
    )
    caster = commit_ray_caster(scene)
    for first in range(0, height, rows_each := _BLOCK // width + 1):
        _look_down(plan, caster, height_m, slice(first, first + rows_each))
    # Where walls overlap or touch, a face of one hides that a point is inside of the other.
    reach_px = round(0.5 * _MAX_GAP_M * px_per_m)
    obstacles |= _has_none_near(_has_none_near(obstacles, reach_px), reach_px)
    return plan


def _look_down(plan: FloorPlan, caster: SceneRayCaster, height_m: float, block: slice) -> None:
    """Fill in some rows of a plan what is seen from a height downwards."""
    triangles, has_floor = plan.triangles[block], plan.has_floor[block]
    columns, rows = np.meshgrid(
        np.arange(triangles.shape[1]) + 0.5, block.start + np.arange(len(triangles)) + 0.5
    )
    origins = np.stack((columns.ravel(), rows.ravel(), np.full(columns.size, -height_m)), axis=-1)
    origins[:, :2] = origins[:, :2] / plan.px_per_m + plan.origin_m
    down = np.broadcast_to((0.0, 0.0, 1.0), origins.shape)
    distances, found = caster.closest_triangles(origins, down)
    triangles[:] = found.reshape(triangles.shape)
    has_floor[:] = (np.abs(distances - height_m) <= _FLOOR_DEPTH_M).reshape(has_floor.shape)
    # At half the height: a shelf may begin where the robot ends.
    origins[:, 2] *= 0.5
    # Below what is inside of a body there is at least its bottom.
    others = np.flatnonzero(~plan.obstacles[block] & (triangles >= 0))
    plan.obstacles[block].reshape(-1)[_find_inside(caster, origins, others)] = True


def _find_outlines(scene: SceneMesh, height_m: float) -> Floats:
    """(n, 3, 2) triangles from above of what is between the ground clearance and a height."""
    corners = scene.corners
    lows, highs = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    within = (lows < -_GROUND_CLEARANCE_M) & (highs > -height_m)
    outlines = _clip_to_heights(corners[within], -height_m, -_GROUND_CLEARANCE_M)
    # From above many triangles of a scene are one: a third of the football field's remain.
    return outlines[first_occurrences(outlines)]


# Triangles of a polygon of six points.
_FAN = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])


def _clip_to_heights(corners: Floats, low: float, high: float) -> Floats:
    """(m, 3, 2) outlines from above of what (n, 3, 3) triangles have between two z.

    Each triangle reaches into the band. A roof whose foot stands on the floor has its ridge
    elsewhere.
    """
    z = corners[..., 2]
    is_whole = ((low <= z) & (z <= high)).all(axis=1)
    starts = corners[~is_whole]
    ends = np.roll(starts, -1, axis=1)
    rises = ends[..., 2] - starts[..., 2]
    rises[rises == 0.0] = 1.0  # a level edge within the band stays
    # Both ends of each edge move along the edge into the band.
    moves = [(np.clip(at[..., 2], low, high) - at[..., 2]) / rises for at in (starts, ends)]
    shares = np.stack(moves, axis=-1)[..., None]
    points = np.stack((starts, ends), axis=2)[..., :2]
    points += shares * (ends - starts)[:, :, None, :2]
    # At most one edge lies outside: the outline goes on where the next one enters the band.
    lowest, highest = np.minimum(starts, ends)[..., 2], np.maximum(starts, ends)[..., 2]
    is_outside = (highest < low) | (lowest > high)
    points = np.where(is_outside[..., None, None], np.roll(points[:, :, :1], -1, axis=1), points)
    fans = points.reshape(-1, 6, 2)[:, _FAN].reshape(-1, 3, 2)
    has_side = (fans[:, 1] != fans[:, 2]).any(axis=1)
    return np.concatenate((corners[is_whole][..., :2], fans[has_side]))


def _find_inside(caster: SceneRayCaster, origins: Floats, candidates: _Indices) -> _Indices:
    """Those of some points that lie inside of a wall or a block, which may be higher than a robot.

    There rays to opposite sides meet surfaces from behind, as in a room whose walls are seen from
    outside alone: that is wider than a wall and higher than a block. Not below: both end at the
    floor.
    """

    def look(points: _Indices, direction: Floats) -> tuple[Floats, Bools]:
        """Distance of the next surface, and whether it is met from behind."""
        directions = np.broadcast_to(direction, (len(points), 3))
        distances, normals = caster.closest_hits(origins[points], directions)
        return distances, matmul(normals, direction) > 0.0

    found = []
    height, is_behind = look(candidates, np.array((0.0, 0.0, -1.0)))
    blocks = candidates[is_behind & (height < _MAX_BLOCK_M)]
    for axis in np.eye(3)[:2]:
        walls, thickness = candidates, np.zeros(len(candidates))
        for direction in (axis, -axis):
            distances, is_behind = look(walls, direction)
            is_behind &= (thickness := thickness + distances) < _MAX_WALL_M
            walls, thickness = walls[is_behind], thickness[is_behind]
            blocks = blocks[look(blocks, direction)[1]]
        found.append(walls)
    return np.concatenate((*found, blocks))
