"""Differences in grey levels, beside the picture."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.frames.frame import append_difference


def test_difference_is_absolute_and_to_the_right_of_the_picture() -> None:
    rgb = np.array([[[10, 0, 255], [5, 5, 5]]], dtype=np.uint8)
    reference = np.array([[[0, 255, 255], [5, 5, 5]]], dtype=np.uint8)
    image, difference = append_difference(rgb, reference, "exact")
    assert image[:, :2].tolist() == rgb.tolist()
    assert image[:, 2:].tolist() == [[[10, 255, 0], [0, 0, 0]]]
    assert (difference.reference_plan, difference.max_levels) == ("exact", 255)
    assert difference.rms_levels == pytest.approx(math.sqrt((10**2 + 255**2) / 6))
    assert difference.changed_fraction == 0.5
    assert not image.flags.writeable


def test_equal_images_do_not_differ() -> None:
    rgb = np.full((2, 3, 3), 7, dtype=np.uint8)
    _, difference = append_difference(rgb, rgb, "")
    numbers = (difference.max_levels, difference.rms_levels, difference.changed_fraction)
    assert numbers == (0, 0.0, 0.0)
