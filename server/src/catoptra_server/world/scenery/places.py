"""Worlds by script: where the things of `furniture` and `outdoors` stand.

Places are in the world frame of their file (x ahead, y to the right); heights are positive.
"""

from __future__ import annotations

import math
from functools import partial

from catoptra_protocol.optics.elementary import cos, sin
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.scenery import furniture as f
from catoptra_server.world.scenery import outdoors as o
from catoptra_server.world.scenery.things import Scenery, Thing, paint, shine
from catoptra_server.world.world_description import Material


@dataclass(frozen=True, slots=True)
class Wall:
    """Inner face of a wall, by its middle and where it faces."""

    scenery: Scenery
    x: float
    y: float
    yaw_deg: float

    def put(
        self,
        class_name: str,
        thing: Thing,
        along: float,
        out: float = 0.0,
        z: float = 0.0,
        turn_deg: float = 0.0,
    ) -> None:
        """Place a thing some metres along the wall, to the left for who leans on it, and off it."""
        yaw = math.radians(self.yaw_deg)
        ahead, left = (cos(yaw), sin(yaw)), (sin(yaw), -cos(yaw))
        x = self.x + out * ahead[0] + along * left[0]
        y = self.y + out * ahead[1] + along * left[1]
        self.scenery.place(class_name, thing, x, y, self.yaw_deg + turn_deg, z)

    def build(
        self,
        material: Material,
        length: float,
        height: float,
        openings: tuple[tuple[float, float, float, float], ...] = (),
        skirting_m: float = 0.0,
    ) -> None:
        """Build the wall with openings (along, width, lower and upper edge), from the right."""
        thing, thick, begin = Thing(), 0.24, -0.5 * length
        for along, width, low, high in openings:
            left = along - 0.5 * width
            _fill(thing, material, thick, (begin, left), (0.0, height))
            _fill(thing, material, thick, (left, left + width), (0.0, low))
            _fill(thing, material, thick, (left, left + width), (high, height))
            begin = left + width
        _fill(thing, material, thick, (begin, 0.5 * length), (0.0, height))
        self.put("wall", thing, 0.0)
        if skirting_m:
            board = Thing()
            board.box(f.OAK, (0.007, 0, 0.04), (0.016, skirting_m, 0.1))
            self.put("skirting", board, 0.0)


def _fill(
    thing: Thing,
    material: Material,
    thick: float,
    along: tuple[float, float],
    heights: tuple[float, float],
) -> None:
    """Part of a wall, if it has a size."""
    (left, right), (low, high) = along, heights
    if right > left and high > low:
        at = (-0.5 * thick, 0.5 * (left + right), 0.5 * (low + high))
        thing.box(material, at, (thick, right - left, high - low))


def furnish_desk(wall: Wall, along: float) -> None:
    """Place of work at a wall: desk, computer, chair and what lies around."""
    random = wall.scenery.random
    wall.put("table", f.table(), along, 0.42)
    for side in (-0.3, 0.3)[: int(random.integers(1, 3))]:
        at = along + side + float(random.uniform(-0.05, 0.05))
        wall.put("monitor", f.monitor(random), at, 0.24, 0.74, -25.0 * side)
    wall.put("keyboard", f.keyboard(), along, 0.56, 0.74)
    wall.put("computer", f.computer(), along - 0.62, 0.42)
    wall.put("cabinet", f.desk_cabinet(random), along + 0.48, 0.4)
    wall.put("cup", f.cup(random), along + 0.3, 0.68, 0.74, float(random.uniform(0, 360)))
    wall.put("papers", f.papers(random), along - 0.5, 0.5, 0.74)
    if random.random() < 0.6:
        wall.put("desk_lamp", f.desk_lamp(random), along + 0.68, 0.25, 0.74, -40.0)
    turn = 180.0 + float(random.uniform(-40, 40))
    wall.put("chair", f.office_chair(random), along, float(random.uniform(0.8, 0.95)), 0.0, turn)


