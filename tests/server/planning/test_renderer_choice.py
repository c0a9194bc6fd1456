from __future__ import annotations

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import catoptra_server
from catoptra_protocol.errors import DomainError, RendererUnavailableError
from catoptra_server.planning.renderer_choice import RendererChoice, choose_renderer
from catoptra_server.render import raster
from catoptra_server.render.raster import OpenGLMissingError
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.scene.scene_mesh import SceneMesh, build_scene
from helpers.opengl import device_or_skip
from helpers.worlds import make_test_world

WORLD = make_test_world()
SCENE = build_scene(WORLD)


def choose(requested: str, *, samples: int = 1) -> RendererChoice:
    choice = choose_renderer(requested, SCENE, WORLD, threads=1, samples=samples)
    choice.renderer.close()
    return choice


@pytest.fixture
def _no_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raster.gl_device, "EGL_LIBRARY", "libabsent.so.1")


def test_trace_when_requested_is_chosen() -> None:
    choice = choose("trace")
    assert choice.kind is RendererKind.TRACE
    assert choice.reason == "requested"


def test_raster_when_requested_is_chosen() -> None:
    device_or_skip().close()
    choice = choose("raster")
    assert choice.kind is RendererKind.RASTER


@pytest.mark.usefixtures("_no_opengl")
def test_raster_without_opengl_names_library_and_packages() -> None:
    with pytest.raises(RendererUnavailableError, match=r"libabsent.so.1 .* libgl1-mesa-dri"):
        choose("raster")


@pytest.mark.usefixtures("_no_opengl")
def test_auto_without_opengl_traces_and_gives_the_reason() -> None:
    choice = choose("auto")
    assert choice.kind is RendererKind.TRACE
    assert choice.reason.startswith("no OpenGL: libabsent.so.1 cannot be loaded")


LLVMPIPE, GPU = "llvmpipe (LLVM 15)", "NVIDIA H200"


@pytest.mark.parametrize(
    ("name", "samples", "triangles", "kind"),
    [
        (GPU, 1, 100, RendererKind.RASTER),
        (GPU, 1, 10**6, RendererKind.RASTER),
        (LLVMPIPE, 1, 100, RendererKind.TRACE),
        (LLVMPIPE, 2, 100, RendererKind.TRACE),
        (LLVMPIPE, 3, 100, RendererKind.RASTER),
        (LLVMPIPE, 3, 60_000, RendererKind.TRACE),
    ],
)
def test_auto_weighs_device_samples_and_triangles(
    name: str,
    samples: int,
    triangles: int,
    kind: RendererKind,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    device = replace(device_or_skip(), renderer=name)
    monkeypatch.setattr(raster, "open_device", lambda: device)
    monkeypatch.setattr(SceneMesh, "__len__", lambda self: triangles)
    choice = choose("auto", samples=samples)
    assert choice.kind is kind
    assert name in choice.reason


@pytest.mark.parametrize("samples", [1, 3])
def test_auto_offers_the_other_renderer_as_alternative(
    samples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = replace(device_or_skip(), renderer=LLVMPIPE)
    monkeypatch.setattr(raster, "open_device", lambda: device)
    choice = choose("auto", samples=samples)
    device_or_skip().close()
    (other,) = choice.alternatives
    assert {choice.kind, other} == set(RendererKind)


def test_renderer_when_requested_by_name_has_no_alternative() -> None:
    assert not choose("trace").alternatives


def test_unknown_renderer_is_rejected_with_the_existing_names() -> None:
    with pytest.raises(DomainError, match="auto, trace or raster, not 'vulkan'"):
        choose("vulkan")


def test_trace_does_not_load_opengl() -> None:
    program = (
        "import sys; from catoptra_server.planning.renderer_choice import choose_renderer;"
        "from catoptra_server.scene.world_description import World;"
        "from catoptra_server.scene.scene_mesh import SceneMesh, build_scene;"
        "world = World('empty', ()); choose_renderer('trace', build_scene(world), world);"
        "sys.exit('moderngl' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_error_of_a_missing_opengl_is_a_renderer_unavailable_error() -> None:
    assert issubclass(OpenGLMissingError, RendererUnavailableError)


# Beside the renderers themselves: their names, their creation, their settings, their checks.
MODULES_THAT_KNOW_THE_KINDS = {
    "doctor/renderer_devices.py",
    "planning/candidate_plans.py",
    "planning/renderer_choice.py",
    "render/renderer_kind.py",
}


def names_a_kind(module: Path) -> bool:
    """Whether a module names a member of RendererKind, by attribute or by value."""
    values = {kind.value for kind in RendererKind}
    return any(
        (isinstance(node, ast.Attribute) and node.attr in RendererKind.__members__)
        or (isinstance(node, ast.Constant) and node.value in values)
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8")))
    )


def test_kinds_of_renderers_are_distinguished_in_four_modules() -> None:
    package = Path(catoptra_server.__file__).parent
    renderers = {package / "render" / kind.value for kind in RendererKind}
    found = {
        str(module.relative_to(package))
        for module in package.rglob("*.py")
        if not renderers & set(module.parents) and names_a_kind(module)
    }
    assert found == MODULES_THAT_KNOW_THE_KINDS
