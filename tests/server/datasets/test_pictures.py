"""Channels as pictures for people, and the page of samples."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels.channels import LABEL_CHANNELS
from catoptra_server.datasets import pictures as pictures_module
from catoptra_server.datasets.pictures import (
    choose_indices,
    colour_channel,
    draw_boxes,
    write_sheet,
)
from catoptra_server.datasets.png_files import decode_png
from helpers.dataset_recipes import write_drive
from helpers.drawn_datasets import draw_dataset


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


def colour_of_number(number: int) -> tuple[int, ...]:
    return tuple(colour_channel("ids", np.array([[number]], dtype=np.uint16))[0, 0].tolist())


def test_objects_differ_in_colour() -> None:
    assert len({colour_of_number(number) for number in range(1, 40)}) == 39


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


def test_page_has_all_channels_of_samples_spread_over_the_data_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = draw_dataset(write_drive(tmp_path), tmp_path / "out")
    monkeypatch.setattr(pictures_module, "NUM_SAMPLES", 3)
    page = write_sheet(folder).read_text(encoding="utf-8")
    HTMLParser().feed(page)
    keys = [int(key) for key in re.findall(r"<h2>(\d+):", page)]
    assert [key // 2 for key in keys] == [0, 1, 2], "one of each third"
    names = re.findall(r"<figcaption>(\w+)", page)
    assert names == ["picture", "boxes", *LABEL_CHANNELS] * 3
    pictures = [decode_png(base64.b64decode(one)) for one in re.findall(r"base64,([^\"]+)", page)]
    assert {picture.shape for picture in pictures} == {(64, 64, 3)}
    assert all(picture.any() for picture in pictures)
    assert "<script" not in page
    assert "http" not in page, "nothing is fetched"


def test_page_shows_most_cameras_of_a_recipe_that_has_as_many_as_samples_fit() -> None:
    indices = choose_indices(264)
    assert [index // 11 for index in indices] == list(range(24))
    assert len({index % 22 for index in indices}) > 10
    assert choose_indices(3) == [0, 1, 2]


def test_unfinished_data_set_has_no_page(tmp_path: Path) -> None:
    with pytest.raises(CatoptraError, match="no manifest"):
        write_sheet(tmp_path)
