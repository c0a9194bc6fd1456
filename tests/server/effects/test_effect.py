"""The table of effects, and properties of all effects."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects import (
    EFFECT_TYPES,
    NUM_RINGS,
    EffectMode,
    EffectSetting,
    EffectSettings,
    SceneSummary,
    is_image_effect,
    is_scene_effect,
)
from catoptra_server.effects.kernels.grey_levels import FRAME_NOISE_EFFECTS
from catoptra_server.world.objects import NoiseSeed
from helpers.configs import REPOSITORY
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    IMAGE_EFFECTS,
    NOISE_SEED,
    assert_summary_bounds_effect,
    make_any_effect,
    make_effect,
    make_test_pattern,
)

NAMES = IMAGE_EFFECTS


def test_table_names_each_effect_as_it_names_itself() -> None:
    for name, kind in EFFECT_TYPES.items():
        assert kind.name == name
        assert kind.factory(**{p.field: p.default for p in kind.parameters}).name == name


def test_table_when_read_has_what_changes_the_scene_before_what_changes_its_image() -> None:
    names = [*EFFECT_TYPES]
    assert names[len(names) - len(IMAGE_EFFECTS) :] == IMAGE_EFFECTS


@pytest.mark.parametrize("name", [*EFFECT_TYPES])
def test_default_when_checked_lies_within_its_range(name: str) -> None:
    kind = EFFECT_TYPES[name]
    assert all(p.min_value <= p.default <= p.max_value for p in kind.parameters)


@pytest.mark.parametrize("name", NAMES)
def test_effect_when_applied_leaves_its_image_alone_and_keeps_its_type(name: str) -> None:
    effect, image = make_effect(name), make_test_pattern(2.0).astype(np.float32)
    before = image.copy()
    after = effect.apply(image, CAMERA, CAPTURE_CONTEXT)
    assert after.dtype == np.float32
    assert after.shape == image.shape
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("name", NAMES)
def test_effect_draws_new_numbers_in_each_exposure_only_where_it_is_listed(name: str) -> None:
    # A standing camera without these is not drawn again.
    effect, image = make_effect(name), make_test_pattern(2.0).astype(np.float32)
    seeds = (replace(NOISE_SEED, tick=tick) for tick in (1, 2))
    first, second = (
        effect.apply(image, CAMERA, replace(CAPTURE_CONTEXT, noise_seed=seed)) for seed in seeds
    )
    assert np.array_equal(first, second) == (name not in FRAME_NOISE_EFFECTS)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("ChromaticAberration", {"red_magnification": 1.02, "blue_magnification": 0.985}),
        ("Defocus", {"f_number": 1.0, "pixel_pitch_m": 3e-5}),
        ("DefocusByDepth", {"f_number": 1.0, "pixel_pitch_m": 3e-5}),
        ("Diffraction", {"f_number": 11.0}),
        ("Misalignment", {"x_m": 6e-4, "y_m": -4e-4, "axial_m": 1e-3, "roll_rad": 2e-3}),
        ("MirrorDust", {}),
        ("MirrorReflectance", {}),
        ("MirrorReflectance", {"refractive_index": 2.8, "extinction_coefficient": 3.4}),
        ("Vignetting", {}),
    ],
)
def test_no_pixel_behind_an_effect_is_brighter_than_its_summary(
    name: str, changes: dict[str, float]
) -> None:
    for max_radiance in (2.0, 3.0):
        assert_summary_bounds_effect(make_effect(name, changes), max_radiance)


@pytest.mark.parametrize("name", NAMES)
def test_float32_when_compared_with_the_reference_agrees(name: str) -> None:
    effect, image = make_effect(name), make_test_pattern(2.0).astype(np.float32)
    reference = effect.apply(image.astype(np.float64), CAMERA, CAPTURE_CONTEXT)
    # At most one code of the converter, elsewhere the rounding of float32.
    limit = 1.01 / 4095.0 if name == "Quantisation" else 1e-5
    assert np.abs(effect.apply(image, CAMERA, CAPTURE_CONTEXT) - reference).max() < limit


def test_effects_are_hashable_so_that_decisions_can_be_kept() -> None:
    assert len({make_effect(name) for name in NAMES}) == len(NAMES)
    assert replace(NOISE_SEED, tick=4) == NoiseSeed(NOISE_SEED.camera_key, 4)


def test_settings_when_equal_are_looked_up_by_each_other() -> None:
    one, other = (
        EffectSettings((EffectSetting(make_effect("Bayer"), EffectMode.AUTO),), 0.25)
        for _ in range(2)
    )
    assert (one, hash(one)) == (other, hash(other))
    assert replace(one, threshold_px=2.0) != one


def test_page_of_effects_has_the_folder_of_each() -> None:
    page = (REPOSITORY / "docs" / "EFFECTS.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \|", page, re.MULTILINE)
    folder_of = {name: folder for folder, names in rows for name in re.findall(r"`(\w+)`", names)}
    for effect_type in EFFECT_TYPES.values():
        module = type(make_any_effect(effect_type.name)).__module__
        assert module.split(".")[-2] == folder_of[effect_type.name]


@pytest.mark.parametrize("name", [*EFFECT_TYPES])
def test_effect_when_in_the_folder_scene_changes_the_scene(name: str) -> None:
    effect = make_any_effect(name)
    assert effect.changes_scene == (".effects.scene." in type(effect).__module__)
    assert is_scene_effect(effect) is not is_image_effect(effect)


NEAR = (0.5, *(2.0,) * (NUM_RINGS - 1))
EGO_BODY_DISTANCES_M = (*(0.3,) * 2, *(math.inf,) * (NUM_RINGS - 2))


def test_visible_distance_is_the_nearer_of_scene_and_what_the_camera_carries() -> None:
    summary = SceneSummary(1.0, min_distances_m=NEAR, attached_min_distances_m=EGO_BODY_DISTANCES_M)
    assert summary.visible_min_distances_m == (0.3, 0.3, *(2.0,) * (NUM_RINGS - 2))


def test_visible_distance_when_nothing_is_carried_is_the_scene() -> None:
    assert SceneSummary(1.0, min_distances_m=NEAR).visible_min_distances_m == NEAR
