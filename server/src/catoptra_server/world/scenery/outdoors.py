"""Things of yards, halls and streets; sizes in metres, colours from the random numbers.

Each function returns one `Thing`, whose front is +x.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from catoptra_protocol.optics.elementary import arctan2, cos, sin
from catoptra_server.world.scenery.furniture import (
    BLACK,
    CARDBOARD,
    CHROME,
    DARK,
    GLASS,
    OAK,
    RUBBER,
    STEEL,
    WHITE,
    Random,
    choose,
    door,
)
from catoptra_server.world.scenery.things import Thing, paint, shine
from catoptra_server.world.world_description import Material, Vector3

CONCRETE = paint(255, 255, 255, "concrete")
BRICK = paint(255, 255, 255, "brick")
PLANKS = paint(255, 255, 255, "planks")
ORANGE = paint(236, 96, 24, "plaster", tile_m=0.5)
YELLOW = paint(232, 186, 36, "plaster", tile_m=0.8)


def tree(random: Random, height: float, *, is_lit: bool = True) -> Thing:
    """Tree with boughs and a crown of several parts."""
    thing = Thing()
    make: Callable[..., Material] = paint if is_lit else shine
    bark, trunk = make(220, 210, 200, "bark"), 0.03 * height
    profile = [(1.7 * trunk, 0), (trunk, 0.08 * height), (0.6 * trunk, 0.6 * height)]
    thing.lathe(bark, (0, 0, 0), profile, is_round=True, sectors=10)
    green = make(*random.integers((150, 180, 110), (220, 250, 170)).tolist(), "leaves")
    shade, reach = make(90, 110, 70, "leaves"), 0.2 * height
    for bough in range(5):
        angle = 72.0 * bough + float(random.uniform(-20, 20))
        rise, out = float(random.uniform(0.5, 0.8)) * height, 0.17 * height
        at = (*_polar(out, angle), rise)
        lean, size = (0.0, 35.0, angle), 0.3 * height
        thing.rod(bark, (0, 0, 0.4 * height), 0.35 * trunk, size, turn_deg=lean, sectors=6)
        thing.ball(shade, at, 0.72 * reach)
        thing.leaves(green, random, at, (reach, reach, 0.85 * reach), 150, 0.055 * height)
    return thing


def _polar(radius: float, angle_deg: float) -> tuple[float, float]:
    angle = math.radians(angle_deg)
    return radius * cos(angle), radius * sin(angle)


def bush(random: Random, size: float = 1.0) -> Thing:
    """Bush of leaves around a dark heart."""
    thing = Thing()
    green = paint(*random.integers((140, 180, 110), (230, 255, 180)).tolist(), "leaves")
    for _ in range(3):
        x, y = random.uniform(-0.3 * size, 0.3 * size, 2).tolist()
        reach = 0.5 * size * float(random.uniform(0.7, 1.0))
        thing.ball(paint(80, 100, 60, "leaves"), (x, y, 0.6 * reach), 0.78 * reach)
        thing.leaves(green, random, (x, y, 0.65 * reach), (reach, reach, 0.9 * reach), 70, 0.11)
    return thing


def container(random: Random, length: float = 6.0) -> Thing:
    """Container of corrugated steel along y, its doors at the left end."""
    thing, wide, high = Thing(), 2.4, 2.5
    colours = ((36, 74, 132), (150, 62, 40), (60, 112, 84), (196, 150, 48))
    body = paint(*colours[int(random.integers(4))], "plaster", tile_m=1.5)
    thing.stand(body, 0, 0, 0.12, (wide - 0.12, length - 0.1, high - 0.14))
    for x in (-0.5 * wide + 0.06, 0.5 * wide - 0.06):
        for z in (0.1, high - 0.08):
            thing.box(body, (x, 0, z), (0.12, length, 0.16))
        for y in (-0.5 * length + 0.08, 0.5 * length - 0.08):
            thing.box(body, (x, y, 0.5 * high), (0.14, 0.16, high))
        for rib in range(round(length / 0.28) - 1):
            y = -0.5 * length + 0.28 * (rib + 1)
            thing.box(body, (x + math.copysign(0.01, x), y, 0.5 * high), (0.07, 0.14, high - 0.34))
    for y in (-0.45, -0.15, 0.15, 0.45):
        thing.rod(STEEL, (y * wide * 0.8, 0.5 * length + 0.01, 0.2), 0.02, high - 0.4, sectors=6)
    thing.box(WHITE, (0.5 * wide + 0.022, 0.25 * length, 0.7 * high), (0.004, 0.9, 0.22))
    return thing


def car(red: float, green: float, blue: float) -> Thing:
    """Passenger car of a colour."""
    thing, half, body = Thing(), 0.84, paint(red, green, blue, gloss=(0.05, 0.06))
    hull = [(-2.05, 0.3), (2.0, 0.26), (2.12, 0.5), (2.02, 0.68), (1.0, 0.88), (-1.85, 0.92)]
    thing.extrude(body, (0, 0, 0), [*hull, (-2.1, 0.7)], 2 * half)
    cabin = [(-1.75, 0.88), (1.05, 0.86), (0.3, 1.36), (-1.2, 1.38)]
    thing.extrude(GLASS, (0, 0, 0), cabin, 1.5)
    thing.extrude(body, (0, 0, 0), [(-1.3, 1.36), (0.36, 1.34), (0.2, 1.42), (-1.1, 1.44)], 1.44)
    for foot, top in ((-1.72, -1.2), (-0.35, -0.4), (1.02, 0.28)):
        post = [(foot - 0.06, 0.86), (foot + 0.06, 0.86), (top + 0.06, 1.37), (top - 0.06, 1.37)]
        thing.extrude(body, (0, 0, 0), post, 1.53)
    for x in (-1.3, 1.3):
        for side in (-1, 1):
            _add_wheel(thing, (x, side * (half - 0.07), 0.31), 0.31, 0.2)
            arch = (x, side * (half - 0.1) - 0.11, 0.33)
            thing.rod(BLACK, arch, 0.37, 0.22, turn_deg=(-90, 0, 0), sectors=20)
    for side in (-1, 1):
        thing.box(
            paint(250, 246, 230, gloss=(0.06, 0.1)), (2.03, side * 0.6, 0.6), (0.1, 0.34, 0.12)
        )
        thing.box(paint(170, 20, 22), (-2.05, side * 0.66, 0.74), (0.08, 0.28, 0.14))
        thing.box(body, (0.72, side * (half + 0.08), 0.96), (0.14, 0.18, 0.12))
        thing.box(CHROME, (-0.3, side * (half + 0.005), 0.76), (0.16, 0.03, 0.03))
    thing.box(BLACK, (2.1, 0, 0.42), (0.05, 0.9, 0.14))
    for x in (2.13, -2.12):
        thing.box(WHITE, (x, 0, 0.52), (0.012, 0.5, 0.11))
    return thing


def _add_wheel(thing: Thing, at: Vector3, radius: float, width: float) -> None:
    """Wheel with a rim, its axis along y."""
    x, y, z = at
    lie, half = (-90.0, 0.0, 0.0), 0.5 * width
    tyre = [(0.6 * radius, -half), (0.94 * radius, -half), (radius, -0.7 * half)]
    tyre += [(radius, 0.7 * half), (0.94 * radius, half), (0.6 * radius, half)]
    thing.lathe(RUBBER, at, tyre, turn_deg=lie, sectors=20)
    rim = [
        (0, 0.7 * -half),
        (0.6 * radius, 0.8 * -half),
        (0.6 * radius, 0.8 * half),
        (0, 0.7 * half),
    ]
    thing.lathe(STEEL, (x, y, z), rim, turn_deg=lie, sectors=14)
    for spoke in range(5):
        size = (0.14 * radius, 1.62 * half, 0.5 * radius)
        dx, dz = _polar(0.32 * radius, 72.0 * spoke)
        thing.box(DARK, (x + dx, y, z + dz), size, (0, 90.0 - 72.0 * spoke, 0))


def fence(length: float, height: float = 1.3) -> Thing:
    """Fence of boards along y."""
    thing = Thing()
    for number in range(int(length / 0.2)):
        y = -0.5 * length + 0.2 * (number + 0.5)
        thing.stand(PLANKS, 0.03, y, 0.06, (0.025, 0.15, height - 0.02 * (number * 7 % 3)))
    for z in (0.35, height - 0.25):
        thing.box(OAK, (0, 0, z), (0.04, length, 0.09))
    for post in range(int(length / 2.5) + 1):
        thing.stand(OAK, -0.05, -0.5 * length + 2.5 * post + 0.05, 0, (0.09, 0.09, height + 0.1))
    return thing


def barrel(random: Random) -> Thing:
    """Drum of steel with ribs and a lid."""
    thing = Thing()
    colours = ((38, 84, 146), (184, 48, 38), (60, 120, 76), (216, 168, 40))
    body = paint(*colours[int(random.integers(4))], "plaster", tile_m=0.8)
    edge, rib = 0.29, 0.305
    profile = [(0, 0.01), (edge, 0), (edge, 0.27), (rib, 0.29), (edge, 0.31), (edge, 0.57)]
    profile += [(rib, 0.59), (edge, 0.61), (edge, 0.88), (edge - 0.02, 0.88), (edge - 0.025, 0.86)]
    thing.lathe(body, (0, 0, 0), [*profile, (0, 0.86)])
    thing.rod(STEEL, (0.18, 0, 0.85), 0.03, 0.03)
    thing.box(WHITE, (edge - 0.004, 0, 0.44), (0.02, 0.16, 0.2))
    return thing


def cone() -> Thing:
    """Cone of a road works, with two white rings."""
    thing = Thing()
    thing.stand(BLACK, 0, 0, 0, (0.36, 0.36, 0.03))
    rings = ((0.15, 0.03), (0.115, 0.2), (0.095, 0.3), (0.07, 0.42), (0.055, 0.5), (0.025, 0.62))
    for number, (low, high) in enumerate(pairwise(rings)):
        thing.lathe(WHITE if number % 2 else ORANGE, (0, 0, 0), [low, high], sectors=14)
    thing.lathe(ORANGE, (0, 0, 0.62), [(0.025, 0), (0, 0.005)], sectors=14)
    return thing


def pallet(random: Random, load: float = 0) -> Thing:
    """Pallet, with boxes on it in layers of two by three."""
    thing = Thing()
    for x in (-0.35, 0.0, 0.35):
        thing.stand(PLANKS, x, 0, 0, (0.1, 1.2, 0.1))
    for board in range(7):
        thing.stand(PLANKS, 0, 0.18 * board - 0.54, 0.1, (0.8, 0.11, 0.022))
    for layer in range(round(load)):
        for x in (-0.2, 0.2):
            for y in (-0.4, 0.0, 0.4):
                if layer < load - 1 or random.random() < 0.7:
                    shift = float(random.uniform(-0.012, 0.012))
                    size = (0.385, 0.385, 0.298)
                    thing.stand(CARDBOARD, x + shift, y - shift, 0.122 + 0.3 * layer, size)
                    z = 0.122 + 0.3 * layer + 0.15
                    thing.box(
                        WHITE, (x + shift + math.copysign(0.193, x), y, z), (0.003, 0.1, 0.07)
                    )
    return thing


def house(random: Random, length: float = 11.0, depth: float = 6.0, height: float = 2.9) -> Thing:
    """House of bricks along y with a gabled roof; its front is at x = 0."""
    thing, back = Thing(), -0.5 * depth
    thing.stand(BRICK, back, 0, 0, (depth, length, height))
    thing.stand(CONCRETE, back, 0, 0, (depth + 0.06, length + 0.06, 0.3))
    gable = [(-0.5 * depth, 0), (0.5 * depth, 0), (0, 0.36 * depth)]
    thing.extrude(BRICK, (back, 0, height), gable, length)
    roof = paint(255, 255, 255, "roof")
    for side in (-1, 1):
        slope = math.degrees(arctan2(0.36, 0.5))
        size = (0.62 * depth + 0.5, length + 0.7, 0.12)
        at = (back + side * (0.25 * depth + 0.16), 0, height + 0.18 * depth + 0.0)
        thing.box(roof, at, size, (0, side * slope, 0))
    thing.stand(BRICK, back - 0.6, 0.3 * length, height + 0.2 * depth, (0.6, 0.6, 1.4))
    thing.rod(
        STEEL, (0.42, -0.5 * length - 0.3, height - 0.08), 0.07, length + 0.6, turn_deg=(-90, 0, 0)
    )
    thing.rod(STEEL, (0.06, 0.47 * length, 0), 0.045, height - 0.1)
    for share in (-0.34, -0.1, 0.36):
        _add_window(thing, share * length)
    leaf, shift = door(random), np.array((0.02, 0.14 * length, 0.0))
    for material, parts in leaf.parts.items():
        moved = [(corners + shift, uv, normals) for corners, uv, normals in parts]
        thing.parts[material] += moved
    thing.stand(CONCRETE, 0.4, 0.14 * length, 0, (0.8, 1.5, 0.05))
    return thing


def _add_window(thing: Thing, y: float) -> None:
    """Window in the plane x = 0 with a lintel and a sill."""
    thing.box(GLASS, (0, y, 1.55), (0.04, 1.28, 1.18))
    thing.box(CONCRETE, (0.02, y, 2.24), (0.08, 1.7, 0.16))
    thing.box(CONCRETE, (0.06, y, 0.9), (0.2, 1.6, 0.08))
    for dy, wide in ((-0.65, 0.07), (0.0, 0.05), (0.65, 0.07)):
        thing.box(WHITE, (0.02, y + dy, 1.55), (0.07, wide, 1.26))
    for z in (0.96, 1.8, 2.15):
        thing.box(WHITE, (0.02, y, z), (0.06, 1.3, 0.06))


def street_lamp(height: float = 4.5) -> Thing:
    """Lamp on a post with an arm."""
    thing = Thing()
    thing.lathe(
        STEEL, (0, 0, 0), [(0.09, 0), (0.085, 0.7), (0.055, 0.75), (0.04, height), (0, height)]
    )
    thing.rod(STEEL, (0, 0, height - 0.05), 0.03, 0.9, turn_deg=(0, 80, 0))
    thing.box(DARK, (0.95, 0, height + 0.1), (0.55, 0.24, 0.1), (0, -8, 0))
    thing.box(WHITE, (0.95, 0, height + 0.045), (0.45, 0.18, 0.02), (0, -8, 0))
    return thing


def tyres(random: Random, count: float = 4) -> Thing:
    """Pile of tyres."""
    thing = Thing()
    for number in range(round(count)):
        x, y = random.uniform(-0.04, 0.04, 2).tolist()
        outer = [(0.18, 0.0), (0.27, 0.0), (0.31, 0.04), (0.31, 0.15), (0.27, 0.19), (0.18, 0.19)]
        thing.lathe(RUBBER, (x, y, 0.195 * number), [*outer, (0.17, 0.1), (0.18, 0.0)], sectors=20)
    return thing


def barrier(length: float = 2.0) -> Thing:
    """Barrier of concrete along y."""
    thing = Thing()
    half = [(0.28, 0), (0.28, 0.1), (0.14, 0.3), (0.09, 0.8)]
    outline = [*half, *((-x, z) for x, z in reversed(half))]
    thing.extrude(CONCRETE, (0, 0, 0), outline, length)
    for y in (-0.3, 0.3):
        thing.box(YELLOW, (0, y * length, 0.72), (0.24, 0.18 * length, 0.1))
    return thing


def concrete_pipe(length: float = 1.6, radius: float = 0.45) -> Thing:
    """Pipe of a sewer that lies along y."""
    thing = Thing()
    wall = [
        (0.8 * radius, 0),
        (radius, 0),
        (radius, length),
        (0.8 * radius, length),
        (0.8 * radius, 0),
    ]
    at = (0.0, -0.5 * length, radius)
    thing.lathe(CONCRETE, at, wall, turn_deg=(-90, 0, 0), sectors=24)
    for side in (-1, 1):
        thing.extrude(
            PLANKS, (side * 0.8 * radius, 0, 0), [(-0.12, 0), (0.12, 0), (0, 0.14)], 0.8 * length
        )
    return thing


def bricks(random: Random, spread: float = 0.5, count: float = 40) -> Thing:
    """Heap of bricks and lumps of concrete."""
    thing = Thing()
    for number in range(round(count)):
        out, angle = spread * float(random.random()) ** 0.6, float(random.uniform(0, 360))
        turn = (*random.uniform(-30, 30, 2).tolist(), float(random.uniform(0, 180)))
        z = 0.03 + 0.34 * max(0.0, spread - out) * float(random.random())
        if number % 6:
            thing.box(
                paint(196, 110, 88, "plaster"), (*_polar(out, angle), z), (0.24, 0.115, 0.071), turn
            )
        else:
            size = tuple(random.uniform(0.1, 0.3, 3).tolist())
            thing.box(CONCRETE, (*_polar(out, angle), z), size, turn)
    return thing


def rock(random: Random, size: float = 0.5) -> Thing:
    """Boulder."""
    thing = Thing()
    stone = paint(214, 208, 198, "concrete", tile_m=1.2)
    for _ in range(3):
        x, y = random.uniform(-0.2 * size, 0.2 * size, 2).tolist()
        thing.ball(stone, (x, y, 0.3 * size), size * float(random.uniform(0.4, 0.6)), 0.75)
    return thing


def bench() -> Thing:
    """Bench of boards along y."""
    thing = Thing()
    for x in (-0.15, 0.0, 0.15):
        thing.box(PLANKS, (x, 0, 0.45), (0.12, 1.7, 0.035))
    for z in (0.62, 0.78):
        thing.box(PLANKS, (-0.25 - 0.1 * (z - 0.6), 0, z), (0.035, 1.7, 0.12), (0, -10, 0))
    for y in (-0.65, 0.65):
        thing.box(STEEL, (0, y, 0.415), (0.46, 0.06, 0.03))
        thing.box(STEEL, (-0.24, y, 0.63), (0.03, 0.06, 0.45), (0, -10, 0))
        for x in (-0.18, 0.18):
            thing.stand(STEEL, x, y, 0, (0.05, 0.06, 0.4))
    return thing


def dustbin(random: Random) -> Thing:
    """Wheeled bin with a lid."""
    thing = Thing()
    colours = ((44, 92, 60), (60, 62, 66), (42, 74, 130), (176, 140, 40))
    body = paint(*colours[int(random.integers(4))], "plaster", tile_m=0.6)
    outline = [(-0.25, 0.06), (0.22, 0.06), (0.3, 0.95), (-0.28, 0.95)]
    thing.extrude(body, (0, 0, 0), outline, 0.55)
    thing.extrude(DARK, (0, 0, 0.95), [(-0.34, 0), (0.33, 0), (0.28, 0.06), (-0.26, 0.09)], 0.6)
    for side in (-1, 1):
        _add_wheel(thing, (-0.26, side * 0.24, 0.1), 0.1, 0.05)
    return thing


def shed(random: Random) -> Thing:
    """Shed of boards with a flat roof and a door."""
    thing = Thing()
    thing.stand(PLANKS, -1.0, 0, 0, (2.0, 3.0, 2.1))
    thing.box(paint(120, 124, 128, "corrugated"), (-1.0, 0, 2.2), (2.5, 3.5, 0.1), (0, 6, 0))
    thing.stand(paint(90, 110, 96, "wood"), 0.0, 0.6, 0.05, (0.06, 0.9, 1.9))
    thing.box(CHROME, (0.04, 0.25, 1.0), (0.05, 0.03, 0.14))
    thing.box(GLASS, (0.0, -0.8, 1.4), (0.05, 0.8, 0.6))
    for z in (1.1, 1.7):
        thing.box(WHITE, (0.02, -0.8, z), (0.06, 0.86, 0.05))
    return thing


def drum(radius: float = 0.55) -> Thing:
    """Drum of a cable, on its rims, its axis along y."""
    thing, lie = Thing(), (-90.0, 0.0, 0.0)
    for y in (-0.35, 0.29):
        thing.rod(PLANKS, (0, y, radius), radius, 0.06, turn_deg=lie, sectors=24)
    thing.rod(RUBBER, (0, -0.29, radius), 0.7 * radius, 0.58, turn_deg=lie, sectors=24)
    for turn in range(9):
        coil = [(0.7 * radius, 0), (0.74 * radius, 0.025), (0.7 * radius, 0.05)]
        thing.lathe(DARK, (0, -0.26 + 0.06 * turn, radius), coil, turn_deg=lie, sectors=24)
    return thing


def post_sign(red: int, green: int, blue: int) -> Thing:
    """Round traffic sign on a post."""
    thing, ahead = Thing(), (0.0, 90.0, 0.0)
    thing.rod(STEEL, (0, 0, 0), 0.03, 2.2)
    thing.rod(paint(red, green, blue), (0.03, 0, 1.95), 0.3, 0.015, turn_deg=ahead, sectors=24)
    thing.rod(WHITE, (0.045, 0, 1.95), 0.2, 0.004, turn_deg=ahead, sectors=24)
    thing.box(BLACK, (0.052, 0, 1.95), (0.004, 0.07, 0.22))
    return thing


def dummy(random: Random) -> Thing:
    """Person of cloth who lies on the back, head towards +x."""
    thing = Thing()
    shirt = choose(random, ORANGE, paint(60, 96, 150, "felt"), paint(196, 60, 60, "felt"))
    trousers, skin = paint(54, 66, 96, "felt"), paint(224, 176, 146)
    thing.box(shirt, (0.15, 0, 0.13), (0.55, 0.38, 0.2))
    thing.ball(skin, (0.6, 0, 0.12), 0.115)
    thing.ball(paint(66, 48, 34), (0.64, 0, 0.12), 0.108)
    for side in (-1, 1):
        lean = float(random.uniform(4, 16)) * side
        thing.rod(trousers, (-0.1, 0.1 * side, 0.1), 0.085, 0.75, turn_deg=(0, -90, -lean))
        thing.box(BLACK, (-0.88, 0.1 * side + 0.013 * lean, 0.12), (0.1, 0.1, 0.2))
        thing.rod(
            shirt, (0.36, 0.18 * side, 0.1), 0.055, 0.34, turn_deg=(-90 * side, 0, -20 * side)
        )
        thing.ball(skin, (0.25, 0.6 * side, 0.1), 0.05)
    return thing


def rack(random: Random, length: float = 3.6, levels: int = 3) -> Thing:
    """Rack of a warehouse along y, with pallets' loads, drums and crates on its boards."""
    thing, depth = Thing(), 0.95
    blue, orange = paint(36, 72, 146), paint(222, 104, 30)
    height = 0.85 * levels + 0.4
    for y in (-0.5 * length, 0.0, 0.5 * length):
        for x in (-0.5 * depth + 0.04, 0.5 * depth - 0.04):
            thing.stand(blue, x, y, 0, (0.08, 0.08, height))
        for step in range(2 * levels):
            tilt = (0.0, 40.0 if step % 2 else -40.0, 0.0)
            thing.box(blue, (0, y, 0.3 + 0.42 * step), (1.1, 0.03, 0.03), tilt)
    for level in range(levels):
        z = 0.12 + 0.85 * level
        for x in (-0.5 * depth + 0.04, 0.5 * depth - 0.04):
            thing.box(orange, (x, 0, z), (0.05, length, 0.1))
        thing.box(PLANKS, (0, 0, z + 0.06), (depth - 0.02, length - 0.1, 0.03))
        at = -0.5 * length + 0.1
        while at < 0.5 * length - 0.55:
            at += _load(thing, random, at, z + 0.075) + 0.06
    return thing