def furnish_laboratory(scenery: Scenery) -> None:
    """Room of 10 x 8 m around the field, with three windows, places of work and a library."""
    random, height = scenery.random, 3.1
    scenery.remove(
        *("wall", "ceiling", "lamp", "door", "window", "table", "cabinet", "shelf", "poster")
    )
    scenery.dress(
        {
            "carpet": paint(44, 128, 66, "felt", tile_m=0.7),
            "floor": paint(255, 255, 255, "wood_floor", gloss=(0.03, 0.08)),
            "border": paint(250, 248, 244, "plaster"),
        }
    )
    ivory, blue = paint(250, 242, 222, "plaster"), paint(150, 176, 192, "plaster")
    north, south, left, right = (
        Wall(scenery, 5, 0, 180),
        Wall(scenery, -5, 0, 0),
        Wall(scenery, 0, -4, 90),
        Wall(scenery, 0, 4, -90),
    )
    windows = tuple((along, 2.2, 0.95, 2.6) for along in (-3.1, 0.0, 3.1))
    north.build(ivory, 8.48, height, (), 7.96)
    south.build(ivory, 8.48, height, (), 7.96)
    left.build(ivory, 10.0, height, windows, 9.96)
    right.build(blue, 10.0, height, (), 9.96)
    ceiling = Thing()
    ceiling.box(paint(255, 255, 252, "tiles", tile_m=2.4), (0, 0, height + 0.1), (10.48, 8.48, 0.2))
    scenery.place("ceiling", ceiling, 0, 0)
    for x in (-3.2, 0.0, 3.2):
        for y in (-1.6, 1.6):
            scenery.hang_lamp(x, y, height, (1.4, 0.3), 4.0, drop=0.3)
    for number, (along, width, low, high) in enumerate(windows):
        left.put("window", f.window(width, high - low), along, -0.1, low)
        left.put("radiator", f.radiator(1.6), along, 0.09)
        drawn = float(random.uniform(0.25, 0.6))
        left.put("blind", f.blind(width + 0.1, drawn), along, 0.05 + 0.01 * number, high + 0.06)
    for along in (-1.55, 1.55, 4.6):
        left.put("plant", f.plant(random, float(random.uniform(0.8, 1.3))), along, 0.4)
    for along in (-3.4, -1.5, 0.4, 2.3):
        furnish_desk(right, along)
        right.put("poster", f.poster(random, 0.62), along + 0.5, 0.0, 1.35)
        right.put("socket", f.socket(), along - 0.2, 0.0, 0.95)
    right.put("copier", f.copier(), 3.8, 0.42)
    right.put("pipe", f.pipe(9.9, 0.06), 0.0, 0.12, 2.75)
    right.put("pipe", f.pipe(9.9, 0.035), 0.0, 0.09, 2.55)
    north.put("whiteboard", f.whiteboard(), 0.4, 0.0, 1.0)
    north.put("clock", f.clock(), -1.35, 0.0, 2.3)
    north.put("locker", f.lockers(random, 4), -3.2, 0.22)
    north.put("poster", f.poster(random, 0.7), -1.6, 0.0, 1.15)
    north.put("cupboard", f.cupboard(random), 2.45, 0.2)
    north.put("box", f.cardboard_box(random), 2.4, 0.24, 1.95, 20.0)
    north.put("cupboard", f.cupboard(random), 3.46, 0.2)
    north.put("extinguisher", f.extinguisher(), 1.8, 0.12)
    north.put("trolley", f.trolley(random), 0.4, 0.4)
    north.put("bin", f.bin_(random), -0.6, 0.3)
    north.put("sign", f.sign(20, 130, 70), -2.2, 0.0, 2.5)
    for along in (3.3, 2.25, 1.2):
        south.put("shelf", f.shelf(random), along, 0.155)
        south.put("box", f.cardboard_box(random), along, 0.2, 2.0, float(random.uniform(-9, 9)))
    south.put("sofa", f.sofa(random), -0.45, 0.45)
    south.put("poster", f.poster(random, 0.7), -0.9, 0.0, 1.3)
    south.put("poster", f.poster(random, 0.7), 0.0, 0.0, 1.3)
    south.put("coat_rack", f.coat_rack(random), -1.75, 0.35)
    south.put("door", f.door(random), -2.7)
    south.put("switch", f.socket(), -2.1, 0.0, 1.1)
    south.put("sign", f.sign(20, 130, 70), -2.7, 0.0, 2.4)
    south.put("cupboard", f.cupboard(random, 0.7, 1.2), -3.62, 0.2)
    south.put("plant", f.plant(random, 0.6), -3.62, 0.24, 1.2)
    lawn = Thing()
    lawn.box(shine(200, 220, 190, "grass"), (0, 0, -0.1), (80, 40, 0.2))
    scenery.place("grass", lawn, 0, -24.3, 0, -0.6)
    for x, y, size in ((-7, -13, 4.2), (1.2, -17, 5), (6.5, -12.5, 4), (15, -21, 6), (-17, -22, 6)):
        scenery.place("tree", o.tree(random, size, is_lit=False), x, y, 0, -0.6)
    hedge = Thing()
    hedge.box(shine(150, 170, 120, "leaves"), (0, 0, 0.6), (60, 1.2, 1.2))
    scenery.place("hedge", hedge, 0, -32, 0, -0.6)
    scenery.place("projector", f.projector(), 2.2, 0.0, 0.0, height)
    scenery.spread(
        "box",
        partial(f.cardboard_box, random),
        "-4 -3.4 ~; -4.45 -3.1 ~; 4.3 1 ~; -1.5 -3.5 ~; 3.55 3.3 ~; 1 -3.55 ~",
    )
    scenery.spread("ball", partial(f.ball, random), "-3.5 2.6 0; 4 -1.6 0; 0.7 2.7 0")
    scenery.spread("backpack", partial(f.backpack, random), "-4.3 0.9 30; 2.2 2.6 -70")
    scenery.spread("toolbox", partial(f.toolbox, random), "4.4 -0.4 160; -2.4 3.2 200")
    scenery.spread("stool", partial(f.stool, random), "3.9 -3.3 ~; -2.9 -2.9 ~; 3.7 2.5 ~")
    scenery.place("ladder", f.ladder(), -3.9, -2.2, 75)
    scenery.place("bin", f.bin_(random), -0.6, 3.7)


