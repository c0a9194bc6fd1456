"""What a world file means: from `[Catoptra.World]` and its lists to a World.

Lists are structs, one a line: Boxes, Cylinders, Rectangles, Rings, SphereBands, Meshes, Lights,
PlayerStarts, and what sensors find: RfidTags, Victims, GpsOrigin. Places are in metres, SAE (z
down: the top of a table stands at Z=-0.75); rotations in radians; colours in sRGB bytes
(R=255,G=0,B=0). File names are relative to the world file.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.landmarks import COLOURS, Landmark, read_landmarks
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.reports import (
    Greeting,
    Report,
    StartPose,
    StartPoses,
    line_from_report,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.settings import Settings, Vector
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.description import (
    Box,
    Cylinder,
    DirectionalLight,
    GpsOrigin,
    HemisphereLight,
    Item,
    Light,
    Material,
    MeshFile,
    PointLight,
    Rectangle,
    RfidTag,
    Rgb,
    Ring,
    Shape,
    SphereBand,
    StartPlace,
    Victim,
    World,
)

_SECTION = "Catoptra.World"
_LANDMARK_COLOURS = "Catoptra.LandmarkColours"
# Sizes and places beyond this (metres) are slips of a pen: a float32 there has steps of 8 mm.
_LARGEST_M = 1e5


def read_world(path: Path) -> tuple[World, IniFile]:
    """Return the world of a file, and the file for its unknown keys. Raises ConfigError."""
    file = IniFile(path)
    section = file.section(_SECTION)
    if not file.has(_SECTION):
        raise section.complain("section", expected=f"a section [{_SECTION}]")
    name = section.text("Name", path.stem)
    starts = tuple(_start(start) for start in section.structs("PlayerStarts"))
    _refuse_unsayable(section, "Name", Greeting("", name))
    _refuse_unsayable(section, "PlayerStarts", _poses(starts))
    tags, victims = section.structs("RfidTags"), section.structs("Victims")
    world = World(
        name=name,
        items=tuple(_items(section, path.parent)),
        landmarks=_landmarks(section, path.parent),
        lights=tuple(_light(light) for light in section.structs("Lights")),
        starts=starts,
        background=_colour(section, "Background", (0, 0, 0)),
        landmark_albedos=_landmark_albedos(file.section(_LANDMARK_COLOURS)),
        tags=tuple(RfidTag(s.integer("ID"), _place(s, "Position")) for s in tags),
        victims=tuple(Victim(s.word("Name"), _place(s, "Position")) for s in victims),
        gps_origin=_gps_origin(section),
    )
    if not world.items and not world.landmarks:
        raise section.complain("Boxes", expected="at least one thing to see: Boxes, Meshes, ...")
    return world, file


def _refuse_unsayable(section: Settings, key: str, report: Report) -> None:
    """Refuse what no line of the protocol can carry, before a client asks for it."""
    try:
        line_from_report(report)
    except LocalProtocolError as error:
        raise section.complain(key, expected=f"what can be sent to clients ({error})") from error


def _landmarks(section: Settings, folder: Path) -> tuple[Landmark, ...]:
    is_named = section.text("Landmarks", "")
    return read_landmarks(section.file("Landmarks", folder)) if is_named else ()


def _landmark_albedos(section: Settings) -> dict[str, Rgb]:
    defaults = {"cyan": (0, 170, 220), "magenta": (225, 35, 140), "yellow": (245, 215, 25)}
    return {name: _colour(section, name, defaults[name]) for name in COLOURS}


def _box(item: Settings, folder: Path) -> Shape:
    return Box(item.vector("Size", at_least=1e-6, at_most=_LARGEST_M))


def _cylinder(item: Settings, folder: Path) -> Shape:
    return Cylinder(
        radius_m=_length(item, "Radius"),
        height_m=_length(item, "Height"),
        sectors=item.integer("Sectors", 48, at_least=3, at_most=4096),
    )


def _rectangle(item: Settings, folder: Path) -> Shape:
    size, repeat = item.struct("Size"), item.vector("Repeat", (1.0, 1.0, 0.0), at_most=_LARGEST_M)
    return Rectangle(size_m=(_length(size, "X"), _length(size, "Y")), repeat=repeat[:2])


def _ring(item: Settings, folder: Path) -> Shape:
    inner = item.number("InnerRadius", at_least=0.0, at_most=_LARGEST_M)
    return Ring(
        inner_radius_m=inner,
        outer_radius_m=item.number("OuterRadius", at_least=inner + 1e-6, at_most=2 * _LARGEST_M),
        sectors=item.integer("Sectors", 96, at_least=3, at_most=4096),
    )


def _sphere_band(item: Settings, folder: Path) -> Shape:
    lower = item.number("From", at_least=0.0, at_most=180.0)
    return SphereBand(
        radius_m=_length(item, "Radius"),
        from_rad=math.radians(lower),
        to_rad=math.radians(item.number("To", at_least=lower, at_most=180.0)),
        sectors=item.integer("Sectors", 360, at_least=3, at_most=4096),
        rings=item.integer("Rings", 1, at_least=1, at_most=4096),
    )


def _mesh(item: Settings, folder: Path) -> Shape:
    return MeshFile(
        path=item.file("File", folder),
        scale=item.number("Scale", 1.0, at_least=1e-9, at_most=1e9),
        up=item.choice("Up", ["y", "z"], "z"),
    )


def _length(item: Settings, key: str) -> float:
    return item.number(key, at_least=1e-6, at_most=_LARGEST_M)


def _place(item: Settings, key: str, default: Vector | None = None) -> Vector:
    return item.vector(key, default, at_least=-_LARGEST_M, at_most=_LARGEST_M)


_SHAPES: dict[str, Callable[[Settings, Path], Shape]] = {
    "Boxes": _box,
    "Cylinders": _cylinder,
    "Rectangles": _rectangle,
    "Rings": _ring,
    "SphereBands": _sphere_band,
    "Meshes": _mesh,
}


def _items(section: Settings, folder: Path) -> list[Item]:
    items = []
    for key, shape in _SHAPES.items():
        for number, struct in enumerate(section.structs(key), 1):
            items.append(_item(struct, shape(struct, folder), f"{key}{number}", folder))
    return items


def _item(struct: Settings, shape: Shape, default_name: str, folder: Path) -> Item:
    position = _place(struct, "Position", (0.0, 0.0, 0.0))
    pose = Pose.from_rpy(position, struct.vector("Direction", (0.0, 0.0, 0.0)))
    own_look = (
        isinstance(shape, MeshFile) and not struct.has("Colour") and not struct.has("Texture")
    )
    material = None if own_look else _material(struct, folder)
    name, casts_shadows = struct.text("Name", default_name), struct.boolean("CastShadow", True)
    return Item(name, shape, pose, material, casts_shadows)


def _material(struct: Settings, folder: Path) -> Material:
    texture = struct.file("Texture", folder) if struct.text("Texture", "") else None
    white = (255, 255, 255)
    return Material(
        albedo=_colour(struct, "Colour", white if texture else (128, 128, 128)),
        texture=texture,
        unlit=struct.boolean("Unlit", False),
    )


def _colour(settings: Settings, key: str, default: tuple[int, int, int]) -> Rgb:
    """Return linear light of a colour in sRGB bytes."""
    rgb = settings.vector(key, default, members="RGB", at_least=0.0, at_most=255.0)
    r, g, b = linear_from_srgb(np.array(rgb) / 255.0)
    return float(r), float(g), float(b)


def _light(struct: Settings) -> Light:
    brightness = struct.number("Brightness", 1.0, at_least=0.0, at_most=1e6)

    def shone(key: str, default: tuple[int, int, int]) -> Rgb:
        r, g, b = _colour(struct, key, default)
        return brightness * r, brightness * g, brightness * b

    match struct.choice("Type", ["Hemisphere", "Directional", "Point"]):
        case "Hemisphere":
            return HemisphereLight(shone("Up", (255, 255, 255)), shone("Down", (128, 128, 128)))
        case "Directional":
            direction = np.asarray(struct.vector("Direction"))
            length = float(np.linalg.norm(direction))
            if length == 0.0:
                raise struct.complain("Direction", expected="a direction that is not zero")
            x, y, z = direction / length
            return DirectionalLight(
                (float(x), float(y), float(z)), shone("Colour", (255, 255, 255))
            )
        case _:
            return PointLight(_place(struct, "Position"), shone("Colour", (255, 255, 255)))


def _start(struct: Settings) -> StartPlace:
    return StartPlace(
        struct.word("Tag"),
        _place(struct, "Location"),
        struct.vector("Rotation", (0.0, 0.0, 0.0)),
    )


def _gps_origin(section: Settings) -> GpsOrigin | None:
    """Return where on Earth the origin is: GpsOrigin=(Latitude=..,Longitude=..), degrees."""
    structs = section.structs("GpsOrigin")
    if not structs:
        return None
    struct = structs[-1]
    return GpsOrigin(
        struct.number("Latitude", at_least=-89.0, at_most=89.0),
        struct.number("Longitude", at_least=-180.0, at_most=180.0),
    )


def _poses(starts: tuple[StartPlace, ...]) -> StartPoses:
    return StartPoses(tuple(StartPose(s.name, s.location_m, s.rotation_rad) for s in starts))
