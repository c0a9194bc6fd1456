"""World files: from `[Catoptra.World]` and its lists of structs to a World.

Lists are Boxes, Cylinders, Rectangles, Rings, SphereBands, Meshes, Lights, PlayerStarts, RfidTags,
Victims and GpsOrigin, a struct on each line; AmbientOcclusion is on, the default, or off; LightBake
is off or on, which lights of Type=Rectangle need. Background is a colour or a Radiance HDR file;
Sky=(Elevation=,Azimuth=,Turbidity=,Clouds=), in degrees, stands for it and adds a sun and a
hemisphere light; Scenery=(Name=,Seed=) adds furniture and lamps, written by a script. Positions are
in metres, SAE (z down: the top of a table is at Z=-0.75), rotations in radians, colours in sRGB
bytes (R=255,G=0,B=0), file names relative to the world file. Meshes and textures are loaded by
`world/scene_mesh.py`. A new shape is a reader and a line of `_SHAPE_READERS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from catoptra_protocol.errors import ConfigError, DomainError, LocalProtocolError, SourceLocation
from catoptra_protocol.landmarks import BAND_COLOURS, Landmark, read_landmarks
from catoptra_protocol.names import suggest_name
from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import (
    Greeting,
    Report,
    StartPose,
    StartPoses,
    line_from_report,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import report_unknown_names
from catoptra_server.config.section_reader import SectionReader, Vector
from catoptra_server.world.world_description import (
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
    RectangleLight,
    RfidTag,
    Rgb,
    Ring,
    Shape,
    SphereBand,
    SurfaceGloss,
    Victim,
    World,
    linear_from_srgb,
)

if TYPE_CHECKING:
    from catoptra_server.world.panorama import Panorama
    from catoptra_server.world.sky import SkyDescription

MESH_SUFFIXES = (".dae", ".glb", ".gltf", ".obj", ".ply", ".stl")
_SECTION = "Catoptra.World"
_LANDMARK_COLOURS = "Catoptra.LandmarkColours"
_SKY_EXAMPLE = "(Elevation=40,Azimuth=120,Turbidity=2,Clouds=0.3)"
# A float32 has steps of 8 mm there, which the renderers would show; beyond is a typing error.
MAX_LENGTH_M = 1e5
# Of the three axes of a shape: from kilometres to a micrometre.
_MIN_SCALE, _MAX_SCALE = 1e-6, 1e4


def read_world(path: Path) -> tuple[World, IniFile]:
    """World of a world file, or of a mesh file alone.

    Meshes and textures are named, not yet loaded.

    Returns:
        The world, and the file, whose unknown keys can be reported now.

    Raises:
        ConfigError: with file, line, key, value and the expected form.
    """
    if path.suffix.lower() in (".world", ".sdf"):
        expected = f"a world file: `catoptra-server import {path} --out FILE.ini` writes one"
        raise ConfigError(SourceLocation(str(path)), key="file", value=path.name, expected=expected)
    text = None
    if path.suffix.lower() in MESH_SUFFIXES:
        # Imported on demand: a mesh file is loaded to find its floor.
        from catoptra_server.config.mesh_world import describe_mesh_world

        text = describe_mesh_world(path)
    file = IniFile(path, "worlds", text=text)
    section = file.get_section(_SECTION)
    if not file.has_section(_SECTION):
        misspelt = suggest_name(_SECTION, file.section_names())
        raise ConfigError(
            section.where,
            key="section",
            value=misspelt,
            expected=f"[{_SECTION}], which lists what the world contains",
        )
    name = section.get_str("Name", path.stem)
    starts = tuple(_read_starts(section.get_structs("PlayerStarts")))
    _require_sendable(section, "Name", Greeting("", name))
    _require_sendable(section, "PlayerStarts", StartPoses(starts))
    tags, victims = section.get_structs("RfidTags"), section.get_structs("Victims")
    items = tuple(read_items(section, path.parent))
    light_bake = section.get_choice("LightBake", ["on", "off"], "off") == "on"
    lights = [_read_light(light, has_areas=light_bake) for light in section.get_structs("Lights")]
    constant = [light for light in lights if not isinstance(light, RectangleLight)]
    areas = tuple(light for light in lights if isinstance(light, RectangleLight))
    with futures.ThreadPoolExecutor(1) as pool:
        # A new sky takes as long as the furniture, and leaves the interpreter to it.
        reading = pool.submit(_read_background, section, path.parent)
        if section.has_key("Scenery"):
            items, lamps = _add_scenery(section, items)
            areas = (*areas, *lamps) if light_bake else areas
        background, sky, lights_of_sky = reading.result()
    world = World(
        name=name,
        items=items,
        landmarks=_load_landmarks(section, path.parent),
        lights=(*constant, *_load_mesh_lights(items), *lights_of_sky),
        starts=starts,
        background=background,
        sky=sky,
        landmark_albedos=_read_landmark_albedos(file.get_section(_LANDMARK_COLOURS)),
        rfid_tags=tuple(RfidTag(s.get_int("ID"), _read_position(s, "Position")) for s in tags),
        victims=tuple(
            Victim(s.get_wire_name("Name"), _read_position(s, "Position")) for s in victims
        ),
        gps_origin=_read_gps_origin(section),
        light_bake=light_bake,
        area_lights=areas,
        ambient_occlusion=section.get_choice("AmbientOcclusion", ["on", "off"], "on") == "on",
    )
    # Nothing but the background would be visible: more likely the name of a list is misspelt.
    if not world.items and not world.landmarks:
        report_unknown_names(section.unknown_names())
        raise section.make_error(
            "Boxes", expected="at least one visible object: Boxes, Meshes, ..."
        )
    return world, file


def format_start(x_m: float, y_m: float) -> str:
    """Line of a world file with a start."""
    return f"PlayerStarts=(Tag=Start,Location=(X={x_m!r},Y={y_m!r},Z=0))"


def _require_sendable(section: SectionReader, key: str, report: Report) -> None:
    """Raise ConfigError for a value that no line of the protocol can carry.

    At start, with file and line; the first client's request would be too late.
    """
    try:
        line_from_report(report)
    except LocalProtocolError as error:
        raise section.make_error(
            key, expected=f"a text that clients can receive ({error})"
        ) from error


def _load_landmarks(section: SectionReader, folder: Path) -> tuple[Landmark, ...]:
    file_name = section.get_str("Landmarks", "")
    if not file_name:
        return ()
    return read_landmarks(section.get_path("Landmarks", folder, bundled="landmarks"))


def _load_mesh_lights(items: Sequence[Item]) -> Iterator[Light]:
    """Yield the lights of mesh files, in the world; each file is read once."""
    lights: dict[MeshFile, list[Light]] = {}
    for item in items:
        if not isinstance(item.shape, MeshFile):
            continue
        # Imported on demand: many worlds have no mesh file.
        from catoptra_server.world.mesh_files import load_mesh_lights

        if item.shape not in lights:
            lights[item.shape] = load_mesh_lights(item.shape)
        for light in lights[item.shape]:
            yield _move_light(light, item)


def _move_light(light: Light, item: Item) -> Light:
    pose, scale = item.world_from_item, np.array(item.scale)
    match light:
        case DirectionalLight(direction, irradiance):
            x, y, z = pose.rotate_directions(np.array(direction) * scale).tolist()
            length = hypot(x, y, z)
            return DirectionalLight((x / length, y / length, z / length), irradiance)
        case PointLight(position, intensity):
            x, y, z = pose.transform_points(np.array(position) * scale).tolist()
            return PointLight((x, y, z), intensity)
    return light


def _read_landmark_albedos(section: SectionReader) -> dict[str, Rgb]:
    defaults = {"cyan": (0, 170, 220), "magenta": (225, 35, 140), "yellow": (245, 215, 25)}
    return {name: _read_colour(section, name, defaults[name]) for name in BAND_COLOURS}


def _read_starts(structs: Sequence[SectionReader]) -> Iterator[StartPose]:
    lines: dict[str, int] = {}
    for struct in structs:
        start = _read_start(struct)
        # INIT finds the first start of a name: no client would ever spawn at the second.
        first = lines.setdefault(start.name.lower(), struct.where.line)
        if first != struct.where.line:
            raise struct.make_error(
                "Tag", expected=f"a name that no other start has; line {first} has it"
            )
        yield start


def _read_start(struct: SectionReader) -> StartPose:
    return StartPose(
        struct.get_wire_name("Tag"),
        _read_position(struct, "Location"),
        struct.get_vector("Rotation", (0.0, 0.0, 0.0)),
    )


def _read_gps_origin(section: SectionReader) -> GpsOrigin | None:
    """Position of the world's origin on Earth: GpsOrigin=(Latitude=..,Longitude=..), degrees."""
    structs = section.get_structs("GpsOrigin")
    if not structs:
        return None
    struct = structs[-1]
    return GpsOrigin(
        # Not to the poles: metres east are divided by the cosine of the latitude.
        struct.get_float("Latitude", min_value=-89.0, max_value=89.0),
        struct.get_float("Longitude", min_value=-180.0, max_value=180.0),
    )