def furnish_yard(scenery: Scenery) -> None:
    """Yard of a works: a house, sheds, containers and cars around asphalt, trees beyond a fence."""
    random = scenery.random
    scenery.place("house", o.house(random), 9.5, 0.5, 180)
    scenery.place("shed", o.shed(random), -3.0, -10.3, 90)
    scenery.spread(
        "container", partial(o.container, random, 6.0), "1.2 -10.6 92; 7.6 -9.6 118; -10.4 5.2 2"
    )
    scenery.spread(
        "car",
        o.car,
        "-6.4 7 -88 156 28 30; -3.3 7.2 -94 40 78 140; 3.2 7.1 -90 206 206 204; "
        "-8.6 -6.4 30 66 96 82",
    )
    scenery.spread("fence", o.fence, "0 11.5 -90 26; -13.5 -0.5 0 24")
    wall = Thing()
    wall.box(o.BRICK, (0, 0, 0.8), (0.25, 16.0, 1.6))
    wall.box(o.CONCRETE, (0, 0, 1.64), (0.35, 16.1, 0.08))
    scenery.place("wall", wall, -5.5, -12.4, 90)
    scenery.spread("tree", partial(o.tree, random), _TREES)
    scenery.spread(
        "bush",
        partial(o.bush, random),
        "8.7 7.4 0 1.2; 8.9 -5.9 0 1.1; -12.6 9.6 0 1.4; -11.4 10.3 0 1; 5 10.4 0 1.3",
    )
    scenery.spread(
        "barrel",
        partial(o.barrel, random),
        "-8.2 5.1 ~; -8.9 4.8 ~; -8.5 5.8 ~; 6.3 -6.6 ~; 5.8 -7.2 ~; 8.8 4.6 ~",
    )
    scenery.spread("cone", o.cone, "2.3 2 ~; 2.9 0.6 ~; 2.4 -1 ~; -2 3.6 ~; -5.5 -2.6 ~; 4.6 4.6 ~")
    scenery.spread(
        "pallet",
        partial(o.pallet, random),
        "-1 -7 10 2; 0.6 -7.4 -8 3; 3.9 -6.9 30 0; -7.9 1.2 85 1",
    )
    scenery.spread("barrier", o.barrier, "-1.2 5.2 90; 1.2 5.3 88; 6.6 3.1 8")
    scenery.spread("pipe", o.concrete_pipe, "-6.2 -8.9 80; -7.7 -9.1 95")
    scenery.spread("rubble", partial(o.bricks, random, 0.7), "4.9 -4.3 0 46; -8.4 -2 0 30")
    scenery.spread("rock", partial(o.rock, random), "7.6 7.9 0 0.6; -12.4 -6.6 0 0.9; 6 9.6 0 0.7")
    scenery.spread(
        "dustbin", partial(o.dustbin, random), "8.9 -3.7 180; 8.95 -2.95 184; 8.9 5.6 176"
    )
    scenery.place("bench", o.bench(), 8.6, 3.6, 180)
    scenery.place("drum", o.drum(), -3.8, -7.3, 25)
    scenery.place("tyres", o.tyres(random, 4), -5.2, -6.9)
    scenery.place("tyres", o.tyres(random, 2), -4.6, -6.4)
    scenery.place("dummy", o.dummy(random), 4.4, 1.7, 60)
    scenery.place("sign", o.post_sign(190, 30, 30), 6.5, 9.0, -140)
    scenery.place("ladder", f.ladder(), 8.4, -4.9, 100)
    scenery.place("trolley", f.trolley(random), -1.6, -9.0, 70)
    scenery.spread("lamp", o.street_lamp, "-1 9.4 -90; -11.6 -3.9 0; 7.9 -7.6 160")


