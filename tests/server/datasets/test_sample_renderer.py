"""Samples drawn like served frames, without a trace of other samples."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_server.datasets import sample_renderer
from catoptra_server.datasets.sample import encode_sample
from catoptra_server.frames.renderers import RendererChoice
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    PointLight,
    Rgb,
    World,
    linear_from_srgb,
)
from helpers.dataset_recipes import render_samples, stage_recipe, write_drive, write_recipe


def test_sample_has_the_same_bytes_in_any_order(tmp_path: Path) -> None:
    path = write_drive(tmp_path)
    forward, backward = (
        render_samples(path, 0, 1, 2, 3, 4, 5),
        render_samples(path, 5, 4, 3, 2, 1, 0),
    )
    for one, other in zip(forward, reversed(backward), strict=True):
        assert encode_sample(one) == encode_sample(other)


def test_sample_has_all_channels_in_the_shape_of_the_table(tmp_path: Path) -> None:
    (sample,) = render_samples(write_drive(tmp_path), 0)
    assert sample.rgb.shape == (64, 64, 3)
    assert set(sample.channels) == set(LABEL_CHANNELS)
    for name, array in sample.channels.items():
        assert array.shape == LABEL_CHANNELS[name].shape(64, 64)
        assert array.dtype == np.dtype(LABEL_CHANNELS[name].dtype)
    valid = sample.channels["valid"] == 1
    assert 0.5 < valid.mean() < 0.9, "a disc"
    assert np.isfinite(sample.channels["range"][valid]).mean() > 0.9, "a corridor with a ceiling"
    assert np.isfinite(sample.channels["flow"][valid]).mean() > 0.5
    assert sample.objects


def test_recipe_without_channels_has_none(tmp_path: Path) -> None:
    (sample,) = render_samples(write_drive(tmp_path, lines=()), 0)
    assert not sample.channels
    assert not sample.objects


def test_brighter_lights_make_a_brighter_picture_and_the_same_labels(tmp_path: Path) -> None:
    pictures = []
    for number, factor in enumerate((0.4, 1.0)):
        folder = tmp_path / str(number)
        folder.mkdir()
        lights = ("[Catoptra.Lights]", f"Brightness=(Min={factor},Max={factor},Levels=1)")
        pictures += render_samples(write_recipe(folder, *lights, lines=("Channels=ids",)), 1)
    dark, bright = pictures
    assert dark.rgb.mean() < 0.8 * bright.rgb.mean()
    np.testing.assert_array_equal(dark.channels["ids"], bright.channels["ids"])


def test_worlds_that_come_again_after_others_have_the_same_bytes(tmp_path: Path) -> None:
    # More worlds and brightnesses than renderers are kept of.
    worlds = ("Worlds=warehouse", "Worlds=rescue", "Worlds=four_legged_2006", "Channels=ids,range")
    lights = ("[Catoptra.Lights]", "Brightness=(Min=0.5,Max=1.5,Levels=2)")
    path = write_recipe(tmp_path, *lights, samples=16, lines=worlds)
    samples = render_samples(path, *range(8), *range(8))
    for first, again in zip(samples[:8], samples[8:], strict=True):
        assert encode_sample(first) == encode_sample(again)


@pytest.mark.parametrize("factor", [0.0, 2.0])
def test_all_lights_are_brighter_by_the_factor_and_nothing_else_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    drawn: list[World] = []
    choose_renderer = sample_renderer.choose_renderer

    def note_world(kind: str, scene: SceneMesh, world: World, **settings: Any) -> RendererChoice:
        drawn.append(world)
        return choose_renderer(kind, scene, world, **settings)

    monkeypatch.setattr(sample_renderer, "choose_renderer", note_world)
    brightness = f"Brightness=(Min={factor},Max={factor},Levels=1)"
    path = write_recipe(tmp_path, "[Catoptra.Lights]", brightness, world="rescue")
    render_samples(path, 0)
    world = stage_recipe(path).world(0).world
    sky, sun, lamp, *_ = world.lights
    assert isinstance(sky, HemisphereLight)
    assert isinstance(sun, DirectionalLight)
    assert isinstance(lamp, PointLight)

    def scale(colour: Rgb) -> Rgb:
        red, green, blue = colour
        return factor * red, factor * green, factor * blue

    assert drawn[0].lights[:3] == (
        HemisphereLight(scale(sky.up_irradiance), scale(sky.down_irradiance)),
        replace(sun, irradiance=scale(sun.irradiance)),
        replace(lamp, intensity=scale(lamp.intensity)),
    )
    assert (drawn[0].background, len(drawn[0].items)) == (world.background, len(world.items))


ROOM = """[Catoptra.World]
LightBake=on
Lights=(Type=Rectangle,Position=(X=1,Y=0,Z=-2),Direction=(X=0,Y=0,Z=1),Size=(X=1,Y=1),Group=near)
Lights=(Type=Point,Position=(X=-1,Y=0,Z=-2),Group=far)
Rectangles=(Name="Floor",Size=(X=8,Y=8),Colour=(R=128,G=128,B=128))
PlayerStarts=(Tag="Start",Location=(X=0,Y=0,Z=0),Rotation=(X=0,Y=0,Z=0))
"""


def test_groups_of_lights_vary_apart_without_another_bake(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "room.ini").write_text(ROOM, encoding="utf-8")
    means = {}
    for near, far in product((0.0, 1.0), repeat=2):
        groups = (
            f"Groups=(Name=near,Min={near},Max={near},Levels=1)",
            f"Groups=(Name=far,Min={far},Max={far},Levels=1)",
        )
        path = write_recipe(tmp_path, "[Catoptra.Lights]", *groups, world="room.ini")
        (sample,) = render_samples(path, 0)
        assert sample.metadata["groups"] == {"near": near, "far": far}
        means[near, far] = linear_from_srgb(sample.rgb / 255.0).mean()
        # Of the first one, and nothing later.
        assert len([*(tmp_path / "cache" / "catoptra" / "light").iterdir()]) == 1
    assert min(means[1.0, 0.0], means[0.0, 1.0]) > 2.0 * means[0.0, 0.0]
    both = means[1.0, 0.0] + means[0.0, 1.0] - means[0.0, 0.0]
    assert means[1.0, 1.0] == pytest.approx(both, rel=0.02)
    path = write_recipe(
        tmp_path, "[Catoptra.Lights]", "Groups=(Name=none,Min=1,Max=1)", world="room.ini"
    )
    with pytest.raises(CatoptraError, match="no world has lights of Group=none"):
        _ = stage_recipe(path).digest
