"""The rescue arena, configs/worlds/arena.ini with its landmarks, from a plan in metres.

Run: cd tests && ../.venv/bin/python -m helpers.arena_world

The elements are those of RoboCup Rescue and of the ASTM test methods E2801 to E2828 (NIST), in
pallets of 1.2 m: crossing and continuous ramps of 15 degrees, step fields of posts 10 cm square,
inclined planes, a platform, drops. One step field has half the standard's steps: a P2AT climbs
5 cm, less than half the radius of its wheels. The yard in the middle is level, and has room for the
paper's route.

Ramps are turned boxes. A solid ramp reaches below the floor, so that its sides are closed; its
upper end leans out by rise * tan(slope), into the next ramp or the block behind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from helpers.configs import REPOSITORY, WORLDS

Rgb = tuple[int, int, int]
Span = tuple[float, float]

WORLD = WORLDS / "arena.ini"
LANDMARKS = REPOSITORY / "configs/landmarks/arena.csv"

HALF_LENGTH_M, HALF_WIDTH_M, WALL_M, PANEL_M = 7.0, 6.0, 1.2, 2.0
PALLET_M, POST_M = 1.2, 0.1
RAMP_DEG, PLATFORM_RAMP_DEG = 15.0, 20.0
# The first for a P2AT, the second the standard's.
LOW_STEP_M, HIGH_STEP_M = 0.05, 0.1
PLATFORM_M, DECK_M = 1.0, 0.08
KERB_M = 0.1

PLYWOOD, DARK_WOOD, STEEL = (204, 172, 128), (150, 110, 70), (96, 102, 110)
YELLOW, ORANGE, RED, GREY = (222, 184, 62), (214, 120, 40), (178, 52, 44), (158, 156, 150)
SKIN, SHIRT, TROUSERS = (224, 178, 148), (52, 84, 150), (60, 62, 70)
CONCRETE = (150, 146, 140)
# Posts by height, as in the standard's pictures.
POST_COLOURS = ((214, 186, 142), (186, 150, 102), (152, 114, 72), (118, 84, 52))
# Slope in degrees: yellow, orange, red by difficulty, as the parts of an arena.
INCLINED_PLANES = ((25.0, YELLOW), (35.0, ORANGE), (45.0, RED))

HEAD = """\
; A rescue arena with the elements of RoboCup Rescue: ramps, step fields, inclined planes,
; a platform, drops, victims. Written by tests/helpers/arena_world.py. Metres, SAE: x forward
; (north), y right (east), z down; the floor is z = 0.

[Catoptra.World]
Name=DM-RescueArena_250
Landmarks=../landmarks/arena.csv
Background=(R=182,G=202,B=222)
GpsOrigin=(Latitude=39.1339,Longitude=-77.2167)

Lights=(Type=Hemisphere,Up=(R=200,G=205,B=210),Down=(R=120,G=112,B=104))
Lights=(Type=Directional,Direction=(X=0.45,Y=0.35,Z=0.82),Colour=(R=255,G=246,B=230),Brightness=0.6)
"""

# Name, x, y, z, and heading in degrees; z is that of the surface below.
STARTS = (
    ("Centre", 0.0, 0.0, 0.0, 0.0),
    ("YardSouthWest", -2.3, -1.5, 0.0, 0.0),
    ("YardNorthWest", 2.3, -1.5, 0.0, 180.0),
    ("ContinuousRampsWest", -5.2, -3.3, 0.0, 90.0),
    ("ContinuousRampsEast", -5.2, 3.3, 0.0, -90.0),
    ("CrossingRampsWest", 4.6, -3.2, 0.0, 90.0),
    ("CrossingRampsEast", 4.6, 3.2, 0.0, -90.0),
    ("StepFieldLow", 3.3, -4.6, 0.0, 0.0),
    ("StepFieldHigh", 3.3, -5.55, 0.0, 0.0),
    ("InclinedPlane25", -3.45, 1.6, 0.0, 90.0),
    ("InclinedPlane35", -2.55, 2.3, 0.0, 90.0),
    ("InclinedPlane45", -1.65, 2.7, 0.0, 90.0),
    ("PlatformRamp", 5.5, 5.3, 0.0, 180.0),
    ("Platform", 0.4, 5.3, -PLATFORM_M, 180.0),
    ("UnderPlatform", 0.4, 5.3, 0.0, 0.0),
    ("EdgeOf20cm", -1.5, -2.7, 0.0, -90.0),
    ("EdgeOf1m", 0.7, -2.7, 0.0, -90.0),
    ("PitOf1m", 0.7, -4.9, 1.0, 90.0),
    ("Table", -3.4, -4.9, 0.0, 180.0),
)

# x, y, lower and upper colour: the six pairs, around the yard.
BEACONS = (
    (1.35, -1.95, "yellow", "magenta"),
    (-1.35, -1.95, "cyan", "magenta"),
    (1.35, 1.95, "magenta", "yellow"),
    (-1.35, 1.95, "magenta", "cyan"),
    (2.85, 0.0, "cyan", "yellow"),
    (-2.85, 0.0, "yellow", "cyan"),
)


def format_landmarks() -> str:
    """Text of the landmarks' file."""
    lines = [
        "# Beacons around the yard of worlds/arena.ini. Written by tests/helpers/arena_world.py.",
        "name,kind,x_m,y_m,width_m,depth_m,band_bottom_m,band_top_m,lower_colour,upper_colour",
    ]
    for x, y, lower, upper in BEACONS:
        lines.append(f"{upper}_over_{lower},beacon,{x},{y},0.1,0.1,0.2,0.4,{lower},{upper}")
    return "\n".join(lines) + "\n"