# x, y, yaw and height of each tree around.
_TREES = (
    "-16.5 -9 ~ 7; -17 3 ~ 8; -15.5 12 ~ 6.5; -6 19.5 ~ 7.5; 2.5 15 ~ 6; 10.5 13 ~ 8; 13 -11 ~ 7; "
    "4 -16.5 ~ 7.5; -9.5 -16 ~ 6.5; 20 4 ~ 9"
)


def furnish_offices(scenery: Scenery) -> None:
    """Offices in the rooms of the mapping world, whose inner walls stay where they are."""
    random, height = scenery.random, 2.6
    scenery.remove("desk", "cabinet", "lamp", "ceiling", "copier", "bin", "bench", "sign")
    scenery.items = [item for item in scenery.items if item.name not in ("Left", "Right")]
    white = paint(250, 244, 228, "plaster")
    scenery.dress(
        {
            "wall": white,
            **dict.fromkeys(("OuterLeft", "OuterRight"), paint(206, 220, 206, "plaster")),
            **dict.fromkeys(("InnerLeftWest", "InnerRightEast"), paint(236, 214, 176, "plaster")),
            **dict.fromkeys(("CrossWestOuter", "CrossEastOuter"), o.BRICK),
            **dict.fromkeys(("RoomLeft", "RoomRight"), paint(216, 224, 232, "plaster")),
            "pillar": paint(214, 208, 196, "concrete"),
            "Floor": paint(174, 166, 150, "felt", tile_m=0.8),
            "floor": paint(132, 144, 148, "tiles", tile_m=1.6),
        }
    )
    ceiling = Thing()
    ceiling.box(paint(255, 255, 252, "tiles", tile_m=2.4), (0, 0, height + 0.1), (20.4, 14.6, 0.2))
    scenery.place("ceiling", ceiling, 0, 0)
    left, right = Wall(scenery, 0, -7, 90), Wall(scenery, 0, 7, -90)
    rooms = ((-7.5, -2.5, 2.5, 7.5), (-7.25, -2.0, 2.75, 7.5))
    edges = ((-10.0, -4.94, 0.06, 5.06), (-10.0, -4.44, 0.56, 5.06))
    ends = ((-5.06, -0.06, 4.94, 10.0), (-4.56, 0.44, 4.94, 10.0))
    for side, outer in enumerate((left, right)):
        sign = 1.0 if side == 0 else -1.0
        openings = tuple((along, 2.2, 1.0, 2.25) for along in sorted(sign * x for x in rooms[side]))
        outer.build(white, 20.0, height, openings)
        for number, x in enumerate(rooms[side]):
            outer.put("window", f.window(2.2, 1.25), sign * x, -0.1, 1.0)
            outer.put("radiator", f.radiator(0.9), sign * x + 1.5, 0.07)
            middle = -sign * 5.5
            _furnish_office(
                Wall(scenery, x, outer.y, outer.yaw_deg),
                Wall(scenery, edges[side][number], middle, 0),
                Wall(scenery, ends[side][number], middle, 180),
                sign,
            )
            scenery.hang_lamp(x, middle, height, (1.2, 0.3), 3.4)
    for x, yaw in ((-10.0, 0.0), (10.0, 180.0)):
        for y in (-1.0, 1.0):
            wall = Wall(scenery, x, y, yaw)
            furnish_desk(wall, 0.0)
            wall.put("poster", f.poster(random), 0.0, 0.0, 1.5)
            scenery.hang_lamp(0.75 * x, y, height, (1.2, 0.3), 3.0)
            wall.put(
                "shelf",
                f.shelf(random, 0.9),
                math.copysign(0.77, y * x),
                3.4,
                0.0,
                math.copysign(90.0, -y * x),
            )
    _furnish_corridors(scenery, height)


