"""Bound of mirrored light: never below what a mirrored surface of any brightness changes."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from catoptra_server.effects import SceneSummary
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.effects.scene.gloss import Gloss
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import SurfaceGloss
from helpers.worlds import CAMERA_STATE, make_omni_camera, make_test_world

CAMERA = make_omni_camera()


def test_gloss_when_nothing_is_glossy_is_proved_off() -> None:
    bound = Gloss().bound(SceneSummary(50.0), CAMERA)
    assert (bound.value, bound.reason) == (0.0, "no surface is glossy")
    assert build_scene(make_test_world()).max_fresnel == 0.0


@pytest.mark.parametrize("gains", [(1.0, 1.0), (0.2, 3.0)])
@pytest.mark.parametrize("brightest", [0.01, 0.8, 40.0])
@pytest.mark.parametrize("part", [0.02, 0.9, 1.0])
def test_bound_covers_every_mirrored_radiance(
    part: float, brightest: float, gains: tuple[float, float]
) -> None:
    summary = replace(SceneSummary(brightest, max_fresnel=part), gains=gains)
    bound = Gloss().bound(summary, CAMERA).value
    levels = np.linspace(0.0, brightest, 41)
    for fresnel, own in product(np.linspace(0.0, part, 5), levels):
        mirrored = own + fresnel * (levels - own)
        changes = find_changes(mirrored[:, None], np.full((41, 1), own), gains)
        assert changes.max() <= bound + 1e-9


def test_largest_reflectance_is_that_at_a_grazing_angle() -> None:
    world = make_test_world()
    material = world.items[0].material
    assert material is not None
    glossy = replace(material, gloss=SurfaceGloss(0.04, 0.3))
    items = (replace(world.items[0], material=glossy), *world.items[1:])
    assert build_scene(replace(world, items=items)).max_fresnel == pytest.approx(0.7)
    assert Gloss().apply_to_scene(CAMERA_STATE, 0.0).has_gloss
