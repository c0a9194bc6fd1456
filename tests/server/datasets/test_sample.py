"""One sample: described by recipe and index, annotated, with its metadata and files."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_server.datasets.png_files import decode_png
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.sample import (
    RenderedSample,
    SampleDescriber,
    encode_sample,
    wants_annotations,
)
from catoptra_server.datasets.sample_renderer import SampleRenderer
from helpers.dataset_recipes import FISHEYE, render_samples, stage_recipe, write_drive, write_recipe
from helpers.run_lengths import mask_from_string


def test_description_depends_on_recipe_and_index_alone(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path))
    forward, backward = SampleDescriber(stage), SampleDescriber(stage)
    first = [forward.describe_sample(index) for index in range(6)]
    second = [backward.describe_sample(index) for index in reversed(range(6))][::-1]
    for one, other in zip(first, second, strict=True):
        assert (one.key, one.brightness, one.place) == (other.key, other.brightness, other.place)
        assert one.state.noise_seed == other.state.noise_seed
        for state, twin in ((one.state, other.state), (one.next_state, other.next_state)):
            assert state is not None
            assert twin is not None
            np.testing.assert_array_equal(
                state.world_from_mirror.rotation, twin.world_from_mirror.rotation
            )


def test_noise_differs_between_samples(tmp_path: Path) -> None:
    describer = SampleDescriber(stage_recipe(write_drive(tmp_path)))
    assert len({describer.describe_sample(index).state.noise_seed for index in range(6)}) == 6


@pytest.mark.parametrize("model", ["", "paper", "spherical", "equidistant_220"])
def test_robot_is_seen_by_its_own_mirror_and_by_every_camera_in_its_place(
    model: str, tmp_path: Path
) -> None:
    camera = f'Cameras=(Robot="p2at_omni",Model="{model}",Width=64,Height=64)'
    path = write_recipe(tmp_path, cameras=(camera,), lines=("Channels=ids",))
    (sample,) = render_samples(path, 0)
    (robot,) = (one for one in sample.metadata["objects"] if one["class"] == "robot")
    assert robot["area_px"] > 20


def test_robot_is_not_seen_where_the_recipe_leaves_it_out(tmp_path: Path) -> None:
    effects = "[Catoptra.Effects]\nSelfView=never"
    camera = 'Cameras=(Robot="p2at_omni",Model="paper",Width=64,Height=64)'
    path = write_recipe(tmp_path, effects, cameras=(camera, FISHEYE), lines=("Channels=ids",))
    for sample in render_samples(path, 0, 1):
        assert all(one["class"] != "robot" for one in sample.metadata["objects"])


def test_every_object_in_view_has_a_record_with_its_pixels(tmp_path: Path) -> None:
    for sample in render_samples(write_drive(tmp_path), 0, 2):
        ids = sample.channels["ids"]
        records = {one["id"]: one for one in sample.metadata["objects"]}
        assert set(records) == set(np.unique(ids).tolist()) - {0}
        for number, record in records.items():
            assert record["area_px"] == (ids == number).sum()
            assert 0.0 <= record["occluded_fraction"] <= 1.0
            mask = mask_from_string(record["mask"]["counts"], *ids.shape)
            np.testing.assert_array_equal(mask, ids == number)


def test_annotations_need_neither_stored_ids_nor_a_valid_mask(tmp_path: Path) -> None:
    (sample,) = render_samples(write_drive(tmp_path, lines=("Formats=coco",)), 0)
    assert not sample.channels
    assert sample.metadata["objects"]
    (sample,) = render_samples(write_drive(tmp_path, lines=("Channels=range",)), 0)
    assert "objects" not in sample.metadata


def test_annotations_are_wanted_with_ids_or_for_coco(tmp_path: Path) -> None:
    lines = {("Channels=ids",): True, ("Formats=coco",): True, ("Channels=range",): False}
    for line, expected in lines.items():
        assert wants_annotations(read_recipe(write_drive(tmp_path, lines=line))) is expected


def test_metadata_are_json_and_describe_camera_pose_and_light(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path))
    description = SampleDescriber(stage).describe_sample(3)
    renderer = SampleRenderer(stage)
    metadata = json.loads(encode_sample(renderer.render_sample(description))["json"])
    renderer.close()
    assert metadata["key"] == "000003"
    assert (metadata["sequence"], metadata["step"]) == (1, 1)
    assert metadata["world"] == "corridor"
    assert metadata["camera"] == "equidistant_220"
    assert metadata["brightness"] == description.brightness
    assert metadata["plan"].startswith("trace")
    camera, _ = omni_camera_from_pairs(tuple(map(tuple, metadata["camera_model"])))
    assert (camera.width_px, camera.height_px) == (64, 64)
    np.testing.assert_array_equal(
        metadata["world_from_camera"]["position_m"], description.state.world_from_mirror.translation
    )
    np.testing.assert_array_equal(
        metadata["world_from_robot"]["quaternion_xyzw"],
        description.motion.world_from_robot.quaternion,
    )


def test_landmarks_have_the_pixels_of_the_colours_that_show_them(tmp_path: Path) -> None:
    path = write_recipe(
        tmp_path,
        *("[Catoptra.RandomPoses]", "X=(Min=-1,Max=1)", "Y=(Min=-1,Max=1)"),
        world="four_legged_2006",
        lines=("Channels=ids",),
        cameras=('Cameras=(Robot="p2at_omni")',),
    )
    stage = stage_recipe(path)
    renderer, describer = SampleRenderer(stage), SampleDescriber(stage)
    num_checked = 0
    for index in range(4):
        sample = renderer.render_sample(describer.describe_sample(index))
        names = {0: "", **{one.number: one.name for one in sample.objects}}
        landmarks = sample.metadata["landmarks"]
        assert len(landmarks) == len(stage.world(0).world.landmarks)
        for mark in landmarks:
            if mark["visible"] and "_over_" in mark["name"]:
                column, row = (int(value) for value in mark["pixel"])
                assert mark["name"] in names[int(sample.channels["ids"][row, column])]
                num_checked += 1
            assert mark["distance_m"] > 0.3
    renderer.close()
    assert num_checked >= 4


RANDOM = np.random.default_rng(2)


def make_sample() -> RenderedSample:
    """Sample of 5 x 4 px with channels of each kind."""
    normals = RANDOM.normal(size=(4, 5, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return RenderedSample(
        "000007",
        RANDOM.integers(0, 256, (4, 5, 3)).astype(np.uint8),
        {
            "range": np.array([[1.5, np.inf, 2.0, 3.0, 4.0]] * 4, dtype=np.float32),
            "ids": RANDOM.integers(0, 60000, (4, 5)).astype(np.uint16),
            "normal": normals.astype(np.float32),
            "flow": np.full((4, 5, 2), np.nan, dtype=np.float32),
        },
        {"key": "000007", "b": 0.1, "a": None},
    )


def test_files_hold_the_sample() -> None:
    sample = make_sample()
    files = encode_sample(sample)
    assert [*files] == ["flow.npy", "ids.png", "json", "normal.npy", "range.npy", "rgb.png"]
    np.testing.assert_array_equal(decode_png(files["rgb.png"]), sample.rgb)
    np.testing.assert_array_equal(decode_png(files["ids.png"]), sample.channels["ids"])
    ranges = np.load(io.BytesIO(files["range.npy"]))
    np.testing.assert_array_equal(ranges, sample.channels["range"])
    normals = np.load(io.BytesIO(files["normal.npy"]))
    assert normals.dtype == np.float16
    cosines = (normals.astype(float) * sample.channels["normal"]).sum(axis=-1)
    cosines /= np.linalg.norm(normals.astype(float), axis=-1)
    assert np.degrees(np.arccos(np.minimum(cosines, 1.0))).max() < 0.05
    assert encode_sample(sample) == files


def test_json_has_no_text_for_a_number_that_is_not_finite() -> None:
    sample = replace(make_sample(), metadata={"b": 1, "a": [0.1, None]})
    assert encode_sample(sample)["json"] == b'{"a":[0.1,null],"b":1}'
    with pytest.raises(ValueError, match="JSON"):
        encode_sample(replace(sample, metadata={"a": float("nan")}))