def _furnish_office(desk: Wall, low: Wall, high: Wall, sign: float) -> None:
    """Office of one person, with its desk below the window."""
    random = desk.scenery.random
    furnish_desk(desk, float(random.uniform(-0.5, 0.1)))
    low.put("shelf", f.shelf(random, 1.0, 1.9), 0.2, 0.155)
    low.put("poster", f.poster(random), -0.95, 0.0, 1.2)
    low.put("bin", f.bin_(random), sign * -0.75, 0.25)
    if random.random() < 0.5:
        high.put("whiteboard", f.whiteboard(1.6, 1.0), 0.0, 0.0, 1.0)
        high.put("box", f.cardboard_box(random), 0.2, 0.35, 0.0, 15.0)
    else:
        high.put("cupboard", f.cupboard(random), 0.1, 0.2)
        high.put("clock", f.clock(), -0.8, 0.0, 2.0)
    high.put("plant", f.plant(random, float(random.uniform(0.6, 1.0))), sign * 1.1, 0.3)
    if random.random() < 0.6:
        high.put("backpack", f.backpack(random), sign * -1.05, 0.3)


def _furnish_corridors(scenery: Scenery, height: float) -> None:
    """Corridors, their crossings and the common room in the middle."""
    random = scenery.random
    for x in (-8.0, -4.0, 0.0, 4.0, 8.0):
        for y in (-3.0, 3.0):
            scenery.hang_lamp(x, y, height, (1.2, 0.24), 2.3)
    for y in (-2.2, 2.2):
        scenery.place("pipe", f.pipe(19.8, 0.05), 0.0, y, 90.0, height - 0.14)
    leaf = Thing()
    leaf.stand(paint(150, 172, 160, "wood"), 0.0, 0.45, 0.01, (0.04, 0.88, 2.06))
    leaf.box(f.CHROME, (0.05, 0.8, 1.02), (0.06, 0.03, 0.12))
    for x in (-7.5, -2.5, 2.5, 7.5):
        scenery.place("door", leaf, x + 0.49, -4.1, 0.0)
    for x in (-7.0, -2.0, 3.0, 7.0):
        scenery.place("door", leaf, x - 0.49, 4.1, 180.0)
    outer, inner = Wall(scenery, 0, -3.94, 90), Wall(scenery, 0, -2.06, -90)
    far, near = Wall(scenery, 0, 3.94, -90), Wall(scenery, 0, 2.06, 90)
    for wall, places in (
        (outer, (-5.2, 0.9, 5.6)),
        (inner, (-1.6, 6.2)),
        (far, (-4.0, 1.6, 5.2)),
        (near, (-1.4, 0.6, 9.0)),
    ):
        for along in places:
            wall.put("poster", f.poster(random), along, 0.0, 1.15)
    outer.put("copier", f.copier(), -0.9, 0.3)
    outer.put("locker", f.lockers(random, 4), 5.2, 0.22)
    outer.put("extinguisher", f.extinguisher(), -1.6, 0.09, 0.5)
    far.put("bench", o.bench(), -0.3, 0.36)
    far.put("extinguisher", f.extinguisher(), 4.0, 0.09, 0.5)
    far.put("cupboard", f.cupboard(random), 8.6, 0.2)
    near.put("bin", f.bin_(random), -6.3, 0.25)
    near.put("trolley", f.trolley(random), 6.0, 0.3, 0.0, 90.0)
    inner.put("plant", f.plant(random), -5.9, 0.3)
    for x, y, yaw in ((-9.94, -3.0, 0), (9.94, 3.0, 180), (9.94, -3.0, 180), (-9.94, 3.0, 0)):
        scenery.place("sign", f.sign(20, 140, 76), x, y, yaw, 2.25)
        scenery.place("plant", f.plant(random), x * 0.955, y - math.copysign(0.5, y), 0.0)
    west, east, south = (
        Wall(scenery, -2.94, 0, 0),
        Wall(scenery, 2.94, 0, 180),
        Wall(scenery, 0, -1.94, 90),
    )
    west.put("sofa", f.sofa(random), 0.3, 0.42)
    west.put("poster", f.poster(random, 0.7), 0.3, 0.0, 1.1)
    west.put("plant", f.plant(random, 1.2), 1.4, 0.35)
    east.put("whiteboard", f.whiteboard(2.0, 1.1), 0.6, 0.0, 0.95)
    south.put("cupboard", f.cupboard(random, 1.2, 0.9), -0.5, 0.2)
    south.put("cup", f.cup(random), -0.3, 0.25, 0.9)
    south.put("cup", f.cup(random), -0.6, 0.3, 0.9)
    south.put("clock", f.clock(), -0.5, 0.0, 1.9)
    scenery.place("stool", f.stool(random), 2.6, -1.3)
    scenery.place("ball", f.ball(random), -1.9, -1.4)
    scenery.hang_lamp(0.0, 0.0, height, (1.4, 0.3), 4.0)


