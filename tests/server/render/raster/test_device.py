"""The device, its programs and uniforms; positions of 48 bits; angles between samples."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import compute_image_scale
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_server.render.raster import device as module
from catoptra_server.render.raster.device import (
    FrameUniforms,
    GlDevice,
    OpenGLMissingError,
    ProgramSpec,
    ShaderPrograms,
    fit_spacing,
    load_source,
    open_device,
    set_uniform,
    split_positions,
)
from catoptra_server.world.objects import FogMedium
from catoptra_server.world.world_description import PointLight
from helpers.worlds import make_omni_camera


@pytest.mark.parametrize("library", ["EGL_LIBRARY", "GL_LIBRARY"])
def test_missing_library_is_named_with_the_packages_that_bring_it(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("EGL_LIBRARY", "GL_LIBRARY"):
        monkeypatch.setattr(module, name, "libc.so.6")
    monkeypatch.setattr(module, library, "libabsent.so.1")
    with pytest.raises(OpenGLMissingError, match="libgl1 libegl1 libgl1-mesa-dri") as caught:
        open_device()
    assert caught.value.reason.startswith("libabsent.so.1 cannot be loaded")


def test_context_that_cannot_be_created_is_reported_with_the_reason(
    device: GlDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_REQUIRED_VERSION", 990)
    with pytest.raises(OpenGLMissingError, match="EGL offers no OpenGL"):
        open_device()


def test_driver_without_clip_control_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    released: list[bool] = []
    old = SimpleNamespace(extensions=set(), release=lambda: released.append(True))
    monkeypatch.setattr(module.moderngl, "create_context", lambda **_: old)
    monkeypatch.setattr(module, "_require_library", lambda name: None)
    with pytest.raises(OpenGLMissingError, match="no GL_ARB_clip_control"):
        open_device()
    assert released


def test_depth_buffer_keeps_small_depths_apart(device: GlDevice) -> None:
    context = device.context
    depth = module.make_depth_buffer(context, (4, 4))
    target = context.framebuffer([context.texture((4, 4), 4)], depth)
    shown = []
    for value in (3e-8, 4e-8):
        target.clear(depth=value)
        data = target.read(attachment=-1, components=1, dtype="f4")
        shown.append(float(np.frombuffer(data, dtype=np.float32)[0]))
    assert shown == [float(np.float32(3e-8)), float(np.float32(4e-8))]


@pytest.mark.parametrize(
    ("renderer", "software"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("softpipe", True),
        ("NVIDIA H200/PCIe/SSE2", False),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", False),
    ],
)
def test_software_is_recognized_by_the_renderer_name(
    device: GlDevice, renderer: str, software: bool
) -> None:
    assert replace(device, renderer=renderer).is_software is software


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


def test_split_position_is_a_float32_number_and_what_it_lacks() -> None:
    positions = np.random.default_rng(3).uniform(-1e5, 1e5, (500, 3, 3))
    parts = split_positions(positions)
    assert parts.dtype == np.float32
    assert parts.shape == (500, 3, 6)
    assert np.array_equal(parts[..., :3], positions.astype(np.float32))
    whole = parts[..., :3].astype(np.float64) + parts[..., 3:]
    assert np.abs(whole - positions).max() < 1e5 * 2.0**-48


def test_difference_of_two_near_positions_is_as_exact_as_float32_can_hold_it() -> None:
    rng = np.random.default_rng(4)
    viewpoint = np.array((7.3e4, -9.9e4, 1.25))
    corners = viewpoint + rng.uniform(-0.02, 0.02, (500, 3))
    near, here = split_positions(corners), split_positions(viewpoint)
    # The shader's sum, float32 by float32.
    offsets = (near[:, :3] - here[:3]) + (near[:, 3:] - here[3:])
    assert offsets.dtype == np.float32
    # Three roundings of lengths below 4 cm.
    assert np.abs(offsets - (corners - viewpoint)).max() < 3 * 0.04 * 2.0**-24


LIGHTS = (PointLight((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),)


def make_uniforms(lights: tuple[PointLight, ...]) -> FrameUniforms:
    viewpoint, origin = np.array([0.5, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    return FrameUniforms.from_viewpoint(viewpoint, lights=lights, origin=origin)


def test_light_positions_are_relative_to_the_viewpoint() -> None:
    assert make_uniforms(LIGHTS).light_positions.tolist() == [[0.5, 1.0, 3.0]]
    assert make_uniforms(()).light_positions.shape == (0, 3)


@pytest.mark.parametrize("lights", [(), LIGHTS])
def test_programs_with_and_without_lights_accept_their_uniforms(
    device: GlDevice, lights: tuple[PointLight, ...]
) -> None:
    define = (("NUM_POINT_LIGHTS", len(lights)),) if lights else ()
    program = ShaderPrograms(device.context).get(ProgramSpec("face", "face", define))
    make_uniforms(lights).apply_to(program)
    assert program["viewpoint"].value == (0.5, 0.0, 0.0)


@pytest.mark.parametrize(
    ("fog", "expected"),
    [(None, (0.0, 0.0, 0.0, 0.0)), (FogMedium(0.3, (0.5, 0.6, 0.7)), (0.5, 0.6, 0.7, 0.3))],
)
def test_fog_of_a_program_is_its_airlight_and_its_density(
    monkeypatch: pytest.MonkeyPatch, fog: FogMedium | None, expected: tuple[float, ...]
) -> None:
    written: dict[str, Any] = {}
    monkeypatch.setattr(module, "set_uniform", lambda _, name, value: written.update({name: value}))
    module.set_fog(SimpleNamespace(), fog)  # type: ignore[arg-type]
    np.testing.assert_allclose(written["fog"], expected)


MIRRORS: list[tuple[Mirror, float]] = [
    (PAPER_MIRROR, 120.0),
    (PAPER_MIRROR, 40.0),
    (PAPER_MIRROR, 140.0),
    (HyperbolicMirror(3.0, 0.2), 105.0),
    (ParabolicMirror(0.03), 110.0),
]


@pytest.mark.parametrize(("mirror", "rim_deg"), MIRRORS)
@pytest.mark.parametrize("samples", [1, 4])
def test_spacing_is_the_reciprocal_of_the_scale(
    mirror: Mirror, rim_deg: float, samples: int
) -> None:
    camera = make_omni_camera(mirror=mirror, rim_deg=rim_deg)
    scale = compute_image_scale(camera)
    cosine = np.cos(2.0 * np.arctan(scale.t))
    expected = 1.0 / (samples * np.stack((scale.radial, scale.tangential), axis=-1))
    # A level changes by a 70th of the way to the next.
    np.testing.assert_allclose(fit_spacing(camera, samples).at(cosine), expected, rtol=0.01)


def test_spacing_outside_the_image_is_that_of_its_border() -> None:
    spacing = fit_spacing(make_omni_camera(rim_deg=60.0), 1)
    np.testing.assert_array_equal(spacing.at(np.array([-1.0])), spacing.at(np.array([0.5])))