def _read_background(
    section: SectionReader, folder: Path
) -> tuple[Rgb, Panorama | None, tuple[Light, ...]]:
    """What is seen where nothing is: a colour, or its mean with a panorama; the sky's lights."""
    # Loaded where they are read: most worlds have one colour.
    if section.has_key("Sky"):
        from catoptra_server.world.sky import find_sky

        if section.has_key("Background"):
            raise section.make_error("Background", expected="no key beside Sky, which is it")
        panorama, lights = find_sky(_read_sky(section.get_struct("Sky", example=_SKY_EXAMPLE)))
        return panorama.mean, panorama, lights
    if not section.get_str("Background", "").lower().endswith(".hdr"):
        return _read_colour(section, "Background", (0, 0, 0)), None, ()
    from catoptra_server.world.panorama import load_panorama

    try:
        panorama = load_panorama(section.get_path("Background", folder))
    except (DomainError, OSError) as error:
        raise section.make_error(
            "Background", expected=f"a panorama in Radiance HDR, of a whole file: {error}"
        ) from error
    return panorama.mean, panorama, ()


def _read_sky(struct: SectionReader) -> SkyDescription:
    from catoptra_server.world.sky import SkyDescription

    return SkyDescription(
        elevation_rad=math.radians(struct.get_float("Elevation", min_value=0.0, max_value=90.0)),
        azimuth_rad=math.radians(
            struct.get_float("Azimuth", 0.0, min_value=-360.0, max_value=360.0)
        ),
        turbidity=struct.get_float("Turbidity", 2.0, min_value=1.0, max_value=10.0),
        clouds=struct.get_float("Clouds", 0.0, min_value=0.0, max_value=1.0),
        seed=struct.get_int("Seed", 0, min_value=0, max_value=65535),
    )


