from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest

from catoptra_server.render.raster.device import (
    GlDevice,
    ProgramSpec,
    ShaderPrograms,
    load_source,
    set_uniform,
)

ROOT = Path(str(files("catoptra_server") / "glsl"))
SHADERS = sorted(path for path in ROOT.rglob("*") if path.is_file())
IDS = [str(path.relative_to(ROOT)) for path in SHADERS]


@pytest.mark.parametrize("path", SHADERS, ids=IDS)
def test_shader_file_states_its_output_and_names_its_twin(path: Path) -> None:
    provides, twin, *_ = path.read_text(encoding="utf-8").splitlines()
    assert provides.startswith("// Provides ")
    assert twin.startswith("// Twin: ")
    name = twin.removeprefix("// Twin: ").split(",")[0].split(";")[0].split(" and ")[0]
    if name != "none":
        resolve_name(name.rstrip("."))  # raises where the twin does not exist


def test_source_begins_with_version_and_definitions() -> None:
    lines = load_source("average.frag", (("SAMPLES", 3),)).splitlines()
    assert lines[:2] == ["#version 330 core", "#define SAMPLES 3"]


def test_source_resolves_includes_to_the_end() -> None:
    text = load_source("mirror_mesh_lookup.frag", (("NUM_FACES", 5),))
    assert "#include" not in text
    assert text.count("vec2 atlas_coordinates(vec3 direction)\n{") == 1


def test_program_is_built_once_and_counted(device: GlDevice) -> None:
    programs = ShaderPrograms(device.context)
    assert programs.names == ()
    spec = ProgramSpec("fullscreen_triangle", "average", (("SAMPLES", 2),))
    assert programs.get(spec) is programs.get(spec)
    assert programs.names == ("average SAMPLES=2",)


def test_uniform_array_is_written_whole(device: GlDevice) -> None:
    define = (("NUM_POINT_LIGHTS", 2),)
    program = ShaderPrograms(device.context).get(ProgramSpec("face", "face", define))
    set_uniform(program, "light_positions", np.arange(6.0).reshape(2, 3))
    assert program["light_positions"].value == [(0.0, 1.0, 2.0), (3.0, 4.0, 5.0)]