def format_world() -> str:
    """Text of the world's file."""
    parts = (
        *(list_starts(), list_floor(), list_walls(), list_ramps(), list_step_fields()),
        *(list_platform(), list_overhangs(), list_things()),
        *(list_victim("Lying", 5.4, 4.0, 0.0), list_victim("Stranded", -2.4, 5.5, PLATFORM_M)),
    )
    return "\n".join((HEAD, *("\n".join(part) + "\n" for part in parts)))


def list_starts() -> Iterator[str]:
    """Yield the starts."""
    for tag, x, y, z, heading in STARTS:
        turn = vector(0.0, 0.0, math.radians(heading))
        yield f'PlayerStarts=(Tag="{tag}",Location={vector(x, y, z)},Rotation={turn})'


def list_floor() -> Iterator[str]:
    """Yield the floor and the pit's two parts, with kerbs that end flush with the floor."""
    south, north, west, east = -HALF_LENGTH_M, HALF_LENGTH_M, -HALF_WIDTH_M, HALF_WIDTH_M
    left, step, right, front = -2.6, -0.4, 1.8, -3.7
    yield floor("Floor", (south, north), (front + KERB_M, east))
    yield floor("Floor", (south, left - KERB_M), (west, front + KERB_M))
    yield floor("Floor", (right + KERB_M, north), (west, front + KERB_M))
    yield floor("PitOf20cm", (left, step - KERB_M), (west, front), -0.2)
    yield floor("PitOf1m", (step, right), (west, front), -1.0)
    width = (left - KERB_M, right + KERB_M)
    yield box("Kerb", "kerb", width, (front, front + KERB_M), (-1.1, 0.0), YELLOW)
    for x, top in ((left - KERB_M, 0.0), (step - KERB_M, -0.2), (right, 0.0)):
        yield box("Kerb", "kerb", (x, x + KERB_M), (west, front), (-1.1, top), YELLOW)
    yield box("PitWall", "wall", width, (west - KERB_M, west), (-1.1, 0.0), GREY)


def list_walls() -> Iterator[str]:
    """Yield panels of plywood: one long box would stretch its picture."""
    thick, height = KERB_M, (0.0, WALL_M)
    for x in range(-7, 7, 2):
        for y in (-HALF_WIDTH_M - thick, HALF_WIDTH_M):
            span = (x, x + PANEL_M), (y, y + thick)
            yield box("Wall", "wall", *span, height, PLYWOOD, "wood")
    for y in range(-6, 6, 2):
        for x in (-HALF_LENGTH_M - thick, HALF_LENGTH_M):
            span = (x, x + thick), (y, y + PANEL_M)
            yield box("Wall", "wall", *span, height, PLYWOOD, "wood")


def list_ramps() -> Iterator[str]:
    """Yield ramps along y: continuous up and down; crossing, up in one lane and down beside it.

    Lanes that begin later are level at both ends: all can be entered without a step.
    """
    for number in range(4):
        place, uphill = (-5.2, -2.4 + PALLET_M * (number + number % 2)), 90 - number % 2 * 180
        name, size = f"ContinuousRamp{number + 1}", (PALLET_M, 2.0 * PALLET_M)
        yield ramp(name, "continuous_ramp", place, uphill, size, RAMP_DEG, PLYWOOD)
    for lane in range(4):
        for number in range(lane % 2, 4 - lane % 2):
            is_falling = (lane + number) % 2
            place = (4.3 + 0.5 * PALLET_M * lane, -2.4 + PALLET_M * (number + is_falling))
            name, size = f"CrossingRamp{lane + 1}{number + 1}", (PALLET_M, 0.5 * PALLET_M)
            uphill = 90 - is_falling * 180
            yield ramp(name, "crossing_ramp", place, uphill, size, RAMP_DEG, PLYWOOD)