def _read_light(struct: SectionReader, *, has_areas: bool) -> Light | RectangleLight:
    """Light of one struct: a hemisphere, a direction, a point or, where light is baked, an area."""
    brightness = struct.get_float("Brightness", 1.0, min_value=0.0, max_value=1e6)

    def read_radiance(key: str, default: tuple[int, int, int]) -> Rgb:
        # Brightness scales linear light, after decoding: 2 is twice the radiance.
        r, g, b = _read_colour(struct, key, default)
        return brightness * r, brightness * g, brightness * b

    def read_direction() -> Vector:
        direction = np.asarray(struct.get_vector("Direction"))
        length = hypot(*direction)
        if length == 0.0:
            raise struct.make_error("Direction", expected="a direction that is not zero")
        x, y, z = direction / length
        return float(x), float(y), float(z)

    kind = struct.get_choice("Type", ["Hemisphere", "Directional", "Point", "Rectangle"])
    group = "" if kind == "Hemisphere" else struct.get_str("Group", "")
    if kind == "Rectangle" and not has_areas:
        raise struct.make_error("Type", expected="LightBake=on before a light of Type=Rectangle")
    match kind:
        case "Hemisphere":
            return HemisphereLight(
                read_radiance("Up", (255, 255, 255)), read_radiance("Down", (128, 128, 128))
            )
        case "Directional":
            return DirectionalLight(
                read_direction(), read_radiance("Colour", (255, 255, 255)), group
            )
        case "Rectangle":
            size = struct.get_struct("Size")
            return RectangleLight(
                _read_position(struct, "Position"),
                read_direction(),
                (_read_length(size, "X"), _read_length(size, "Y")),
                read_radiance("Colour", (255, 255, 255)),
                group,
            )
        case _:
            return PointLight(
                _read_position(struct, "Position"), read_radiance("Colour", (255, 255, 255)), group
            )


def _read_box(item: SectionReader, folder: Path) -> Shape:
    return Box(item.get_vector("Size", min_value=1e-6, max_value=MAX_LENGTH_M))


def _read_cylinder(item: SectionReader, folder: Path) -> Shape:
    return Cylinder(
        radius_m=_read_length(item, "Radius"),
        height_m=_read_length(item, "Height"),
        # 48 sectors depart from the circle by 0.2 % of the radius.
        sectors=item.get_int("Sectors", 48, min_value=3, max_value=4096),
    )


