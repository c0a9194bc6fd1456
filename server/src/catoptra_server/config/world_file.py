"""World files: from `[Catoptra.World]` and its lists of structs to a World.

Lists are Boxes, Cylinders, Rectangles, Rings, SphereBands, Meshes, Lights, PlayerStarts, RfidTags,
Victims and GpsOrigin, a struct on each line; AmbientOcclusion is on, the default, or off. Positions
are in metres, SAE (z down: a table has its top at Z=-0.75), rotations in radians, colours in sRGB
bytes (R=255,G=0,B=0), file names relative to the world file.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from catoptra_protocol.errors import ConfigError, LocalProtocolError
from catoptra_protocol.landmarks import BAND_COLOURS, Landmark, read_landmarks
from catoptra_protocol.usarsim.reports import (
    Greeting,
    Report,
    line_from_report,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unknown_names import report_unknown_names, suggest_name
from catoptra_server.config.world_items import read_items
from catoptra_server.config.world_lights import read_light
from catoptra_server.config.world_values import read_colour, read_position
from catoptra_server.world.world_description import (
    GpsOrigin,
    RfidTag,
    Rgb,
    StartPlace,
    Victim,
    World,
    report_start_poses,
)

_SECTION = "Catoptra.World"
_LANDMARK_COLOURS = "Catoptra.LandmarkColours"


def read_world(path: Path) -> tuple[World, IniFile]:
    """World of a file; meshes and textures are named, not yet loaded.

    Returns:
        The world, and the file, whose unknown keys can be reported now.

    Raises:
        ConfigError: with file, line, key, value and the expected form.
    """
    file = IniFile(path, "worlds")
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
    _require_sendable(section, "PlayerStarts", report_start_poses(starts))
    tags, victims = section.get_structs("RfidTags"), section.get_structs("Victims")
    world = World(
        name=name,
        items=tuple(read_items(section, path.parent)),
        landmarks=_load_landmarks(section, path.parent),
        lights=tuple(read_light(light) for light in section.get_structs("Lights")),
        starts=starts,
        background=read_colour(section, "Background", (0, 0, 0)),
        landmark_albedos=_read_landmark_albedos(file.get_section(_LANDMARK_COLOURS)),
        rfid_tags=tuple(RfidTag(s.get_int("ID"), read_position(s, "Position")) for s in tags),
        victims=tuple(
            Victim(s.get_wire_name("Name"), read_position(s, "Position")) for s in victims
        ),
        gps_origin=_read_gps_origin(section),
        ambient_occlusion=section.get_choice("AmbientOcclusion", ["on", "off"], "on") == "on",
    )
    # Nothing but the background would be visible: more likely the name of a list is misspelt.
    if not world.items and not world.landmarks:
        report_unknown_names(section.unknown_names())
        raise section.make_error(
            "Boxes", expected="at least one visible object: Boxes, Meshes, ..."
        )
    return world, file


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


def _read_landmark_albedos(section: SectionReader) -> dict[str, Rgb]:
    defaults = {"cyan": (0, 170, 220), "magenta": (225, 35, 140), "yellow": (245, 215, 25)}
    return {name: read_colour(section, name, defaults[name]) for name in BAND_COLOURS}


def _read_starts(structs: Sequence[SectionReader]) -> Iterator[StartPlace]:
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


def _read_start(struct: SectionReader) -> StartPlace:
    return StartPlace(
        struct.get_wire_name("Tag"),
        read_position(struct, "Location"),
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