def furnish_warehouse(scenery: Scenery) -> None:
    """Hall with racks, pallets, a fork-lift truck and what a works has on its walls."""
    random, height = scenery.random, 4.0
    scenery.remove("rack", "box", "pallet", "barrel", "crate", "lamp", "gate")
    scenery.dress(
        {
            "floor": paint(235, 232, 226, "concrete"),
            "line": paint(240, 200, 50, "plaster", tile_m=0.8),
            "West": paint(206, 210, 212, "corrugated"),
            "East": paint(206, 210, 212, "corrugated"),
            "Left": o.BRICK,
            "Right": o.BRICK,
            "ceiling": paint(230, 232, 234, "corrugated", tile_m=2.0),
        }
    )
    west, east, left, right = (
        Wall(scenery, -8, 0, 0),
        Wall(scenery, 8, 0, 180),
        Wall(scenery, 0, -5, 90),
        Wall(scenery, 0, 5, -90),
    )
    for x in (-5.4, -1.8, 1.8, 5.4):
        for y in (-2.2, 2.2):
            scenery.hang_lamp(x, y, height, (1.5, 0.4), 7.0, drop=0.4)
    for along in (-5.6, -1.7, 2.2):
        left.put("rack", o.rack(random), along, 0.55)
    for along in (-5.2, -1.3, 2.6):
        right.put("rack", o.rack(random), along, 0.55)
    gate = Thing()
    for slat in range(13):
        gate.box(paint(70, 104, 150, "metal"), (-0.01, 0, 0.1 + 0.2 * slat), (0.1, 2.6, 0.18))
    for y in (-1.4, 1.4):
        gate.stand(o.YELLOW, 0.0, y, 0, (0.16, 0.2, 2.7))
    west.put("gate", gate, 0.0)
    west.put("sign", f.sign(20, 140, 76), 0.0, 0.0, 3.0)
    west.put("cupboard", f.cupboard(random), 3.6, 0.2)
    west.put("locker", f.lockers(random, 4), -3.4, 0.22)
    west.put("extinguisher", f.extinguisher(), 2.0, 0.09, 0.4)
    east.put("whiteboard", f.whiteboard(2.0, 1.1), -1.2, 0.0, 1.1)
    east.put("door", f.door(random), 1.4)
    east.put("sign", f.sign(20, 140, 76), 1.4, 0.0, 2.4)
    east.put("banner", o.banner(paint(40, 90, 150), 3.0), 0.0, 0.0, 3.2)
    east.put("extinguisher", f.extinguisher(), 2.4, 0.09, 0.4)
    furnish_desk(east, -3.8)
    for x, y in ((-7.6, -1.9), (-7.6, 1.9), (4.6, -1.2), (4.6, 1.2)):
        post = Thing()
        post.rod(o.YELLOW, (0, 0, 0), 0.07, 0.9, sectors=14)
        for z in (0.3, 0.6):
            post.rod(f.BLACK, (0, 0, z), 0.074, 0.12, sectors=14)
        scenery.place("bollard", post, x, y)
    left.put("pipe", f.pipe(15.8, 0.09), 0.0, 0.14, 3.4)
    right.put("pipe", f.pipe(15.8, 0.06), 0.0, 0.1, 3.5)
    scenery.place("forklift", o.forklift(), 4.9, -3.0, 150)
    scenery.spread(
        "pallet",
        partial(o.pallet, random),
        "-6.6 -2.6 4 3; -5.2 -2.5 88 2; -3.2 -2.7 -6 3; 1.2 -2.7 3 1; -6.2 2.6 10 2; "
        "-1.4 2.7 92 3; 0.6 2.5 -5 2; 3.8 2.4 80 0; 7.4 -2.2 -4 1",
    )
    scenery.spread(
        "barrel",
        partial(o.barrel, random),
        "-4.6 2.7 ~; -4 2.5 ~; -4.3 3.2 ~; 3 -2.5 ~; 3.2 -3.2 ~; 7.5 -0.6 ~",
    )
    scenery.spread(
        "box", partial(f.cardboard_box, random), "2.3 2.2 ~; -2.3 -1.9 ~; 5.4 2.6 ~; -3 2.3 ~"
    )
    scenery.spread("cone", o.cone, "1.9 -1.6 0; 6.2 1.6 0; -7.2 1.2 0")
    scenery.place("drum", o.drum(), -1.7, -2.5, 15)
    scenery.place("tyres", o.tyres(random), 2.2, -3.4)
    scenery.place("ladder", f.ladder(), -7.3, 2.8, 100)
    scenery.place("trolley", f.trolley(random), 5.2, 3.3, 15)
    scenery.place("dustbin", o.dustbin(random), 4.4, 4.3, -90)
    scenery.place("toolbox", f.toolbox(random), 5.0, 2.0, 30)
    scenery.place("stool", f.stool(random), 7.4, 2.3)


