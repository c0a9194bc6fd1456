"""Occlusion maps on disk: read back bit for bit, and harmless whatever a file holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.render.trace.occlusion import baking, light_bake, occlusion_cache
from catoptra_server.render.trace.occlusion.occlusion_cache import (
    find_occlusion,
    hash_scene,
    light_scene,
    wants_occlusion,
)
from catoptra_server.runtime.array_cache import ArrayCache
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shading import OcclusionMap
from catoptra_server.world.world_description import Material, RectangleLight, World
from helpers.standing_things import FLOOR, SKY, make_box_world
from helpers.worlds import DIRECTIONAL_LIGHT

WORLD = replace(make_box_world(), ambient_occlusion=True)
SCENE = build_scene(WORLD)
FIELDS = ("patch_of", "columns_from_world", "rows_from_world", "bounds", "texels", "darkest")


def assert_same(found: OcclusionMap | None, expected: OcclusionMap | None) -> None:
    assert found is not None
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def forbid_baking(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(baking, "bake_occlusion", None)


def test_second_start_reads_the_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    baked = find_occlusion(SCENE, tmp_path)
    forbid_baking(monkeypatch)
    assert_same(find_occlusion(SCENE, tmp_path), baked)
    with pytest.raises(TypeError):
        find_occlusion(SCENE, None)


def test_second_start_of_a_world_without_occlusion_casts_no_rays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = build_scene(World("floor", (FLOOR,), lights=(SKY,)))
    assert find_occlusion(alone, tmp_path) is None
    forbid_baking(monkeypatch)
    assert find_occlusion(alone, tmp_path) is None


def test_other_scene_has_another_file(tmp_path: Path) -> None:
    find_occlusion(SCENE, tmp_path)
    moved = replace(SCENE, corners=SCENE.corners + np.array([0.0, 0.0, 0.1]))
    find_occlusion(moved, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    assert hash_scene(SCENE) != hash_scene(replace(SCENE, casts_shadows=~SCENE.casts_shadows))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("patch_of", np.full(len(SCENE), 99, dtype=np.int32)),
        ("patch_of", np.zeros(3, dtype=np.int32)),
        ("bounds", np.array([[0, 0, 9999, 9999]], dtype=np.int32)),
        ("texels", np.zeros((6, 6), dtype=np.uint8)),
        ("columns_from_world", np.zeros((0, 4))),
    ],
)
def test_map_whose_indices_lead_astray_is_not_used(
    tmp_path: Path, name: str, value: np.ndarray[tuple[int, ...], np.dtype[np.generic]]
) -> None:
    baked = find_occlusion(SCENE, tmp_path)
    assert baked is not None
    arrays = {field: getattr(baked, field) for field in FIELDS if field != "darkest"}
    one = {key: rows[:1] for key, rows in arrays.items() if key not in ("patch_of", "texels")}
    few = {**one, "patch_of": np.zeros(len(SCENE), np.int32), "texels": arrays["texels"]}
    (file,) = tmp_path.iterdir()
    # With a right digest: written by a program that is not ours.
    for foreign, expected in ((few, OcclusionMap(**few)), ({**few, name: value}, baked)):
        ArrayCache(tmp_path).write(file.stem, [foreign[field] for field in occlusion_cache._ARRAYS])
        assert_same(find_occlusion(SCENE, tmp_path), expected)


def test_world_wants_a_map_if_it_says_so_and_could_show_it() -> None:
    assert wants_occlusion(SCENE, WORLD)
    assert not wants_occlusion(SCENE, replace(WORLD, ambient_occlusion=False))
    assert not wants_occlusion(SCENE, replace(WORLD, lights=(DIRECTIONAL_LIGHT,)))
    assert not wants_occlusion(build_scene(World("empty", ())), WORLD)
    assert not wants_occlusion(replace(SCENE, unlit=np.ones(len(SCENE), dtype=bool)), WORLD)


def test_world_of_many_triangles_wants_a_map_if_some_are_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tiny = replace(SCENE, corners=0.01 * SCENE.corners)
    assert wants_occlusion(tiny, WORLD)
    monkeypatch.setattr(occlusion_cache, "MANY_TRIANGLES", len(SCENE) - 1)
    assert wants_occlusion(SCENE, WORLD)
    assert not wants_occlusion(tiny, WORLD)


def test_world_of_unlit_facets_alone_has_no_map() -> None:
    glowing = Material((1.0, 1.0, 1.0), unlit=True)
    items = tuple(replace(item, material=glowing) for item in WORLD.items)
    world = World("glow", items, lights=(SKY,))
    assert not wants_occlusion(build_scene(world), world)


@pytest.mark.parametrize("fault", ["a damaged file", "an unwritable folder"])
def test_faulty_cache_of_light_costs_one_warning_and_changes_nothing(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    lamp = RectangleLight((0.0, 0.0, -2.0), (0.0, 0.0, 1.0), (0.5, 0.5), (1.0, 1.0, 1.0))
    world = replace(make_box_world(), area_lights=(lamp,), light_bake=True)
    scene = build_scene(world)
    monkeypatch.setattr(light_bake, "MAX_NODES", 400)
    monkeypatch.setattr(light_bake, "MAX_PROBES", 8)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    expected = light_scene(scene, world)
    (file,) = (tmp_path / "catoptra/light").iterdir()
    if fault == "a damaged file":
        file.write_bytes(file.read_bytes()[:-1])
    else:
        monkeypatch.setenv("XDG_CACHE_HOME", str(file))
    lit = light_scene(scene, world)
    assert len([one for one in caplog.records if one.levelname == "WARNING"]) == 1
    assert lit.scene.occlusion is not None
    assert expected.scene.occlusion is not None
    np.testing.assert_array_equal(lit.scene.occlusion.texels, expected.scene.occlusion.texels)
    assert lit.world.lights == expected.world.lights
