"""The structures in ctypes against the kernel's public headers, member by member."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

import pytest

from catoptra_server.render.trace.kernel import kernel_structs
from catoptra_server.render.trace.kernel.kernel_structs import (
    STRUCTURES,
    Fields,
    HemisphereStruct,
    StanceStruct,
)

SOURCES = Path(kernel_structs.__file__).parent / "src"
HEADERS = ("kernel.h", "image.h")
# Names that Python's other classes have already.
C_NAMES = {
    "TextureStruct": "Texture",
    "TextureLevelStruct": "TextureLevel",
    "LightStruct": "Light",
    "HemisphereStruct": "Hemisphere",
    "SurfacesStruct": "Surfaces",
    "OcclusionPatchStruct": "OcclusionPatch",
    "OcclusionStruct": "Occlusion",
    "SceneStruct": "Scene",
    "RayTableStruct": "RayTable",
    "PoseStruct": "Pose",
    "LabelsStruct": "Labels",
    "FlowStruct": "Flow",
    "FrameStruct": "Frame",
    "StanceStruct": "Stance",
    "SinkingStruct": "Sinking",
}
SCALARS = {
    "int32_t": ctypes.c_int32,
    "int64_t": ctypes.c_int64,
    "uint32_t": ctypes.c_uint32,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
}
ALL = (*STRUCTURES, HemisphereStruct, StanceStruct)


def read_header() -> str:
    """The headers without comments."""
    text = "".join((SOURCES / name).read_text(encoding="utf-8") for name in HEADERS)
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


def parse_structure(name: str) -> Fields:
    """Members of a structure of the header, as ctypes would declare them."""
    found = re.search(rf"typedef struct \{{([^}}]*)\}} {name};", read_header())
    assert found is not None, f"no header declares a structure {name}"
    declarations = [line.strip() for line in found[1].split(";") if line.strip()]
    return [member for text in declarations for member in parse_declaration(text)]


def parse_declaration(text: str) -> Fields:
    """Members of one declaration, such as `float up[3], down[3]`."""
    type_name, declarators = text.removeprefix("const ").split(maxsplit=1)
    return [parse_declarator(type_name, part.strip()) for part in declarators.split(",")]


def parse_declarator(type_name: str, text: str) -> tuple[str, type]:
    """Name and type of one member; every pointer is an address."""
    name = re.sub(r"\[\d+\]", "", text.replace("*const", "").replace("*", "")).strip()
    length = re.search(r"\[(\d+)\]", text)
    if "*" in text:
        return name, ctypes.c_void_p * int(length[1]) if length else ctypes.c_void_p
    structures = {C_NAMES.get(s.__name__, s.__name__): s for s in ALL}
    type_ = SCALARS.get(type_name) or structures[type_name]
    return name, type_ * int(length[1]) if length else type_


@pytest.mark.parametrize("structure", ALL, ids=lambda s: s.__name__)
def test_structure_has_the_members_of_the_header_in_their_order(
    structure: type[ctypes.Structure],
) -> None:
    expected = parse_structure(C_NAMES.get(structure.__name__, structure.__name__))
    assert [(name, type_) for name, type_, *_ in structure._fields_] == expected


def test_structures_of_the_header_all_have_a_twin() -> None:
    declared = set(re.findall(r"typedef struct \{[^}]*\} (\w+);", read_header()))
    assert declared == {C_NAMES.get(s.__name__, s.__name__) for s in ALL}


def test_constants_are_those_of_the_header() -> None:
    values = {
        name: int(value) for name, value in re.findall(r"\b([A-Z]\w+) = (-?\d+)", read_header())
    }
    shared = {
        name for name in vars(kernel_structs) if re.match("OUTPUT_|FACET_|LIGHT_|SAMPLE_", name)
    }
    assert len(shared) == 19
    for name in shared:
        assert values[name] == getattr(kernel_structs, name), name


def test_declaration_when_parsed_has_names_and_types() -> None:
    assert parse_declaration("float up[3], down[3]") == [
        ("up", ctypes.c_float * 3),
        ("down", ctypes.c_float * 3),
    ]
    assert parse_declaration("Mesh *const *objects") == [("objects", ctypes.c_void_p)]
    assert parse_declaration("const float *uv") == [("uv", ctypes.c_void_p)]