def furnish_arena(scenery: Scenery) -> None:
    """Rescue arena in the open, among helpers' cars and containers; its ramps stay as they are."""
    random = scenery.random
    ramp = paint(250, 232, 204, "planks")
    ramps = ("continuous_ramp", "crossing_ramp", "inclined_plane", "platform_ramp", "deck", "table")
    scenery.dress(
        {
            "floor": paint(240, 234, 224, "concrete"),
            "Wall": paint(255, 246, 232, "wood", tile_m=1.2),
            "Block": o.CONCRETE,
            "PitWall": o.CONCRETE,
            "kerb": paint(240, 200, 84, "plaster", tile_m=0.8),
            "step_field": paint(226, 206, 176, "wood", tile_m=0.6),
            "rubble": o.BRICK,
            "lintel": paint(196, 60, 48, "plaster", tile_m=0.6),
            "barrel": paint(60, 104, 160, "plaster", tile_m=0.8),
            **dict.fromkeys(ramps, ramp),
        }
    )
    for x, y, size_x, size_y in (
        *((0, -16, 60, 19.9), (0, 16, 60, 19.9), (-18.5, 0, 23, 12.1), (18.5, 0, 23, 12.1)),
    ):
        ground = Thing()
        ground.box(paint(255, 255, 255, "gravel"), (0, 0, -0.06), (size_x, size_y, 0.1))
        scenery.place("ground", ground, x, y)
    north, south = Wall(scenery, 6.99, 0, 180), Wall(scenery, -6.99, 0, 0)
    west, east = Wall(scenery, 0, -5.99, 90), Wall(scenery, 0, 5.99, -90)
    for wall, places in (
        *((north, (-4.4, -1.8, 0.0, 2.1, 4.3)), (south, (-4.6, -2.6, 1.3, 3.4, 4.8))),
        *((west, (-5.6, -3.4, 5.6)), (east, (-4.6, -1.4, 5.6))),
    ):
        for along in places:
            wall.put("poster", f.poster(random, 0.5), along, 0.0, 0.42)
    scenery.spread(
        "cone",
        o.cone,
        "-3.05 -3.45 0; 2.3 -3.5 0; -6.65 -2.9 0; 6.65 2.3 0; 3.1 3.3 0; -3.2 -0.75 0",
    )
    scenery.spread(
        "debris", partial(o.bricks, random, 0.35), "-6.5 5.6 0 24; 6.6 -4.2 0 24; -6.65 3.3 0 24"
    )
    scenery.place("toolbox", f.toolbox(random), -6.6, -5.6, 20)
    scenery.place("extinguisher", f.extinguisher(), 6.8, 0.2)
    scenery.place("box", f.cardboard_box(random), -6.6, 4.4, 12)
    scenery.spread("container", partial(o.container, random), "9.4 -4.5 2; -3.4 -9 90; 3.6 -9.4 84")
    scenery.spread(
        "car",
        o.car,
        "9.6 3.4 200 196 34 28; -9.8 -4.4 80 226 226 220; -9.4 2.2 -70 200 40 32; "
        "1.5 9.6 170 232 200 60",
    )
    scenery.place("house", o.house(random, 12.0), -4.6, 12.0, -90)
    scenery.place("shed", o.shed(random), 7.4, 9.6, -120)
    scenery.spread("barrier", o.barrier, "5.4 7.6 92; 3.3 7.5 88; -8.1 5.6 4; 8.3 0.6 0")
    scenery.spread("lamp", o.street_lamp, "8.2 -8.2 150; -8.4 7.6 -30; 8 7.4 -130")
    scenery.spread(
        "pallet",
        partial(o.pallet, random),
        "8.1 -1.2 8 3; -8.3 -1.3 95 2; -8.2 0.4 80 3; 0.4 -7.6 4 2",
    )
    scenery.place("pipe", o.concrete_pipe(), 7.9, 2.2, 10)
    scenery.place("fence", o.fence(40.0, 1.8), 15.5, 0, 180)
    scenery.place("fence", o.fence(40.0, 1.8), -14.5, 0)
    scenery.spread("tree", partial(o.tree, random), _TREES)