def _read_rectangle(item: SectionReader, folder: Path) -> Shape:
    size, repeat = item.get_struct("Size"), (1.0, 1.0, 0.0)
    if _counts_tiles(item):
        repeat = item.get_vector("Repeat", max_value=MAX_LENGTH_M)
    return Rectangle(
        size_m=(_read_length(size, "X"), _read_length(size, "Y")), texture_repeat=repeat[:2]
    )


def _read_ring(item: SectionReader, folder: Path) -> Shape:
    # Inner radius 0 is a disc. Equal radii would make triangles without area.
    inner = item.get_float("InnerRadius", min_value=0.0, max_value=MAX_LENGTH_M)
    return Ring(
        inner_radius_m=inner,
        outer_radius_m=item.get_float(
            "OuterRadius", min_value=inner + 1e-6, max_value=2 * MAX_LENGTH_M
        ),
        sectors=item.get_int("Sectors", 96, min_value=3, max_value=4096),
    )


def _read_sphere_band(item: SectionReader, folder: Path) -> Shape:
    lower = item.get_float("From", min_value=0.0, max_value=180.0)
    return SphereBand(
        radius_m=_read_length(item, "Radius"),
        from_rad=math.radians(lower),
        to_rad=math.radians(item.get_float("To", min_value=lower, max_value=180.0)),
        sectors=item.get_int("Sectors", 360, min_value=3, max_value=4096),
        rings=item.get_int("Rings", 1, min_value=1, max_value=4096),
        is_solid=item.get_bool("Solid", False),
    )


def _read_mesh(item: SectionReader, folder: Path) -> Shape:
    return MeshFile(
        path=item.get_path("File", folder),
        scale=1.0
        if _has_scale_by_axis(item)
        else item.get_float("Scale", 1.0, min_value=1e-9, max_value=1e9),
        up=item.get_choice("Up", ["x", "y", "z"], ""),
        has_optional_textures=item.get_choice("MissingTextures", ["error", "grey"], "error")
        == "grey",
    )


_SHAPE_READERS: dict[str, Callable[[SectionReader, Path], Shape]] = {
    "Boxes": _read_box,
    "Cylinders": _read_cylinder,
    "Rectangles": _read_rectangle,
    "Rings": _read_ring,
    "SphereBands": _read_sphere_band,
    "Meshes": _read_mesh,
}


def read_items(section: SectionReader, folder: Path) -> list[Item]:
    """All items of a world, or of a robot's body, by the lists of their shapes."""
    items = []
    for key, shape in _SHAPE_READERS.items():
        for number, struct in enumerate(section.get_structs(key), 1):
            items.append(_read_item(struct, shape(struct, folder), f"{key}{number}", folder))
    return items


def _read_item(struct: SectionReader, shape: Shape, default_name: str, folder: Path) -> Item:
    position = _read_position(struct, "Position", (0.0, 0.0, 0.0))
    pose = Pose.from_rpy(position, struct.get_vector("Direction", (0.0, 0.0, 0.0)))
    # A mesh file has materials of its own; a Colour or Texture replaces all.
    has_own_material = (
        isinstance(shape, MeshFile)
        and not struct.has_key("Colour")
        and not struct.has_key("Texture")
    )
    is_rectangle = isinstance(shape, Rectangle)
    material = None
    if not has_own_material:
        material = _read_material(struct, folder, is_rectangle=is_rectangle)
    # None: as the mesh file says.
    has_unlit = has_own_material and struct.has_key("Unlit")
    unlit = struct.get_bool("Unlit", False) if has_unlit else None
    name, casts_shadows = struct.get_str("Name", default_name), struct.get_bool("CastShadow", True)
    return Item(
        name,
        shape,
        pose,
        material,
        casts_shadows,
        unlit,
        struct.where,
        class_name=struct.get_str("Class", ""),
        scale=_read_scale(struct, shape),
    )


def _add_scenery(
    section: SectionReader, items: tuple[Item, ...]
) -> tuple[tuple[Item, ...], tuple[RectangleLight, ...]]:
    """Items of the file with those of its scenery, and the scenery's lamps."""
    # Imported on demand: most worlds have none.
    from catoptra_server.world.scenery import SCENERIES, add_scenery

    struct = section.get_struct("Scenery", example="(Name=laboratory,Seed=1)")
    name = struct.get_choice("Name", list(SCENERIES))
    return add_scenery(name, struct.get_int("Seed", 0, min_value=0, max_value=65535), items)


