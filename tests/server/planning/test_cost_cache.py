"""Costs are stored by their conditions, and no content of the cache folder does harm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.frames.plan import costs as cost_cache
from catoptra_server.frames.plan.costs import CostCache, default_cache_folder, hash_scene
from catoptra_server.render.render_settings import PerPixel
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.scene_mesh import build_scene
from helpers.standing_things import bake_scene, make_box_world
from helpers.worlds import make_omni_camera, make_test_world

SCENE = build_scene(make_test_world())
CAMERA = make_omni_camera(width_px=64)
RATES = {"raster": {"faces": (1.0, 2.5, 0.0), "readback": (0.25, 0.0)}}


def test_stored_rates_are_read_again(tmp_path: Path) -> None:
    key = CostCache(tmp_path / "deep/costs", SCENE).make_key("llvmpipe", CAMERA, PerPixel())
    CostCache(tmp_path / "deep/costs", SCENE).write(key, RATES)
    assert CostCache(tmp_path / "deep/costs", SCENE).read(key) == RATES
    assert [path.suffix for path in (tmp_path / "deep/costs").iterdir()] == [".json"]


def test_key_depends_on_everything_that_costs_depend_on(tmp_path: Path) -> None:
    cache = CostCache(tmp_path, SCENE)
    exact, split = PerPixel(), Tessellation(8, 8)
    other = CostCache(tmp_path, replace(SCENE, corners=SCENE.corners + 1.0))
    keys = {
        cache.make_key("a", CAMERA, exact),
        cache.make_key("b", CAMERA, exact),
        cache.make_key("a", make_omni_camera(width_px=65), exact),
        cache.make_key("a", CAMERA, split),
        other.make_key("a", CAMERA, exact),
    }
    assert len(keys) == 5


@pytest.mark.parametrize("text", ["", "[]", "[1]", '{"raster": 3}', '{"raster": {"a": ["x"]}}'])
def test_malformed_file_reads_as_absent(tmp_path: Path, text: str) -> None:
    (tmp_path / "key.json").write_text(text)
    assert not CostCache(tmp_path, SCENE).read("key")


def test_unwritable_cache_is_logged_only(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("in the way")
    CostCache(tmp_path / "file", SCENE).write("key", RATES)
    assert "cannot be stored" in caplog.text


def test_cache_without_a_folder_stores_nothing() -> None:
    CostCache(None, SCENE).write("key", RATES)
    assert CostCache(None, SCENE).read("key") is None


def test_digest_of_a_scene_follows_its_content() -> None:
    assert hash_scene(SCENE) == hash_scene(build_scene(make_test_world()))


def test_digest_of_a_scene_follows_the_colours_of_its_corners() -> None:
    coloured = replace(SCENE, corner_albedo=np.zeros_like(SCENE.corners))
    assert hash_scene(coloured) != hash_scene(SCENE)


def test_digest_of_a_scene_counts_its_ambient_occlusion() -> None:
    occluded = bake_scene(make_box_world())
    assert occluded.occlusion is not None
    assert hash_scene(occluded) != hash_scene(replace(occluded, occlusion=None))


def test_default_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert default_cache_folder() == Path("/somewhere/catoptra/costs")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative paths are invalid")
    assert default_cache_folder() == Path.home() / ".cache/catoptra/costs"


@pytest.mark.parametrize(
    ("cpu_info", "name"),
    [
        ("processor : 0\nmodel name : X 1\n", None),
        ("processor : 0\n", "aarch64"),
        (None, "aarch64"),
    ],
)
def test_processor_that_the_kernel_names_needs_no_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cpu_info: str | None, name: str | None
) -> None:
    def run_a_process() -> str:
        assert name is not None, "a process of its own for what a file says"
        return name

    if cpu_info is not None:
        (tmp_path / "cpuinfo").write_text(cpu_info)
    monkeypatch.setattr(cost_cache, "_CPU_INFO", tmp_path / "cpuinfo")
    monkeypatch.setattr(cost_cache.platform, "processor", run_a_process)
    assert len(CostCache(None, build_scene(make_test_world())).make_key_of("fact")) == 32
