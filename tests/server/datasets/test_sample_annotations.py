"""Annotations of samples: every object in view, and nothing that depends on other samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_protocol.labels.masks import run_lengths_from_string
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.sample import RenderedSample, SampleDescriber, wants_annotations
from catoptra_server.datasets.sample_renderer import SampleRenderer
from helpers.dataset_recipes import stage_recipe, write_drive


def render(path: Path, *indices: int) -> list[RenderedSample]:
    """Samples of a recipe."""
    stage = stage_recipe(path)
    describer, renderer = SampleDescriber(stage), SampleRenderer(stage)
    try:
        return [renderer.render_sample(describer.describe_sample(index)) for index in indices]
    finally:
        renderer.close()


def test_every_object_in_view_has_a_record_with_its_pixels(tmp_path: Path) -> None:
    for sample in render(write_drive(tmp_path), 0, 2):
        ids = sample.channels["ids"]
        records = {one["id"]: one for one in sample.metadata["objects"]}
        assert set(records) == set(np.unique(ids).tolist()) - {0}
        for number, record in records.items():
            assert record["area_px"] == (ids == number).sum()
            assert 0.0 <= record["occluded_fraction"] <= 1.0
            runs = run_lengths_from_string(record["mask"]["counts"])
            assert sum(runs) == ids.size


def test_annotations_need_neither_stored_ids_nor_a_valid_mask(tmp_path: Path) -> None:
    (sample,) = render(write_drive(tmp_path, lines=("Formats=coco",)), 0)
    assert not sample.channels
    assert sample.metadata["objects"]
    (sample,) = render(write_drive(tmp_path, lines=("Channels=range",)), 0)
    assert "objects" not in sample.metadata


def test_annotations_are_wanted_with_ids_or_for_coco(tmp_path: Path) -> None:
    lines = {("Channels=ids",): True, ("Formats=coco",): True, ("Channels=range",): False}
    for line, expected in lines.items():
        assert wants_annotations(read_recipe(write_drive(tmp_path, lines=line))) is expected
