"""Channels as pictures for people."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.labels.channels import LABEL_CHANNELS
from catoptra_server.datasets.pictures import colour_channel, colour_of_number, draw_boxes


@pytest.mark.parametrize("name", LABEL_CHANNELS)
def test_nothing_is_black(name: str) -> None:
    channel = LABEL_CHANNELS[name]
    array = np.full(channel.shape(3, 4), channel.nothing, dtype=channel.dtype)
    picture = colour_channel(name, array)
    assert picture.shape == (3, 4, 3)
    assert picture.dtype == np.uint8
    assert not picture.any()


def test_near_is_brighter_than_far() -> None:
    picture = colour_channel("range", np.array([[0.5, 5.0, np.inf]], dtype=np.float32))
    near, far, nothing = picture[0, :, 0].tolist()
    assert near > far > nothing == 0


def test_objects_differ_and_keep_their_colour() -> None:
    colours = {colour_of_number(number) for number in range(1, 40)}
    assert len(colours) == 39
    ids = np.array([[3, 0]], dtype=np.uint16)
    assert tuple(colour_channel("ids", ids)[0, 0].tolist()) == colour_of_number(3)
    assert colour_of_number(0) == (0, 0, 0)


def test_flow_has_its_direction_as_hue_and_rest_is_grey() -> None:
    flow = np.array([[[4, 0], [-4, 0], [0, 0], [np.nan, np.nan]]], dtype=np.float32)
    right, left, rest, unknown = colour_channel("flow", flow)[0].tolist()
    assert right == [255, 40, 40]
    assert left == [40, 255, 255]
    assert rest == [40, 40, 40]
    assert unknown == [0, 0, 0]


def test_boxes_are_drawn_inside_the_picture_alone() -> None:
    rgb = np.zeros((6, 8, 3), np.uint8)
    picture = draw_boxes(
        rgb, [{"id": 1, "box_px": [2, 1, 6, 4]}, {"id": 2, "box_px": [0, 0, 8, 6]}]
    )
    assert not rgb.any(), "the picture itself is unchanged"
    assert tuple(picture[1, 3].tolist()) == colour_of_number(1)
    assert tuple(picture[5, 7].tolist()) == colour_of_number(2)
    assert not picture[3, 4].any()
