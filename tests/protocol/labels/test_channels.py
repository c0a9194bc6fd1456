"""Channels of ground truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.labels import LABEL_CHANNELS, LabelledObject, parse_channels
from catoptra_protocol.optics.transforms import Pose


def test_channels_are_listed_in_the_order_of_the_table() -> None:
    assert [channel.name for channel in parse_channels(("ids", "range"))] == ["range", "ids"]


@pytest.mark.parametrize(
    ("names", "message"),
    [(("depth",), "'depth': the channels are range"), (("ids", "ids"), "twice")],
)
def test_unknown_and_repeated_channels_are_rejected(names: tuple[str, ...], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        parse_channels(names)


@pytest.mark.parametrize("channel", LABEL_CHANNELS.values(), ids=lambda channel: channel.name)
def test_values_of_nothing_fit_the_type(channel) -> None:
    image = np.full(channel.shape(2, 3), channel.nothing, dtype=channel.dtype)
    assert image.shape[:2] == (2, 3)
    assert np.array_equal(
        image.astype(float), np.full_like(image, channel.nothing, dtype=float), equal_nan=True
    )


def test_corners_of_a_turned_box() -> None:
    pose = Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, 0.5 * math.pi))
    box = LabelledObject(1, "crate", "crate", 1, pose, np.array([0.5, 0.25, 0.125]))
    corners = box.corners()
    # Row 1 is positive along the box's x axis alone, which points along the world's y.
    np.testing.assert_allclose(corners[1], (1.25, 2.5, 2.875), atol=1e-12)
    np.testing.assert_allclose(corners.mean(axis=0), (1.0, 2.0, 3.0), atol=1e-12)
