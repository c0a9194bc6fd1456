"""Random worlds with what makes proofs about visibility fail, by seed.

Unlit shapes of random colours that touch, overlap and pierce one another, with viewpoints inside
boxes, within planes and a hair above floors.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    Item,
    Material,
    Rectangle,
    Ring,
    Shape,
    SphereBand,
    World,
)
from helpers.dynamic_objects import build_cube_mesh
from helpers.worlds import translate_world

_CUBE = build_cube_mesh(0.5, (1.0, 0.0, 0.0))
_FAR_M = (20e3, -15e3, 300.0)
_QUARTER = 0.5 * math.pi

Items = list[tuple[Shape, Pose]]


def make_random_exposure(seed: int) -> tuple[World, CameraState]:
    """A world, and a camera in it with up to three dynamic objects."""
    rng = np.random.default_rng(seed)
    viewpoint = (*rng.uniform(-1.0, 1.0, 2), -float(10.0 ** rng.uniform(-1.5, 0.3)))
    angles = (0.0, 0.0, 0.0) if rng.uniform() < 0.2 else tuple(rng.uniform(-0.5, 0.5, 3))
    camera = CameraState(Pose.from_rpy(viewpoint, angles), _place_objects(rng, viewpoint))
    items = _floor(rng) if rng.uniform() < 0.8 else []
    for _ in range(rng.integers(1, 6)):
        items += _GROUPS[rng.integers(len(_GROUPS))](rng, np.array(viewpoint))
    world = _paint(rng, items)
    return _move_far(world, camera) if seed % 8 == 0 else (world, camera)


def _paint(rng: np.random.Generator, items: Items) -> World:
    """World of items in few colours, so that some neighbours have the same."""
    colours = rng.uniform(0.05, 1.0, (5, 3))
    painted = [
        Item(f"i{n}", shape, pose, Material(tuple(rng.choice(colours)), unlit=True))
        for n, (shape, pose) in enumerate(items)
    ]
    return World("random", tuple(painted), background=(0.2, 0.3, 0.9))


def _move_far(world: World, camera: CameraState) -> tuple[World, CameraState]:
    """The same scene 25 km from the world's origin."""
    offset = Pose.from_rpy(_FAR_M)
    objects = tuple(
        DynamicObject(placed.mesh, offset @ placed.world_from_object) for placed in camera.objects
    )
    return translate_world(world, _FAR_M), CameraState(offset @ camera.world_from_mirror, objects)


def _place_objects(rng: np.random.Generator, viewpoint: object) -> tuple[DynamicObject, ...]:
    """Cubes near and far, and sometimes around the viewpoint."""
    count = max(0, int(rng.integers(-2, 4)))
    poses = [_random_pose(rng, float(rng.choice((0.7, 2.0, 9.0)))) for _ in range(count)]
    if rng.uniform() < 0.1:
        poses.append(Pose.from_rpy(viewpoint, tuple(rng.uniform(-3.0, 3.0, 3))))
    return tuple(DynamicObject(_CUBE, pose) for pose in poses)


def _random_pose(rng: np.random.Generator, distance_m: float = 3.0) -> Pose:
    """Pose around the origin; every other one is aligned with the axes."""
    at = rng.uniform(-distance_m, distance_m, 3) * (1.0, 1.0, 0.4)
    angles = rng.uniform(-math.pi, math.pi, 3)
    if rng.uniform() < 0.5:
        angles = _QUARTER * rng.integers(-1, 3, 3)
    return Pose.from_rpy(tuple(at), tuple(angles))


def _floor(rng: np.random.Generator) -> Items:
    side = float(10.0 ** rng.uniform(0.3, 2.3))
    return [(Rectangle((side, side * float(rng.uniform(0.3, 1.0)))), Pose.identity())]


def _any_shape(rng: np.random.Generator, viewpoint: object) -> Items:
    """Solids of all sizes."""
    size = 10.0 ** rng.uniform(-1.5, 0.5, 3)
    shapes: tuple[Shape, ...] = (
        Box(tuple(size)),
        Cylinder(float(size[0]), float(size[1]), sectors=int(rng.integers(3, 20))),
        SphereBand(float(size[0]), 0.0, float(rng.uniform(0.5, 3.1)), 12, 6),
        Rectangle(tuple(size[:2])),
        Ring(float(0.5 * size[0]), float(size[0]), sectors=int(rng.integers(3, 30))),
    )
    return [(shapes[rng.integers(len(shapes))], _random_pose(rng))]