def _load(thing: Thing, random: Random, at: float, z: float) -> float:
    """Put something on a board from `at` on; its length."""
    kind, bulk = (
        int(random.integers(4)),
        random.uniform((0.4, 0.35, 0.25), (0.7, 0.55, 0.6)).tolist(),
    )
    deep, length, high = map(float, bulk)
    y = at + 0.5 * length
    if kind < 2:
        thing.stand(CARDBOARD, 0, y, z, (deep, length, high))
        thing.box(WHITE, (0.5 * deep, y, z + 0.5 * high), (0.006, 0.15, 0.1))
    elif kind == 2:
        radius = 0.5 * length
        colour = choose(
            random, paint(40, 86, 150, "plaster"), YELLOW, paint(180, 50, 40, "plaster")
        )
        thing.rod(colour, (0, y, z), radius, min(0.6, 2.4 * radius), sectors=12)
        thing.rod(BLACK, (0, y, z + 0.02), 0.6 * radius, min(0.6, 2.4 * radius) + 0.01, sectors=8)
    else:
        crate = choose(random, paint(60, 110, 70, "felt"), paint(180, 60, 48, "felt"), PLANKS)
        for layer in range(2):
            thing.stand(crate, 0, y, z + 0.29 * layer, (deep, length, 0.27))
            thing.box(BLACK, (0.5 * deep, y, z + 0.29 * layer + 0.18), (0.01, 0.16, 0.05))
    return length


