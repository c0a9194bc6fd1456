"""The table of effects, and what holds for all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects import EFFECTS
from catoptra_server.effects.effect import EffectWishes, Mode, Wish, floats
from catoptra_server.effects.frame_key import FrameKey
from helpers.effects import CAMERA, CAPTURE, KEY, PICTURE_EFFECTS, card, effect_of

NAMES = PICTURE_EFFECTS


def test_table_names_each_effect_once_as_it_names_itself() -> None:
    names = [kind.name for kind in EFFECTS]
    assert len(set(names)) == len(names)
    for kind in EFFECTS:
        assert kind.make(**{p.field: p.default for p in kind.parameters}).name == kind.name


def test_table_when_read_has_what_changes_the_scene_before_what_changes_its_picture() -> None:
    names = [kind.name for kind in EFFECTS]
    assert names[len(names) - len(PICTURE_EFFECTS) :] == PICTURE_EFFECTS


@pytest.mark.parametrize("name", [kind.name for kind in EFFECTS])
def test_default_when_checked_lies_within_its_range(name: str) -> None:
    kind = next(kind for kind in EFFECTS if kind.name == name)
    assert all(p.at_least <= p.default <= p.at_most for p in kind.parameters)


@pytest.mark.parametrize("name", NAMES)
def test_effect_when_applied_leaves_its_picture_alone_and_keeps_its_type(name: str) -> None:
    effect, light = effect_of(name), card(2.0).astype(np.float32)
    before = light.copy()
    after = effect.apply(light, CAMERA, CAPTURE)
    assert after.dtype == np.float32
    assert after.shape == light.shape
    np.testing.assert_array_equal(light, before)


@pytest.mark.parametrize("name", NAMES)
def test_float32_when_compared_with_the_reference_agrees(name: str) -> None:
    effect, light = effect_of(name), card(2.0).astype(np.float32)
    reference = effect.apply(light.astype(np.float64), CAMERA, CAPTURE)
    # A code of the converter at most, elsewhere float32.
    limit = 1.01 / 4095.0 if name == "Quantisation" else 1e-5
    assert np.abs(effect.apply(light, CAMERA, CAPTURE) - reference).max() < limit


def test_effects_are_hashable_so_that_decisions_can_be_kept() -> None:
    assert len({effect_of(name) for name in NAMES}) == len(NAMES)
    assert replace(KEY, index=4) == FrameKey(KEY.camera, 4)


def test_uniform_when_made_is_float32() -> None:
    assert floats(0.5, 2.0).dtype == np.float32


def test_wishes_when_equal_are_looked_up_by_each_other() -> None:
    one, other = (EffectWishes((Wish(effect_of("Bayer"), Mode.AUTO),), 0.25) for _ in range(2))
    assert (one, hash(one)) == (other, hash(other))
    assert replace(one, threshold_px=2.0) != one
