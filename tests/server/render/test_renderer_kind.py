"""Names of renderers; without embreex raster renders, and rays are refused by its name."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import create_ray_caster, read_startup_config
from catoptra_server.frames import renderers as renderer_choice
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.render.raster import device as gl_device
from catoptra_server.render.renderer_kind import RENDERER_NAMES, RendererKind, has_embreex
from catoptra_server.world.scene_mesh import build_scene
from helpers.opengl import device_or_skip
from helpers.worlds import make_test_world


def test_names_are_auto_and_every_kind() -> None:
    assert RENDERER_NAMES == ("auto", "trace", "raster")


def test_faces_belong_to_raster_alone() -> None:
    assert [kind for kind in RendererKind if kind.uses_faces] == [RendererKind.RASTER]


def test_names_are_imported_without_numpy() -> None:
    # The doctor's command line reads them on machines where NumPy cannot be imported.
    program = (
        "import sys; import catoptra_server.render.renderer_kind; sys.exit('numpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


WORLD = make_test_world()
SCENE = build_scene(WORLD)


@pytest.fixture
def _without_embreex(monkeypatch: pytest.MonkeyPatch) -> None:
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, package=None: None if name == "embreex" else find_spec(name, package),
    )


def test_embreex_is_found_where_it_is_installed() -> None:
    assert has_embreex()


@pytest.mark.usefixtures("_without_embreex")
def test_trace_without_embreex_names_the_package_and_the_remedy() -> None:
    with pytest.raises(
        RendererUnavailableError, match=r"needs the package embreex.*pip install embreex.*raster"
    ):
        choose_renderer("trace", SCENE, WORLD)


@pytest.mark.usefixtures("_without_embreex")
@pytest.mark.parametrize("is_reproducible", [False, True])
def test_auto_without_embreex_renders_by_raster_alone(
    monkeypatch: pytest.MonkeyPatch, is_reproducible: bool
) -> None:
    device_or_skip().close()
    monkeypatch.setattr(renderer_choice, "_GPU_FILES", ("/dev/absent*",))
    choice = choose_renderer("auto", SCENE, WORLD, is_reproducible=is_reproducible)
    assert choice.kind is RendererKind.RASTER
    assert "embreex" in choice.reason
    pool = RendererPool(choice)
    assert pool.create_candidates("") == [RendererKind.RASTER]
    pool.close()


@pytest.mark.usefixtures("_without_embreex")
def test_auto_with_neither_names_both_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl_device, "EGL_LIBRARY", "libabsent.so.1")
    with pytest.raises(RendererUnavailableError, match=r"libabsent.*embreex"):
        choose_renderer("auto", SCENE, WORLD)


@pytest.mark.usefixtures("_without_embreex")
def test_robot_with_range_sensors_is_refused_with_the_sensors_and_the_package() -> None:
    robot, world = find_configuration("robots", "p2at"), find_configuration("worlds", "corridor")
    with pytest.raises(RendererUnavailableError, match=r"USARBot\.P2AT.*Scanner1.*package embreex"):
        create_ray_caster(read_startup_config([robot], world))


@pytest.mark.usefixtures("_without_embreex")
def test_robot_without_range_sensors_is_served() -> None:
    robot = find_configuration("robots", "p2at_omni")
    caster = create_ray_caster(read_startup_config([robot], find_configuration("worlds", "rescue")))
    with pytest.raises(RendererUnavailableError, match="a ray in the scene"):
        caster.distances(SCENE.normals[:1], SCENE.normals[:1])
