"""Items of world files: a shape, its pose and its material.

A new shape is a reader and a line in _SHAPE_READERS.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.world_values import (
    MAX_LENGTH_M,
    read_colour,
    read_length,
    read_position,
)
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    Item,
    Material,
    MeshFile,
    Rectangle,
    Ring,
    Shape,
    SphereBand,
)


def _read_box(item: SectionReader, folder: Path) -> Shape:
    return Box(item.get_vector("Size", min_value=1e-6, max_value=MAX_LENGTH_M))


def _read_cylinder(item: SectionReader, folder: Path) -> Shape:
    return Cylinder(
        radius_m=read_length(item, "Radius"),
        height_m=read_length(item, "Height"),
        # 48 sectors depart from the circle by 0.2 % of the radius.
        sectors=item.get_int("Sectors", 48, min_value=3, max_value=4096),
    )


def _read_rectangle(item: SectionReader, folder: Path) -> Shape:
    size, repeat = (
        item.get_struct("Size"),
        item.get_vector("Repeat", (1.0, 1.0, 0.0), max_value=MAX_LENGTH_M),
    )
    return Rectangle(
        size_m=(read_length(size, "X"), read_length(size, "Y")), texture_repeat=repeat[:2]
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
        radius_m=read_length(item, "Radius"),
        from_rad=math.radians(lower),
        to_rad=math.radians(item.get_float("To", min_value=lower, max_value=180.0)),
        sectors=item.get_int("Sectors", 360, min_value=3, max_value=4096),
        rings=item.get_int("Rings", 1, min_value=1, max_value=4096),
    )


def _read_mesh(item: SectionReader, folder: Path) -> Shape:
    return MeshFile(
        path=item.get_path("File", folder),
        scale=item.get_float("Scale", 1.0, min_value=1e-9, max_value=1e9),
        up=item.get_choice("Up", ["y", "z"], "z"),
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
    """All items of a world, by the lists of their shapes."""
    items = []
    for key, shape in _SHAPE_READERS.items():
        for number, struct in enumerate(section.get_structs(key), 1):
            items.append(_read_item(struct, shape(struct, folder), f"{key}{number}", folder))
    return items


def _read_item(struct: SectionReader, shape: Shape, default_name: str, folder: Path) -> Item:
    position = read_position(struct, "Position", (0.0, 0.0, 0.0))
    pose = Pose.from_rpy(position, struct.get_vector("Direction", (0.0, 0.0, 0.0)))
    # A mesh file has materials of its own; a Colour or Texture replaces all of them.
    has_own_material = (
        isinstance(shape, MeshFile)
        and not struct.has_key("Colour")
        and not struct.has_key("Texture")
    )
    material = None if has_own_material else _read_material(struct, folder)
    unlit = _read_unlit(struct) if has_own_material else None
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
    )


def _read_unlit(struct: SectionReader) -> bool | None:
    """Whether a mesh file with its own materials is unlit; None: as the file says."""
    return struct.get_bool("Unlit", False) if struct.has_key("Unlit") else None


def _read_material(struct: SectionReader, folder: Path) -> Material:
    texture = struct.get_path("Texture", folder) if struct.get_str("Texture", "") else None
    # A texture is multiplied by the colour: white leaves the image as drawn.
    white = (255, 255, 255)
    return Material(
        albedo=read_colour(struct, "Colour", white if texture else (128, 128, 128)),
        texture=texture,
        unlit=struct.get_bool("Unlit", False),
    )