def forklift() -> Thing:
    """Fork-lift truck."""
    thing = Thing()
    thing.extrude(
        YELLOW, (0, 0, 0), [(-1.1, 0.25), (0.5, 0.25), (0.5, 0.7), (-0.3, 0.8), (-1.1, 1.0)], 1.0
    )
    thing.stand(DARK, -0.9, 0, 0.35, (0.5, 1.04, 0.5))
    thing.box(BLACK, (-0.25, 0, 0.88), (0.5, 0.5, 0.14))
    thing.box(BLACK, (-0.5, 0, 1.15), (0.12, 0.5, 0.5), (0, -10, 0))
    for x, y in ((-0.95, -0.45), (-0.95, 0.45), (0.42, -0.45), (0.42, 0.45)):
        thing.stand(DARK, x, y, 0.7, (0.06, 0.06, 1.4))
    thing.box(DARK, (-0.26, 0, 2.1), (1.45, 1.0, 0.06))
    for y in (-0.3, 0.3):
        thing.stand(STEEL, 0.66, y, 0.1, (0.12, 0.1, 2.1))
        thing.box(STEEL, (1.25, 0.8 * y, 0.12), (1.1, 0.12, 0.05))
    for z in (0.3, 0.7, 1.2, 2.1):
        thing.box(STEEL, (0.68, 0, z), (0.08, 0.7, 0.08))
    thing.rod(DARK, (0.2, 0, 1.0), 0.16, 0.03, turn_deg=(0, -40, 0))
    for x, radius in ((0.35, 0.3), (-0.85, 0.24)):
        for side in (-1, 1):
            _add_wheel(thing, (x, 0.46 * side, radius), radius, 0.18)
    return thing


def banner(text_colour: Material, width: float = 2.0) -> Thing:
    """Banner on a wall: stripes of a colour."""
    thing = Thing()
    thing.box(WHITE, (-0.01, 0, 0), (0.04, width, 0.5))
    for stripe in range(5):
        thing.box(
            text_colour, (0, 0.18 * width * (stripe - 2), 0), (0.036, 0.09 * width, 0.5), (18, 0, 0)
        )
    return thing