def list_step_fields() -> Iterator[str]:
    """Yield posts: a hill of low steps along x, and half a pallet of high ones in disorder."""
    for row in range(12):
        for column in range(18):
            if is_low := column < 12:
                level = min(3, (min(row, 11 - row) + (row + column) % 2) // 2)
            else:
                level = (row * row + 3 * row * column + column // 2) % 4
            x, y = 4.2 + POST_M * row, -4.1 - POST_M * column
            height = (LOW_STEP_M if is_low else HIGH_STEP_M) * (level + 1)
            name = "StepFieldLow" if is_low else "StepFieldHigh"
            spans = (x, x + POST_M), (y - POST_M, y), (0.0, height)
            yield box(name, "step_field", *spans, POST_COLOURS[level])


def list_platform() -> Iterator[str]:
    """Yield a block with inclined planes against its west side, and a deck with a ramp on posts."""
    front, back, top = 4.7, HALF_WIDTH_M, (PLATFORM_M - DECK_M, PLATFORM_M)
    yield box("Block", "platform", (-4.0, -1.1), (front, back), (0.0, PLATFORM_M), GREY)
    yield box("Deck", "deck", (-1.1, 1.8), (4.6, back), top, DARK_WOOD, "wood")
    for x in (-1.0, 1.6):
        for y in (front, 5.85):
            yield box("DeckPost", "post", (x, x + 0.1), (y, y + 0.1), (0.0, top[0]), STEEL)
    run = PLATFORM_M / math.tan(math.radians(PLATFORM_RAMP_DEG))
    name, place, size = "PlatformRamp", (1.8 + run, 5.3), (run, PALLET_M)
    yield ramp(name, "platform_ramp", place, 180, size, PLATFORM_RAMP_DEG, PLYWOOD, DECK_M)
    for number, (slope_deg, colour) in enumerate(INCLINED_PLANES):
        run = PLATFORM_M / math.tan(math.radians(slope_deg))
        place, name = (-3.45 + 0.9 * number, front - run), f"InclinedPlane{slope_deg:.0f}"
        yield ramp(name, "inclined_plane", place, 90, (run, 0.9), slope_deg, colour)


def list_overhangs() -> Iterator[str]:
    """Yield a table, and a lintel over the second crest of the continuous ramps."""
    yield box("Table", "table", (-6.0, -4.4), (-5.4, -4.4), (0.75, 0.79), DARK_WOOD, "wood")
    for x in (-5.95, -4.5):
        for y in (-5.35, -4.5):
            yield box("Table", "table", (x, x + 0.05), (y, y + 0.05), (0.0, 0.75), STEEL)
    yield box("Lintel", "lintel", (-6.6, -3.8), (1.15, 1.25), (0.8, 0.9), RED)
    for x in (-6.6, -3.9):
        yield box("Lintel", "lintel", (x, x + 0.1), (1.15, 1.25), (0.0, 0.8), RED)


def list_things() -> Iterator[str]:
    """Yield rubble, barrels, a crate, signs on the walls, and tags in the corners."""
    for x, y, size, turn in ((6.2, -4.7, 0.4, 0.4), (6.5, -5.4, 0.3, 1.1), (-6.3, 3.9, 0.35, 0.7)):
        place, sides = (x, y, 0.5 * size), (1.5 * size, size, size)
        members = f'Size={vector(*sides)},Texture="textures/bricks.png"'
        yield item("Boxes", "Rubble", "rubble", place, members, (0.0, 0.0, turn))
    for x, y, colour in ((6.55, -3.7, SHIRT), (6.6, -2.95, ORANGE)):
        members = f"Radius=0.28,Height=0.9,{material(colour)}"
        yield item("Cylinders", "Barrel", "barrel", (x, y, 0.45), members)
    crate = 'File="meshes/crate.obj",Scale=0.6,Up=z'
    yield item("Meshes", "Crate", "crate", (-6.3, 4.9, 0.0), crate, (0.0, 0.0, 0.35))
    for x, y in ((6.99, -1.0), (6.99, 3.0), (-6.99, 0.0), (-4.8, 5.99), (4.0, -5.99)):
        # On a corner, in the wall's plane.
        is_end = abs(x) > abs(y)
        sides = (0.02, 0.3, 0.3) if is_end else (0.3, 0.02, 0.3)
        turn = (0.25 * math.pi, 0.0, 0.0) if is_end else (0.0, 0.25 * math.pi, 0.0)
        members = f"Size={vector(*sides)},{material(ORANGE)}"
        yield item("Boxes", "Sign", "sign", (x, y, 0.8), members, turn)
    for number, (x, y) in enumerate(((6.9, -5.9), (6.9, 5.9), (-6.9, 5.9), (-6.9, -5.9))):
        yield f"RfidTags=(ID={1001 + number},Position={vector(x, y, -0.5)})"


def list_victim(name: str, x: float, y: float, height: float) -> Iterator[str]:
    """Yield a mannequin of 1.75 m on its back, its chest at (x, y) and its head to the south."""
    for along, size, colour in ((0.0, (0.6, 0.38, 0.2), SHIRT), (0.4, (0.2, 0.34, 0.2), TROUSERS)):
        members = f"Size={vector(*size)},{material(colour)}"
        yield item("Boxes", name, "victim", (x + along, y, height + 0.1), members)
    head = f"Radius=0.11,From=0,To=180,Solid=true,Sectors=24,Rings=12,{material(SKIN)}"
    yield item("SphereBands", name, "victim", (x - 0.42, y, height + 0.11), head)
    for along, across, radius, length, colour in LIMBS:
        for side in (-across, across):
            members = f"Radius={radius},Height={length},Sectors=16,{material(colour)}"
            place, turn = (x + along, y + side, height + radius), (0.0, 0.5 * math.pi, 0.0)
            yield item("Cylinders", name, "victim", place, members, turn)
    for part, along in (("Head", -0.42), ("Chest", 0.0), ("Leg", 0.8)):
        yield f'Victims=(Name="{part}",Position={vector(x + along, y, -height - 0.2)})'


# Along and across from the chest, radius, length: arms with hands, legs.
LIMBS = (
    (0.0, 0.25, 0.05, 0.56, SHIRT),
    (0.37, 0.25, 0.04, 0.18, SKIN),
    (0.88, 0.1, 0.08, 0.76, TROUSERS),
)


def ramp(
    name: str,
    class_: str,
    foot: tuple[float, float],
    uphill_deg: float,
    size: tuple[float, float],
    slope_deg: float,
    colour: Rgb,
    thickness: float = 0.0,
) -> str:
    """Ramp from the middle of its foot, uphill: its run on the floor, its width.

    Args:
        thickness: Of a plank; 0 is a solid ramp.
    """
    run, width = size
    slope, uphill = math.radians(slope_deg), math.radians(uphill_deg)
    thickness = thickness or run * math.tan(slope) / math.cos(slope) + 0.01
    # From the middle of the surface into the ramp.
    forward = 0.5 * (run + thickness * math.sin(slope))
    height = 0.5 * (run * math.tan(slope) - thickness * math.cos(slope))
    place = foot[0] + forward * math.cos(uphill), foot[1] + forward * math.sin(uphill), height
    members = f"Size={vector(run / math.cos(slope), width, thickness)},{material(colour)}"
    return item("Boxes", name, class_, place, members, (0.0, slope, uphill))


def box(
    name: str, class_: str, x: Span, y: Span, height: Span, colour: Rgb, texture: str = ""
) -> str:
    """Box between limits."""
    spans = (x, y, height)
    place = tuple(0.5 * (low + high) for low, high in spans)
    members = f"Size={vector(*(high - low for low, high in spans))},{material(colour, texture)}"
    return item("Boxes", name, class_, place, members)


def floor(name: str, x: Span, y: Span, height: float = 0.0) -> str:
    """Rectangle of concrete between limits, a picture every 2 m."""
    (left, right), (near, far) = x, y
    size = right - left, far - near
    repeat = vector(size[1] / 2.0, size[0] / 2.0)
    members = f"Size={vector(*size)},Repeat={repeat},{material(CONCRETE, 'concrete')}"
    place = 0.5 * (left + right), 0.5 * (near + far), height
    return item("Rectangles", name, "floor", place, members)


def item(
    kind: str,
    name: str,
    class_: str,
    place: tuple[float, ...],
    members: str,
    turn: tuple[float, ...] = (),
) -> str:
    """Line of an item at x, y and a height above the floor."""
    position = vector(place[0], place[1], -place[2])
    direction = f",Direction={vector(*turn)}" if turn else ""
    return f'{kind}=(Name="{name}",Class="{class_}",Position={position}{direction},{members})'


def material(colour: Rgb, texture: str = "") -> str:
    """Members of a colour, and of a bundled picture."""
    rgb = "Colour=(R={},G={},B={})".format(*colour)
    return rgb + (f',Texture="textures/{texture}.png"' if texture else "")


def vector(*values: float) -> str:
    """Struct of coordinates, rounded to micrometres and microradians."""
    texts = (f"{round(value, 6) + 0.0:.6f}".rstrip("0").rstrip(".") for value in values)
    return "(" + ",".join(f"{axis}={text}" for axis, text in zip("XYZ", texts, strict=False)) + ")"


def main() -> None:
    """Write both files."""
    WORLD.write_text(format_world(), encoding="utf-8")
    LANDMARKS.write_text(format_landmarks(), encoding="utf-8")


if __name__ == "__main__":
    main()
