"""Things of rooms: furniture, devices, fittings; sizes in metres, colours from the random numbers.

Each function returns one `Thing`, whose front is +x.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.elementary import cos, sin
from catoptra_server.world.scenery.things import Thing, paint, picture, shine
from catoptra_server.world.world_description import Material

Random = np.random.Generator

STEEL = paint(150, 154, 160, "metal")
DARK = paint(52, 54, 60, "felt")
BLACK = paint(30, 31, 34, "felt")
WHITE = paint(232, 232, 228, "plaster")
IVORY = paint(226, 220, 204, "plaster")
WOOD = paint(255, 250, 244, "wood")
OAK = paint(214, 190, 160, "wood")
GLASS = paint(54, 70, 82, gloss=(0.05, 0.03))
RUBBER = paint(40, 40, 42, "felt")
CARDBOARD = paint(255, 255, 255, "cardboard")
CHROME = paint(196, 200, 206, "metal", gloss=(0.5, 0.15))


def choose(random: Random, *materials: Material) -> Material:
    """One of some materials."""
    return materials[int(random.integers(len(materials)))]


def cloth(random: Random) -> Material:
    """Cloth of a chair, a bag or a curtain."""
    colours = ((46, 74, 128), (58, 58, 66), (140, 52, 48), (44, 104, 96), (196, 130, 48))
    return paint(*colours[int(random.integers(len(colours)))], "felt", tile_m=0.5)


def table(length: float = 1.6, depth: float = 0.75, height: float = 0.74) -> Thing:
    """Table, its long side along y, with a frame of steel."""
    thing = Thing()
    thing.box(WOOD, (0, 0, height - 0.015), (depth, length, 0.03))
    thing.box(
        paint(120, 92, 64, "wood"), (0, 0, height - 0.04), (depth - 0.02, length - 0.02, 0.02)
    )
    for x in (-0.5 * depth + 0.06, 0.5 * depth - 0.06):
        for y in (-0.5 * length + 0.06, 0.5 * length - 0.06):
            thing.stand(STEEL, x, y, 0.0, (0.05, 0.05, height - 0.05))
        thing.box(STEEL, (x, 0, height - 0.08), (0.03, length - 0.17, 0.05))
    thing.box(STEEL, (-0.5 * depth + 0.06, 0, 0.25), (0.02, length - 0.17, 0.3))
    return thing


def desk_cabinet(random: Random) -> Thing:
    """Cabinet of drawers below a desk."""
    thing = Thing()
    body = choose(random, WHITE, paint(120, 126, 134, "plaster"), OAK)
    thing.stand(body, 0, 0, 0.04, (0.55, 0.42, 0.56))
    for z in (0.13, 0.3, 0.47):
        thing.box(body, (0.28, 0, z), (0.015, 0.39, 0.15))
        thing.box(CHROME, (0.298, 0, z + 0.04), (0.02, 0.14, 0.012))
    for x, y in ((-0.22, -0.16), (-0.22, 0.16), (0.22, -0.16), (0.22, 0.16)):
        thing.rod(RUBBER, (x, y, 0), 0.02, 0.045)
    return thing


def office_chair(random: Random) -> Thing:
    """Chair on five castors."""
    thing, cover = Thing(), cloth(random)
    for leg in range(5):
        angle = 72.0 * leg + float(random.uniform(0, 72))
        x, y = cos(math.radians(angle)), sin(math.radians(angle))
        thing.box(BLACK, (0.15 * x, 0.15 * y, 0.085), (0.3, 0.04, 0.03), (0, 0, angle))
        thing.rod(RUBBER, (0.29 * x, 0.29 * y - 0.015, 0.035), 0.035, 0.04, turn_deg=(-90, 0, 0))
    thing.rod(CHROME, (0, 0, 0.09), 0.03, 0.33)
    thing.box(cover, (0, 0, 0.46), (0.47, 0.47, 0.07))
    thing.box(BLACK, (0, 0, 0.415), (0.42, 0.42, 0.03))
    thing.box(BLACK, (-0.24, 0, 0.58), (0.03, 0.07, 0.36), (0, -8, 0))
    thing.box(cover, (-0.25, 0, 0.8), (0.06, 0.43, 0.48), (0, -8, 0))
    for y in (-0.27, 0.27):
        thing.box(BLACK, (0, y, 0.66), (0.26, 0.05, 0.03))
        thing.box(BLACK, (-0.06, y, 0.55), (0.04, 0.03, 0.22))
    return thing


def stool(random: Random) -> Thing:
    """Stool of wood with four legs."""
    thing, height = Thing(), 0.46
    thing.lathe(
        choose(random, OAK, WOOD), (0, 0, height), [(0, -0.03), (0.17, -0.03), (0.17, 0), (0, 0)]
    )
    for x in (-0.1, 0.1):
        for y in (-0.1, 0.1):
            thing.rod(
                OAK, (1.35 * x, 1.35 * y, 0), 0.016, height - 0.03, turn_deg=(60 * y, -60 * x, 0)
            )
    return thing


def monitor(random: Random, width: float = 0.54) -> Thing:
    """Monitor on its foot, which shows a program."""
    thing, height = Thing(), 0.6 * width
    thing.stand(BLACK, -0.02, 0, 0.0, (0.2, 0.26, 0.015))
    thing.stand(BLACK, -0.05, 0, 0.015, (0.04, 0.05, 0.2))
    thing.box(BLACK, (0, 0, 0.14 + 0.5 * height), (0.04, width, height))
    column, row = random.integers(0, 2, 2).tolist()
    cell = (0.5 * column, 0.5 * row, 0.5 * column + 0.5, 0.5 * row + 0.5)
    size = (0.004, width - 0.03, height - 0.03)
    thing.box(shine(255, 255, 255, "screens"), (0.021, 0, 0.14 + 0.5 * height), size, cell=cell)
    return thing


def keyboard() -> Thing:
    """Keyboard with rows of keys, and a mouse."""
    thing = Thing()
    thing.stand(BLACK, 0, 0, 0, (0.15, 0.44, 0.015))
    for row in range(4):
        thing.stand(paint(84, 86, 92), -0.052 + 0.035 * row, 0, 0.015, (0.027, 0.42, 0.008))
    thing.ball(DARK, (0, -0.32, 0.012), 0.035, 0.6)
    return thing


def computer() -> Thing:
    """Tower with a drive and lights."""
    thing = Thing()
    thing.stand(paint(64, 66, 72, "plaster"), 0, 0, 0, (0.44, 0.19, 0.42))
    thing.box(BLACK, (0.222, 0, 0.22), (0.006, 0.17, 0.38))
    for z in (0.33, 0.37):
        thing.box(STEEL, (0.227, 0, z), (0.004, 0.15, 0.025))
    thing.box(paint(90, 220, 140, emission=0.9), (0.227, 0.05, 0.27), (0.004, 0.012, 0.012))
    return thing


def desk_lamp(random: Random) -> Thing:
    """Lamp with a jointed arm."""
    thing = Thing()
    body = choose(random, paint(176, 40, 36), paint(232, 178, 40), paint(44, 96, 150), STEEL)
    thing.lathe(body, (0, 0, 0), [(0, 0), (0.09, 0), (0.085, 0.02), (0.02, 0.03), (0, 0.03)])
    thing.rod(STEEL, (0, 0, 0.02), 0.008, 0.3, turn_deg=(0, -20, 0), sectors=6)
    thing.rod(STEEL, (-0.1, 0, 0.3), 0.008, 0.3, turn_deg=(0, 55, 0), sectors=6)
    shade = [(0.02, 0.08), (0.03, 0.07), (0.075, -0.04)]
    thing.lathe(body, (0.16, 0, 0.46), shade, turn_deg=(0, -30, 0))
    thing.rod(paint(255, 244, 214, emission=1.0), (0.155, 0, 0.44), 0.03, 0.05, sectors=8)
    return thing


def shelf(random: Random, width: float = 1.0, height: float = 2.0, rows: int = 5) -> Thing:
    """Shelf with rows of books, some folders and boxes."""
    thing, depth, frame = Thing(), 0.32, choose(random, OAK, WOOD, WHITE)
    for y in (-0.5 * width + 0.0125, 0.5 * width - 0.0125):
        thing.stand(frame, 0, y, 0, (depth, 0.025, height))
    thing.box(frame, (-0.5 * depth + 0.005, 0, 0.5 * height), (0.01, width - 0.05, height - 0.01))
    step = (height - 0.1) / rows
    for row in range(rows + 1):
        z = 0.06 + step * row
        thing.box(frame, (0.005, 0, z), (depth - 0.01, width - 0.05, 0.025))
        if row < rows:
            _fill_shelf(thing, random, width - 0.06, z + 0.0125, step - 0.06)
    return thing


def _fill_shelf(thing: Thing, random: Random, width: float, z: float, height: float) -> None:
    """Fill one board from the left: books, and what else lies around."""
    at = 0.5 * width
    while at > -0.5 * width + 0.16:
        kind, room = int(random.integers(5)), at + 0.5 * width
        if kind < 3:
            length = min(float(random.uniform(0.25, 0.5)), room)
            left, row = float(random.uniform(0.0, 0.4)), 0.5 * int(random.integers(2))
            cell = (left, row + 0.1, left + 0.9 * length, row + 0.495)
            size = (0.2, length, min(0.27, height))
            thing.box(
                picture("books"), (0.0, at - 0.5 * length, z + 0.5 * size[2]), size, cell=cell
            )
        elif kind == 3:
            length = min(0.3, room)
            for folder in range(int(length / 0.075)):
                spine = choose(
                    random, BLACK, paint(38, 66, 128, "felt"), paint(170, 52, 44, "felt")
                )
                y = at - 0.0375 - 0.075 * folder
                thing.stand(spine, 0.01, y, z, (0.24, 0.07, min(0.3, height)))
                thing.box(WHITE, (0.132, y, z + 0.17), (0.004, 0.045, 0.1))
        else:
            length = min(float(random.uniform(0.2, 0.34)), room)
            thing.stand(CARDBOARD, 0, at - 0.5 * length, z, (0.24, length - 0.02, min(0.2, height)))
        at -= length + 0.03


def cupboard(random: Random, width: float = 1.0, height: float = 1.95) -> Thing:
    """Cupboard of sheet steel with two doors, louvres and handles."""
    thing, depth = Thing(), 0.45
    colours = ((136, 144, 154), (104, 124, 146), (186, 184, 174))
    body = paint(*colours[int(random.integers(3))], "plaster", tile_m=1.0)
    thing.stand(body, 0, 0, 0.06, (depth, width, height - 0.06))
    thing.stand(DARK, -0.01, 0, 0, (depth - 0.06, width - 0.04, 0.06))
    for side in (-1, 1):
        y = side * 0.25 * width
        thing.box(
            body,
            (0.5 * depth + 0.008, y, 0.5 * height + 0.03),
            (0.016, 0.5 * width - 0.02, height - 0.12),
        )
        for slot in range(5):
            thing.box(
                DARK,
                (0.5 * depth + 0.017, y, height - 0.2 - 0.035 * slot),
                (0.004, 0.26 * width, 0.012),
            )
        thing.box(CHROME, (0.5 * depth + 0.03, side * 0.05, 0.52 * height), (0.03, 0.02, 0.16))
    return thing


def lockers(random: Random, count: int = 4, height: float = 1.8) -> Thing:
    """Row of narrow lockers with numbers."""
    thing, width = Thing(), 0.32
    for number in range(count):
        y = (number - 0.5 * (count - 1)) * width
        body = paint(
            *((72, 98, 132), (142, 150, 158), (166, 108, 58))[number % 3], "plaster", tile_m=1.0
        )
        thing.stand(body, 0, y, 0.05, (0.48, width - 0.006, height))
        thing.box(body, (0.247, y, 0.5 * height + 0.05), (0.014, width - 0.04, height - 0.06))
        for slot in range(4):
            thing.box(BLACK, (0.256, y, height - 0.2 - 0.04 * slot), (0.005, 0.16, 0.014))
        thing.box(WHITE, (0.256, y, height - 0.08), (0.005, 0.07, 0.04))
        thing.rod(CHROME, (0.25, y - 0.1, 0.95), 0.014, 0.03, turn_deg=(0, 90, 0))
    return thing


def cardboard_box(random: Random) -> Thing:
    """Box of cardboard with tape and a label, open at times."""
    thing = Thing()
    x, y, z = random.uniform((0.28, 0.3, 0.22), (0.45, 0.6, 0.42)).tolist()
    thing.stand(CARDBOARD, 0, 0, 0, (x, y, z))
    thing.box(paint(196, 170, 120), (0, 0, z), (0.06, y + 0.004, 0.004))
    thing.box(
        picture("posters"),
        (0.5 * x + 0.001, 0.2 * y, 0.6 * z),
        (0.002, 0.12, 0.09),
        cell=(0, 0.1, 0.25, 0.3),
    )
    if random.random() < 0.4:
        for side in (-1, 1):
            thing.box(
                CARDBOARD,
                (side * (0.5 * x + 0.06), 0, z + 0.05),
                (0.16, y, 0.006),
                (0, 40 * side, 0),
            )
    return thing


def bin_(random: Random) -> Thing:
    """Waste bin with a rim, and paper in it."""
    thing = Thing()
    body = choose(random, DARK, paint(40, 84, 140, "felt"), paint(60, 110, 70, "felt"))
    thing.lathe(
        body,
        (0, 0, 0),
        [
            (0, 0),
            (0.12, 0),
            (0.155, 0.36),
            (0.165, 0.36),
            (0.165, 0.38),
            (0.145, 0.38),
            (0.12, 0.2),
        ],
    )
    for _ in range(2):
        x, y = random.uniform(-0.07, 0.07, 2).tolist()
        thing.ball(WHITE, (x, y, 0.27 + 0.06 * float(random.random())), 0.07, 0.8)
    return thing


def plant(random: Random, height: float = 1.1) -> Thing:
    """Plant in a pot: stems with leaves that hang."""
    thing = Thing()
    pot = choose(random, paint(176, 96, 66, "plaster"), WHITE, paint(80, 86, 96, "plaster"))
    thing.lathe(
        pot,
        (0, 0, 0),
        [(0, 0), (0.13, 0), (0.18, 0.28), (0.2, 0.28), (0.2, 0.32), (0.17, 0.32), (0.165, 0.29)],
    )
    thing.lathe(paint(58, 44, 34, "gravel"), (0, 0, 0.285), [(0.17, 0), (0, 0.01)])
    for _ in range(5):
        lean, turn = float(random.uniform(3, 16)), float(random.uniform(0, 360))
        thing.rod(
            paint(86, 96, 52),
            (0, 0, 0.28),
            0.009,
            0.7 * height,
            turn_deg=(0, lean, turn),
            sectors=5,
        )
    green = paint(*random.integers((150, 200, 130), (220, 255, 180)).tolist(), "leaves")
    reach = 0.3 * height
    thing.leaves(
        green,
        random,
        (0, 0, 0.32 + 0.55 * height),
        (reach, reach, 0.38 * height),
        90,
        0.1 + 0.05 * height,
    )
    return thing


def toolbox(random: Random) -> Thing:
    """Toolbox with a handle."""
    thing = Thing()
    body = choose(random, paint(190, 44, 38, "plaster"), paint(38, 82, 146, "plaster"))
    thing.stand(body, 0, 0, 0, (0.22, 0.44, 0.18))
    thing.extrude(body, (0, 0, 0.18), [(-0.11, 0), (0.11, 0), (0.05, 0.05), (-0.05, 0.05)], 0.44)
    thing.box(BLACK, (0, 0, 0.27), (0.03, 0.2, 0.02))
    for y in (-0.1, 0.1):
        thing.box(BLACK, (0, y, 0.245), (0.025, 0.02, 0.05))
        thing.box(CHROME, (0.113, 1.4 * y, 0.16), (0.008, 0.04, 0.05))
    return thing


def extinguisher() -> Thing:
    """Fire extinguisher."""
    thing, red = Thing(), paint(196, 30, 26, gloss=(0.04, 0.2))
    body = [
        (0, 0),
        (0.075, 0),
        (0.08, 0.02),
        (0.08, 0.36),
        (0.06, 0.42),
        (0.025, 0.45),
        (0.025, 0.48),
        (0, 0.48),
    ]
    thing.lathe(red, (0, 0, 0), body)
    thing.box(WHITE, (0.079, 0, 0.2), (0.006, 0.07, 0.14))
    thing.box(BLACK, (0.03, 0, 0.5), (0.14, 0.03, 0.03))
    thing.rod(BLACK, (0, 0.06, 0.2), 0.012, 0.28, turn_deg=(-6, 0, 0))
    return thing


def sofa(random: Random, width: float = 1.7) -> Thing:
    """Sofa with cushions."""
    thing, cover = Thing(), cloth(random)
    thing.box(cover, (0, 0, 0.25), (0.78, width, 0.26))
    thing.box(cover, (-0.32, 0, 0.55), (0.18, width - 0.02, 0.55), (0, -10, 0))
    for side in (-1, 1):
        thing.box(cover, (0, side * (0.5 * width - 0.07), 0.42), (0.8, 0.16, 0.36))
        thing.box(cover, (0.06, side * 0.21 * width, 0.43), (0.6, 0.42 * width - 0.14, 0.13))
        thing.box(
            cloth(random), (-0.14, side * 0.3 * width, 0.64), (0.12, 0.36, 0.34), (0, -20, 8 * side)
        )
        for x in (-0.3, 0.3):
            thing.rod(OAK, (x, side * (0.5 * width - 0.1), 0), 0.025, 0.13)
    return thing


def radiator(length: float = 1.6) -> Thing:
    """Radiator with ribs, a valve and its pipe."""
    thing, white = Thing(), paint(236, 234, 226)
    ribs = round(length / 0.08)
    for rib in range(ribs):
        y = (rib - 0.5 * (ribs - 1)) * 0.08
        thing.box(white, (0, y, 0.4), (0.1, 0.07, 0.56))
    for z in (0.16, 0.64):
        thing.box(white, (0, 0, z), (0.06, length, 0.05))
    thing.rod(CHROME, (0, 0.5 * length + 0.03, 0), 0.012, 0.2)
    thing.lathe(
        WHITE,
        (0, 0.5 * length, 0.16),
        [(0, 0), (0.025, 0), (0.025, 0.08), (0, 0.08)],
        turn_deg=(-90, 0, 0),
    )
    return thing


def window(width: float, height: float, panes: int = 3) -> Thing:
    """Frame of a window in the plane x = 0, its sill inside; its lower edge at z = 0."""
    thing, frame = Thing(), paint(238, 237, 232)
    for z in (0.03, height - 0.03):
        thing.box(frame, (0, 0, z), (0.07, width, 0.06))
    for pane in range(panes + 1):
        y = (pane / panes - 0.5) * (width - 0.06)
        thing.box(frame, (0, y, 0.5 * height), (0.066, 0.06, height - 0.12))
    thing.box(frame, (0, 0, 0.68 * height), (0.05, width - 0.1, 0.045))
    thing.box(CHROME, (0.05, 0.14, 0.45 * height), (0.03, 0.03, 0.13))
    thing.box(paint(226, 224, 216, "marble"), (0.12, 0, 0.005), (0.3, width + 0.1, 0.03))
    return thing


def blind(width: float, length: float) -> Thing:
    """Roller blind, drawn down by a length from z = 0."""
    thing = Thing()
    thing.rod(STEEL, (0, -0.5 * width, 0), 0.03, width, turn_deg=(-90, 0, 0))
    thing.box(
        paint(214, 196, 160, "felt", tile_m=0.4),
        (0.012, 0, -0.5 * length),
        (0.006, width - 0.04, length),
    )
    thing.box(STEEL, (0.012, 0, -length), (0.02, width - 0.03, 0.025))
    return thing


def door(random: Random, width: float = 0.9, height: float = 2.05) -> Thing:
    """Closed door in its frame, in the plane x = 0."""
    thing = Thing()
    leaf = choose(random, OAK, paint(120, 134, 128, "wood"), paint(176, 112, 68, "wood"))
    thing.stand(leaf, -0.01, 0, 0.005, (0.08, width, height))
    for z in (0.28 * height, 0.74 * height):
        thing.box(leaf, (0.035, 0, z), (0.014, width - 0.26, 0.36 * height))
    frame = paint(206, 202, 192, "wood")
    for side in (-1, 1):
        thing.stand(frame, -0.01, side * (0.5 * width + 0.04), 0, (0.13, 0.08, height + 0.08))
    thing.box(frame, (-0.01, 0, height + 0.045), (0.13, width, 0.08))
    thing.box(CHROME, (0.045, -0.4 * width, 1.0), (0.02, 0.035, 0.2))
    thing.box(CHROME, (0.075, -0.36 * width, 1.04), (0.02, 0.12, 0.02))
    return thing


def poster(random: Random, width: float = 0.6) -> Thing:
    """Poster on a wall, the lower edge at z = 0."""
    column, row = random.integers(0, 2, 2).tolist()
    cell = (0.5 * column, 0.5 * row, 0.5 * column + 0.5, 0.5 * row + 0.5)
    thing, height = Thing(), 1.35 * width
    thing.box(picture("posters"), (-0.011, 0, 0.5 * height), (0.038, width, height), cell=cell)
    return thing


def whiteboard(width: float = 2.4, height: float = 1.2) -> Thing:
    """Whiteboard with a frame and a tray of pens."""
    thing = Thing()
    thing.box(picture("whiteboard"), (-0.005, 0, 0.5 * height), (0.06, width, height))
    for z in (0.0, height):
        thing.box(STEEL, (0.0, 0, z), (0.074, width + 0.04, 0.03))
    for y in (-0.5 * width, 0.5 * width):
        thing.box(STEEL, (0.0, y, 0.5 * height), (0.074, 0.03, height + 0.02))
    thing.box(STEEL, (0.06, 0, -0.03), (0.1, 0.5 * width, 0.02))
    for number, ink in enumerate(((180, 40, 36), (36, 60, 150), (30, 110, 70))):
        thing.box(paint(*ink), (0.07, 0.14 * number - 0.2, -0.012), (0.018, 0.12, 0.018))
    return thing


def clock() -> Thing:
    """Clock on a wall, at ten past ten."""
    thing, flat = Thing(), (0.0, 90.0, 0.0)
    thing.lathe(
        BLACK,
        (0, 0, 0),
        [(0, -0.03), (0.16, -0.03), (0.16, 0.03), (0.15, 0.04), (0.145, 0.03), (0, 0.03)],
        turn_deg=flat,
        sectors=24,
    )
    thing.lathe(
        paint(244, 243, 238), (0.0305, 0, 0), [(0.145, 0.0), (0, 0.002)], turn_deg=flat, sectors=24
    )
    for angle, length in ((60.0, 0.11), (-55.0, 0.075)):
        y, z = -sin(math.radians(angle)), cos(math.radians(angle))
        thing.box(
            BLACK,
            (0.038, 0.5 * length * y, 0.5 * length * z),
            (0.004, 0.012, length),
            (angle, 0, 0),
        )
    return thing


def copier() -> Thing:
    """Copier with trays, a lid and a panel."""
    thing = Thing()
    thing.stand(IVORY, 0, 0, 0.03, (0.6, 0.62, 0.86))
    thing.stand(DARK, 0, 0, 0.89, (0.58, 0.6, 0.06))
    thing.stand(IVORY, -0.05, 0, 0.95, (0.46, 0.56, 0.1))
    for z in (0.16, 0.32, 0.48):
        thing.box(paint(206, 206, 200), (0.304, 0, z), (0.012, 0.56, 0.13))
        thing.box(DARK, (0.312, 0, z + 0.03), (0.008, 0.2, 0.025))
    thing.box(BLACK, (0.3, 0, 0.72), (0.01, 0.5, 0.12))
    thing.box(
        shine(255, 255, 255, "screens"),
        (0.26, -0.2, 1.0),
        (0.1, 0.16, 0.008),
        (0, 25, 0),
        cell=(0, 0, 0.5, 0.5),
    )
    thing.stand(WHITE, 0.36, 0, 0.68, (0.16, 0.3, 0.02))
    return thing


def coat_rack(random: Random) -> Thing:
    """Stand with coats."""
    thing = Thing()
    thing.lathe(BLACK, (0, 0, 0), [(0, 0), (0.2, 0), (0.18, 0.03), (0.02, 0.05)])
    thing.rod(OAK, (0, 0, 0.03), 0.02, 1.7)
    for hook in range(3):
        angle = 120.0 * hook
        x, y = 0.1 * cos(math.radians(angle)), 0.1 * sin(math.radians(angle))
        thing.rod(CHROME, (0, 0, 1.6), 0.01, 0.16, turn_deg=(0, 50, angle), sectors=6)
        coat = [(0, -0.95), (0.16, -0.95), (0.13, -0.3), (0.07, -0.05), (0, 0)]
        thing.lathe(cloth(random), (x, y, 1.62 - 0.03 * hook), coat, is_round=True, sectors=10)
    return thing


def ladder() -> Thing:
    """Step ladder, standing open."""
    thing = Thing()
    for lean in (-14.0, 14.0):
        for y in (-0.2, 0.2):
            thing.box(STEEL, (0.0145 * lean, y, 0.8), (0.06, 0.025, 1.66), (0, -lean, 0))
    for step in range(5):
        z = 0.28 + 0.27 * step
        thing.box(paint(200, 60, 40), (0.24 * (1.6 - z) * 1.06, 0, z), (0.1, 0.38, 0.025))
    thing.box(BLACK, (0, 0, 1.6), (0.14, 0.44, 0.03))
    return thing


def ball(random: Random, radius: float = 0.1) -> Thing:
    """Ball on the floor."""
    thing = Thing()
    thing.ball(
        choose(random, paint(230, 226, 214, "felt"), paint(206, 96, 40, "felt")),
        (0, 0, radius),
        radius,
    )
    return thing


def backpack(random: Random) -> Thing:
    """Backpack that leans."""
    thing, cover = Thing(), cloth(random)
    outline = [(-0.1, 0), (0.1, 0), (0.11, 0.25), (0.06, 0.42), (-0.04, 0.46), (-0.1, 0.4)]
    thing.extrude(cover, (0, 0, 0), outline, 0.3)
    thing.box(BLACK, (0.11, 0, 0.14), (0.06, 0.22, 0.18))
    thing.box(STEEL, (0.142, 0, 0.22), (0.006, 0.18, 0.01))
    return thing


def cup(random: Random) -> Thing:
    """Cup with a handle."""
    thing = Thing()
    colour = choose(random, WHITE, paint(40, 90, 150), paint(200, 70, 50), paint(230, 180, 60))
    thing.lathe(
        colour, (0, 0, 0), [(0, 0), (0.036, 0), (0.042, 0.09), (0.036, 0.09), (0, 0.03)], sectors=10
    )
    thing.box(colour, (0.055, 0, 0.05), (0.03, 0.012, 0.05))
    return thing


def papers(random: Random) -> Thing:
    """Some sheets and a book."""
    thing = Thing()
    for sheet in range(3):
        x, y, turn = random.uniform((-0.06, -0.12, -25), (0.06, 0.12, 25)).tolist()
        thing.box(
            picture("posters"),
            (x, y, 0.002 + 0.004 * sheet),
            (0.297, 0.21, 0.003),
            (0, 0, turn),
            cell=(0, 0, 0.5, 0.5),
        )
    thing.box(cloth(random), (0.02, 0.3, 0.02), (0.24, 0.17, 0.035), (0, 0, 12))
    return thing


def projector() -> Thing:
    """Projector below a ceiling at z = 0."""
    thing = Thing()
    thing.rod(STEEL, (0, 0, -0.4), 0.02, 0.4)
    thing.box(WHITE, (0, 0, -0.46), (0.3, 0.36, 0.12))
    thing.rod(BLACK, (0.15, -0.08, -0.46), 0.035, 0.03, turn_deg=(0, 90, 0))
    for slot in range(6):
        thing.box(DARK, (0.151, 0.03 + 0.02 * slot, -0.46), (0.004, 0.008, 0.08))
    return thing


def pipe(length: float, radius: float = 0.05) -> Thing:
    """Pipe along y with flanges, its axis at z = 0."""
    thing, body = Thing(), paint(180, 176, 166, "plaster", tile_m=0.7)
    thing.rod(body, (0, -0.5 * length, 0), radius, length, turn_deg=(-90, 0, 0), sectors=14)
    for joint in range(1, round(length / 1.4)):
        y = -0.5 * length + 1.4 * joint
        thing.rod(STEEL, (0, y, 0), 1.35 * radius, 0.06, turn_deg=(-90, 0, 0), sectors=14)
        thing.box(DARK, (-0.5 * radius, y + 0.4, 0), (2.5 * radius, 0.03, 2.3 * radius))
    return thing


def sign(red: int, green: int, blue: int, width: float = 0.4) -> Thing:
    """Luminous sign: a running man of boxes, and an arrow."""
    thing = Thing()
    thing.box(paint(red, green, blue, emission=0.6), (0.0, 0, 0), (0.08, width, 0.5 * width))
    white = paint(255, 255, 255, emission=0.7)
    thing.box(
        white, (0.042, 0.2 * width, 0.05 * width), (0.004, 0.05 * width, 0.2 * width), (20, 0, 0)
    )
    thing.box(white, (0.042, -0.15 * width, 0), (0.004, 0.3 * width, 0.05 * width))
    thing.box(white, (0.043, -0.27 * width, 0), (0.004, 0.1 * width, 0.1 * width), (45, 0, 0))
    return thing


def socket() -> Thing:
    """Two sockets on a wall."""
    thing = Thing()
    for y in (-0.045, 0.045):
        thing.box(paint(240, 240, 236), (-0.01, y, 0), (0.044, 0.08, 0.08))
        thing.rod(DARK, (0.012, y, 0), 0.02, 0.002, turn_deg=(0, 90, 0))
    return thing


def trolley(random: Random) -> Thing:
    """Trolley with two boards and tools on it."""
    thing = Thing()
    for z in (0.25, 0.72):
        thing.box(STEEL, (0, 0, z), (0.45, 0.7, 0.025))
        thing.box(STEEL, (0.22, 0, z + 0.03), (0.012, 0.68, 0.05))
    for x in (-0.2, 0.2):
        for y in (-0.33, 0.33):
            thing.rod(DARK, (x, y, 0.08), 0.014, 0.68, sectors=6)
            thing.rod(RUBBER, (x, y - 0.0125, 0.045), 0.045, 0.025, turn_deg=(-90, 0, 0))
    for place in range(5):
        x, y = float(random.uniform(-0.12, 0.12)), 0.13 * place - 0.26
        deep, wide, high = random.uniform((0.06, 0.06, 0.05), (0.16, 0.12, 0.14)).tolist()
        body = choose(random, CARDBOARD, BLACK, paint(190, 60, 44), paint(50, 90, 150))
        thing.stand(body, x, y, 0.733, (deep, wide, high))
    return thing
