"""The page of samples."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels.channels import LABEL_CHANNELS
from catoptra_server.datasets import pictures as contact_sheet
from catoptra_server.datasets.pictures import choose_indices, write_sheet
from catoptra_server.datasets.png_files import decode_png
from helpers.dataset_recipes import write_drive
from helpers.drawn_datasets import draw_dataset


def test_page_has_all_channels_of_samples_spread_over_the_data_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = draw_dataset(write_drive(tmp_path), tmp_path / "out")
    monkeypatch.setattr(contact_sheet, "NUM_SAMPLES", 3)
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
