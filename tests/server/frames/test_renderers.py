"""Renderers are created on demand, made anew, and replaced."""

from __future__ import annotations

import ast
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import catoptra_server
from catoptra_protocol.errors import DomainError, RendererUnavailableError
from catoptra_server.frames import renderers as renderer_choice
from catoptra_server.frames.renderers import (
    RendererChoice,
    RendererPool,
    choose_renderer,
    open_image_changer,
)
from catoptra_server.render import raster
from catoptra_server.render.raster import OpenGLMissingError
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.scene_mesh import build_scene
from helpers.image_changers import open_changer_or_skip
from helpers.opengl import device_or_skip
from helpers.worlds import make_test_world

WORLD = make_test_world()
SCENE = build_scene(WORLD)


LLVMPIPE, GPU = "llvmpipe (LLVM 15)", "NVIDIA H200"
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def choose(requested: str, *, is_reproducible: bool = False) -> RendererChoice:
    choice = choose_renderer(requested, SCENE, WORLD, threads=1, is_reproducible=is_reproducible)
    choice.renderer.close()
    return choice


@pytest.fixture
def _no_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raster.device, "EGL_LIBRARY", "libabsent.so.1")


@pytest.fixture
def _with_gpu_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer_choice, "_GPU_FILES", ("/dev/null",))


@pytest.fixture
def _without_gpu_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer_choice, "_GPU_FILES", ("/dev/absent*",))


def test_trace_when_requested_is_chosen() -> None:
    choice = choose("trace")
    assert choice.kind is TRACE
    assert choice.reason == "requested"


def test_raster_when_requested_is_chosen() -> None:
    device_or_skip().close()
    assert choose("raster").kind is RASTER


@pytest.mark.usefixtures("_no_opengl")
def test_raster_without_opengl_names_library_and_packages() -> None:
    with pytest.raises(RendererUnavailableError, match=r"libabsent.so.1 .* libgl1-mesa-dri"):
        choose("raster")


@pytest.mark.usefixtures("_with_gpu_files", "_no_opengl")
def test_auto_with_a_graphics_processor_but_no_opengl_traces() -> None:
    assert choose("auto").kind is TRACE


