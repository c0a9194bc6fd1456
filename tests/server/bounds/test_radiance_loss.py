from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.bounds.light import grey_level_change, max_visible_loss
from catoptra_server.effects.effect import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.effects.kernels.light import grey_level


def rows(*values: float) -> np.ndarray:
    return np.array(values)[:, None] * np.array((1.0, 0.5, 0.25))


def test_equal_losses_are_most_visible_in_the_dark() -> None:
    worst = max_visible_loss(rows(0.2, 0.2), rows(0.5, 0.1), can_be_darker=np.zeros(2, dtype=bool))
    assert worst == ShadowLoss(0.2, 0.1)


def test_loss_beyond_white_counts_as_darkened_by_a_texture() -> None:
    lost, left = rows(2.0), rows(2.0)
    assert grey_level_change(
        max_visible_loss(lost, left, can_be_darker=np.array([False]))
    ) == pytest.approx(255.0 - grey_level(0.5))
    white = max_visible_loss(lost, left, can_be_darker=np.array([True]))
    assert white == ShadowLoss(0.5, 0.5)


def test_loss_without_light_is_none() -> None:
    assert max_visible_loss(rows(0.0), rows(1.0), can_be_darker=np.array([True])) == NO_SHADOW_LOSS
    none = np.zeros((0, 3))
    assert max_visible_loss(none, none, can_be_darker=np.zeros(0, dtype=bool)) == NO_SHADOW_LOSS
