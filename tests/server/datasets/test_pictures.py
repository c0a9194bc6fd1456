"""Channels as pictures for people, and the page of samples."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_server.datasets import pictures as pictures_module
from catoptra_server.datasets.pictures import write_sheet
from catoptra_server.datasets.png_files import decode_png
from helpers.dataset_recipes import write_drive
from helpers.drawn_datasets import draw_dataset, make_sample, write_dataset


def decode_pictures(page: str) -> dict[str, np.ndarray]:
    """Pictures of a page of one sample by their names."""
    found = re.findall(r'alt="(\w+)" src="data:image/png;base64,([^"]+)', page)
    return {name: decode_png(base64.b64decode(content)) for name, content in found}


def draw_picture(folder: Path, name: str, array: object) -> np.ndarray:
    """Picture of a channel with these values, on the page of a data set of one sample."""
    values = np.asarray(array, LABEL_CHANNELS[name].dtype)
    rgb = np.zeros((*values.shape[:2], 3), np.uint8)
    write_dataset(folder, make_sample("000000", rgb, {name: values}))
    return decode_pictures(write_sheet(folder).read_text(encoding="utf-8"))[name]


@pytest.mark.parametrize("name", LABEL_CHANNELS)
def test_nothing_is_black(tmp_path: Path, name: str) -> None:
    channel = LABEL_CHANNELS[name]
    picture = draw_picture(tmp_path, name, np.full(channel.shape(3, 4), channel.nothing))
    assert picture.shape == (3, 4, 3)
    assert not picture.any()


def test_near_is_brighter_than_far(tmp_path: Path) -> None:
    near, far, nothing = draw_picture(tmp_path, "range", [[0.5, 5.0, np.inf]])[0, :, 0].tolist()
    assert near > far > nothing == 0


def test_objects_differ_in_colour(tmp_path: Path) -> None:
    assert len(np.unique(draw_picture(tmp_path, "ids", [range(1, 40)])[0], axis=0)) == 39


def test_flow_has_its_direction_as_hue_and_rest_is_grey(tmp_path: Path) -> None:
    flow = [[[4, 0], [-4, 0], [0, 0], [np.nan, np.nan]]]
    right, left, rest, unknown = draw_picture(tmp_path, "flow", flow)[0].tolist()
    assert right == [255, 40, 40]
    assert left == [40, 255, 255]
    assert rest == [40, 40, 40]
    assert unknown == [0, 0, 0]


def test_boxes_are_drawn_inside_the_picture_alone(tmp_path: Path) -> None:
    first, second = (
        {"id": number, "name": "", "class": "", "area_px": 1, "box_px": box}
        for number, box in ((1, [2, 1, 6, 4]), (2, [0, 0, 8, 6]))
    )
    ids = np.zeros((6, 8), np.uint16)
    ids[0, :2] = 1, 2
    sample = make_sample(
        "000000", np.zeros((6, 8, 3), np.uint8), {"ids": ids}, objects=[first, second]
    )
    write_dataset(tmp_path, sample)
    pictures = decode_pictures(write_sheet(tmp_path).read_text(encoding="utf-8"))
    assert not pictures["picture"].any(), "the picture itself is unchanged"
    colours, boxes = pictures["ids"][0], pictures["boxes"]
    np.testing.assert_array_equal(boxes[1, 3], colours[0])
    np.testing.assert_array_equal(boxes[5, 7], colours[1])
    assert not boxes[3, 4].any()


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


def list_shown_keys(folder: Path, num_samples: int) -> list[int]:
    """Numbers of the samples on the page of a data set."""
    rgb = np.zeros((1, 1, 3), np.uint8)
    write_dataset(folder, *(make_sample(f"{index:06d}", rgb, {}) for index in range(num_samples)))
    page = write_sheet(folder).read_text(encoding="utf-8")
    return [int(key) for key in re.findall(r"<h2>(\d+):", page)]


def test_page_shows_most_cameras_of_a_recipe_that_has_as_many_as_samples_fit(
    tmp_path: Path,
) -> None:
    indices = list_shown_keys(tmp_path / "many", 264)
    assert [index // 11 for index in indices] == list(range(24))
    assert len({index % 22 for index in indices}) > 10
    assert list_shown_keys(tmp_path / "few", 3) == [0, 1, 2]


def test_unfinished_data_set_has_no_page(tmp_path: Path) -> None:
    with pytest.raises(CatoptraError, match="no manifest"):
        write_sheet(tmp_path)