def _thin_bars(rng: np.random.Generator, viewpoint: object) -> Items:
    """Bars of 1 to 20 mm: narrower than a pixel, and between the axes of all beams."""
    count = int(rng.integers(1, 6))
    widths = 10.0 ** rng.uniform(-3.0, -1.7, count)
    return [(Box((float(w), float(w), 3.0)), _random_pose(rng)) for w in widths]


def _marks_on_the_floor(rng: np.random.Generator, viewpoint: object) -> Items:
    """A line and a ring 1 and 2 mm above the floor, a crate sunk into it by a centimetre.

    Its bottom on the floor's own plane could be seen from inside: of two surfaces in one place
    either may be the first.
    """
    x, y = rng.uniform(-1.5, 1.5, 2)
    heading = (0.0, 0.0, float(rng.uniform(-3.0, 3.0)))
    return [
        (Rectangle((3.0, 0.05)), Pose.from_rpy((x, y, -1e-3), heading)),
        (Ring(0.5, 0.55, sectors=24), Pose.from_rpy((x, y, -2e-3))),
        (Box((0.3, 0.2, 0.4)), Pose.from_rpy((x + 0.7, y, -0.19), heading)),
    ]


def _coplanar(rng: np.random.Generator, viewpoint: object) -> Items:
    """Rectangles of one plane that share a side, and a third one beside them."""
    at = _random_pose(rng)
    return [
        (Rectangle((1.0, 1.0)), at),
        (Rectangle((1.0, 1.0)), at @ Pose.from_rpy((1.0, 0.0, 0.0))),
        (Rectangle((1.0, 0.5)), at @ Pose.from_rpy((0.0, float(rng.uniform(0.75, 1.0)), 0.0))),
    ]


def _piercing(rng: np.random.Generator, viewpoint: object) -> Items:
    """Rectangles through one another."""
    at = _random_pose(rng)
    return [
        (Rectangle((1.5, 1.5)), at),
        (Rectangle((1.5, 1.5)), at @ Pose.from_rpy((0.0, 0.0, 0.0), tuple(rng.uniform(-1, 1, 3)))),
        (Box((0.3, 2.0, 0.3)), at @ Pose.from_rpy((0.2, 0.0, 0.0))),
    ]


def _around_the_viewpoint(rng: np.random.Generator, viewpoint: object) -> Items:
    """A box around the camera, seen from inside."""
    size = 10.0 ** rng.uniform(-0.5, 1.0, 3)
    return [(Box(tuple(size)), Pose.from_rpy(viewpoint, tuple(rng.uniform(-1.0, 1.0, 3))))]


def _grazing(rng: np.random.Generator, viewpoint: np.ndarray[tuple[int]]) -> Items:
    """A rectangle whose plane holds the viewpoint, beside it, or passes it at 0.1 to 19 mm."""
    aside = float(rng.choice((0.0, 1e-4, 1e-3, 1e-2)) * rng.uniform(1.0, 1.9))
    # Within the rectangle itself a viewpoint has no side of it.
    ahead = float(rng.uniform(2.1, 3.0)) if aside == 0.0 else float(rng.uniform(-2.0, 2.0))
    angles = tuple(rng.uniform(-3.0, 3.0, 3)) if rng.uniform() < 0.5 else (0.0, 0.0, 0.3)
    turn = Pose.from_rpy((0.0, 0.0, 0.0), angles)
    at = Pose.from_rpy(tuple(viewpoint)) @ turn @ Pose.from_rpy((ahead, 0.3, aside))
    return [(Rectangle(tuple(rng.uniform(0.5, 4.0, 2))), at)]


def _behind_one_another(rng: np.random.Generator, viewpoint: object) -> Items:
    """Three parallel rectangles, the nearest with a hole or smaller than the others."""
    at = _random_pose(rng)
    near: Shape = Ring(0.2, 1.2, sectors=5) if rng.uniform() < 0.5 else Rectangle((0.7, 1.9))
    layers = (near, Rectangle((2.0, 2.0)), Rectangle((3.0, 3.0)))
    gap = float(rng.choice((1e-3, 0.02, 0.3)))
    return [(shape, at @ Pose.from_rpy((0.0, 0.0, gap * n))) for n, shape in enumerate(layers)]


_GROUPS: tuple[Callable[[np.random.Generator, np.ndarray[tuple[int]]], Items], ...] = (
    _any_shape,
    _any_shape,
    _thin_bars,
    _marks_on_the_floor,
    _coplanar,
    _piercing,
    _around_the_viewpoint,
    _grazing,
    _behind_one_another,
)