@pytest.mark.usefixtures("_with_gpu_files")
@pytest.mark.parametrize(("name", "kind"), [(GPU, RASTER), (LLVMPIPE, TRACE)])
def test_auto_takes_raster_on_a_graphics_processor(
    name: str, kind: RendererKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = replace(device_or_skip(), renderer=name)
    monkeypatch.setattr(raster, "open_device", lambda: device)
    choice = choose("auto")
    device.close()
    assert choice.kind is kind
    assert (name in choice.reason) == (kind is RASTER)


@pytest.mark.usefixtures("_without_gpu_files")
def test_auto_without_a_graphics_processor_traces() -> None:
    choice = choose("auto")
    assert (choice.kind, choice.reason) == (TRACE, "no graphics processor")


def test_reproducible_choice_looks_at_no_property_of_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reasons = []
    for gpu_files in (("/dev/null",), ("/dev/absent*",)):
        monkeypatch.setattr(renderer_choice, "_GPU_FILES", gpu_files)
        reasons.append(choose("auto", is_reproducible=True).reason)
    assert reasons[0] == reasons[1]


def test_auto_offers_the_other_renderer_in_its_place() -> None:
    assert set(choose("auto").factories) == set(RendererKind)


@pytest.mark.usefixtures("_without_gpu_files")
def test_auto_that_traces_does_not_load_opengl() -> None:
    program = (
        "import sys; from catoptra_server.frames import renderers as module;"
        "module._GPU_FILES = ();"
        "from catoptra_server.world.world_description import World;"
        "from catoptra_server.world.scene_mesh import build_scene;"
        "world = World('empty', ());"
        "module.choose_renderer('auto', build_scene(world), world, is_reproducible=True);"
        "sys.exit('moderngl' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_renderer_when_requested_by_name_is_replaced_by_no_other() -> None:
    assert set(choose("trace").factories) == {TRACE}


def test_unknown_renderer_is_rejected_with_the_existing_names() -> None:
    with pytest.raises(DomainError, match="auto, trace or raster, not 'vulkan'"):
        choose("vulkan")


def test_trace_does_not_load_opengl() -> None:
    program = (
        "import sys; from catoptra_server.frames.renderers import choose_renderer;"
        "from catoptra_server.world.world_description import World;"
        "from catoptra_server.world.scene_mesh import build_scene;"
        "world = World('empty', ()); choose_renderer('trace', build_scene(world), world);"
        "sys.exit('moderngl' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_kernel_applies_image_effects() -> None:
    with ExitStack() as stack:
        open_changer_or_skip(stack)
        changer = open_image_changer(threads=2)
        stack.callback(changer.close)
        assert changer.description == "the native kernel"


def test_numpy_applies_image_effects_where_the_kernel_is_missing(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("CATOPTRA_KERNEL", "off")
    changer = open_image_changer()
    assert changer.description == "NumPy"
    assert "CATOPTRA_KERNEL=off" in caplog.text
    assert caplog.text.count("image effects in NumPy") == 1
    changer.close()


def test_error_of_a_missing_opengl_is_a_renderer_unavailable_error() -> None:
    assert issubclass(OpenGLMissingError, RendererUnavailableError)


# Beside the renderers themselves: their names, creation, settings, stages and checks.
MODULES_THAT_KNOW_THE_KINDS = {
    "commands/doctor/devices.py",
    "frames/plan/planner.py",
    "frames/plan/costs.py",
    "frames/renderers.py",
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


def test_kinds_of_renderers_are_distinguished_in_five_modules() -> None:
    package = Path(catoptra_server.__file__).parent
    renderers = {package / "render" / kind.value for kind in RendererKind}
    found = {
        str(module.relative_to(package))
        for module in package.rglob("*.py")
        if not renderers & set(module.parents) and names_a_kind(module)
    }
    assert found == MODULES_THAT_KNOW_THE_KINDS


class PooledRenderer:
    """Logs its creation and its end."""

    def __init__(self, log: list[str], name: str) -> None:
        self._log, self._name = log, name
        log.append(f"create {name}")

    def describe(self) -> str:
        return self._name

    def close(self) -> None:
        self._log.append(f"close {self._name}")


def make_pool(log: list[str], *, named: bool = False, may_replace: bool = True) -> RendererPool:
    def create_trace() -> Any:
        return PooledRenderer(log, "trace")

    def create_raster() -> Any:
        return PooledRenderer(log, "raster")

    alternatives = {} if named else {RASTER: create_raster}
    choice = RendererChoice(create_trace(), TRACE, "test", {TRACE: create_trace, **alternatives})
    return RendererPool(choice, may_replace=may_replace)


def test_alternative_is_created_at_its_first_use() -> None:
    log: list[str] = []
    pool = make_pool(log)
    assert pool.get(TRACE) is pool.get(TRACE)
    assert log == ["create trace"]
    assert pool.get(RASTER) is pool.get(RASTER)
    pool.close()
    assert log == ["create trace", "create raster", "close trace", "close raster"]


def test_renewed_renderer_is_closed_at_once_and_created_at_the_next_use() -> None:
    log: list[str] = []
    pool = make_pool(log)
    before = pool.get(TRACE)
    pool.renew(TRACE)
    assert log == ["create trace", "close trace"]
    assert pool.get(TRACE) is not before
    pool.renew(RASTER)
    assert log[2:] == ["create trace"]


def test_renderer_without_a_factory_is_kept() -> None:
    log: list[str] = []
    renderer: Any = PooledRenderer(log, "trace")
    pool = RendererPool(RendererChoice(renderer, TRACE, "test"))
    pool.renew(TRACE)
    assert pool.get(TRACE) is renderer
    assert log == ["create trace"]


def test_all_renderers_that_can_be_created_are_usable(caplog: pytest.LogCaptureFixture) -> None:
    log: list[str] = []

    def fail() -> Any:
        raise RendererUnavailableError("no OpenGL")

    beside_gpu = make_pool(log)
    beside_gpu.default_kind = RASTER
    assert beside_gpu.create_candidates("") == [TRACE, RASTER]
    assert make_pool(log).create_candidates("") == [TRACE]
    renderer: Any = PooledRenderer(log, "trace")
    pool = RendererPool(RendererChoice(renderer, TRACE, "test", {RASTER: fail}))
    with caplog.at_level("INFO"):
        assert pool.create_candidates("raster") == []
        assert pool.create_candidates("raster") == [TRACE]
    assert caplog.text.count("raster is not available: no OpenGL") == 1


def test_replacement_is_the_other_kind_and_can_be_undone() -> None:
    pool = make_pool([])
    assert pool.find_replacement(TRACE) is RASTER
    pool.replace(TRACE, RASTER)
    assert pool.default_kind is RASTER
    assert pool.reason == "raster in place of trace, which failed: test"
    assert pool.create_candidates("") == [RASTER]
    assert pool.find_replacement(RASTER) is None
    pool.restore(TRACE)
    assert (pool.default_kind, pool.reason) == (TRACE, "test")


def test_replacement_of_an_alternative_leaves_the_default() -> None:
    pool = make_pool([])
    pool.replace(RASTER, TRACE)
    assert pool.default_kind is TRACE
    assert pool.create_candidates("") == [TRACE]


@pytest.mark.parametrize("settings", [{"named": True}, {"may_replace": False}], ids=str)
def test_renderer_by_name_or_under_lockstep_is_not_replaced(settings: dict[str, bool]) -> None:
    assert make_pool([], **settings).find_replacement(TRACE) is None


def test_usable_renderers_are_those_that_exist_or_can_be_created_and_were_not_replaced() -> None:
    pool = make_pool([])
    assert [pool.is_usable(kind) for kind in (TRACE, RASTER)] == [True, True]
    assert pool.describe(RASTER) == "raster"
    pool.replace(TRACE, RASTER)
    assert [pool.is_usable(kind) for kind in (TRACE, RASTER)] == [False, True]
    assert not make_pool([], named=True).is_usable(RASTER)