def _has_scale_by_axis(struct: SectionReader) -> bool:
    return struct.has_key("Scale") and struct.get_str("Scale").startswith("(")


def _read_scale(struct: SectionReader, shape: Shape) -> Vector:
    """Factors along the axes of a shape; a single number is the mesh file's."""
    is_number = isinstance(shape, MeshFile) and not _has_scale_by_axis(struct)
    if is_number or not struct.has_key("Scale"):
        return 1.0, 1.0, 1.0
    factors = struct.get_struct("Scale", example="(X=1,Y=-1,Z=2)")
    x, y, z = (_read_factor(factors, axis) for axis in "XYZ")
    return x, y, z


def _read_factor(struct: SectionReader, axis: str) -> float:
    """Factor along an axis, 1 where none is stated; a negative one mirrors."""
    factor = struct.get_float(axis, 1.0, min_value=-_MAX_SCALE, max_value=_MAX_SCALE)
    if abs(factor) < _MIN_SCALE:
        raise struct.make_error(axis, expected=f"a factor of at least {_MIN_SCALE:g}")
    return factor


def _read_material(struct: SectionReader, folder: Path, *, is_rectangle: bool) -> Material:
    texture, tile_m = _read_texture(struct, folder)
    # A texture is multiplied by the colour: white leaves the image as drawn.
    white = (255, 255, 255)
    r, g, b = albedo = _read_colour(struct, "Colour", white if texture else (128, 128, 128))
    # Times white's radiance: a lamp is some hundred times as bright as what it lights.
    emission = struct.get_float("Emission", 0.0, min_value=0.0, max_value=1e6)
    if struct.has_key("Repeat"):
        counts_tiles = is_rectangle and _counts_tiles(struct)
        tile_m = 0.0 if counts_tiles else _read_length(struct, "Repeat")
    return Material(
        albedo=albedo,
        texture=texture,
        unlit=struct.get_bool("Unlit", False),
        tile_m=tile_m,
        emission=(emission * r, emission * g, emission * b),
        gloss=_read_gloss(struct),
    )


def _read_gloss(struct: SectionReader) -> SurfaceGloss | None:
    if not struct.has_key("Gloss"):
        return None
    gloss = struct.get_struct("Gloss", example="(F0=0.04,Roughness=0.1)")
    return SurfaceGloss(
        # Below the least one no mirrored light is visible, but at grazing angles.
        reflectance=gloss.get_float("F0", 0.04, min_value=0.001, max_value=1.0),
        roughness=gloss.get_float("Roughness", 0.1, min_value=0.0, max_value=1.0),
    )


_NAMED_TEXTURE = "catoptra:"


def _read_texture(struct: SectionReader, folder: Path) -> tuple[Path | str | None, float]:
    """Image file or name of a texture, and the side of its tile where the texture has one."""
    text = struct.get_str("Texture", "")
    if not text.startswith(_NAMED_TEXTURE):
        return struct.get_path("Texture", folder) if text else None, 0.0
    # Imported on demand: many worlds have none.
    from catoptra_server.world.named_textures import NAMED_TEXTURES

    name = text.removeprefix(_NAMED_TEXTURE)
    if name not in NAMED_TEXTURES:
        names = ", ".join(_NAMED_TEXTURE + one for one in NAMED_TEXTURES)
        raise struct.make_error("Texture", expected=f"an image file, or one of {names}")
    return name, NAMED_TEXTURES[name].tile_m


def _counts_tiles(struct: SectionReader) -> bool:
    """Whether Repeat is a rectangle's number of tiles along each side, not the side of a tile."""
    return struct.has_key("Repeat") and struct.get_str("Repeat").startswith("(")


def _read_length(item: SectionReader, key: str) -> float:
    """Length above 0, in metres."""
    return item.get_float(key, min_value=1e-6, max_value=MAX_LENGTH_M)


def _read_position(item: SectionReader, key: str, default: Vector | None = None) -> Vector:
    """Point in the world frame, in metres."""
    return item.get_vector(key, default, min_value=-MAX_LENGTH_M, max_value=MAX_LENGTH_M)


def _read_colour(settings: SectionReader, key: str, default: tuple[int, int, int]) -> Rgb:
    """Linear RGB of a colour in sRGB bytes, 0 to 255 each."""
    rgb = settings.get_vector(key, default, members="RGB", min_value=0.0, max_value=255.0)
    r, g, b = linear_from_srgb(np.array(rgb) / 255.0)
    return float(r), float(g), float(b)
