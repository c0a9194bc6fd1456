"""Metadata of samples."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.datasets.sample import SampleDescriber, describe_pose, encode_json
from catoptra_server.datasets.sample_renderer import SampleRenderer
from helpers.dataset_recipes import stage_recipe, write_drive, write_recipe


def test_metadata_are_json_and_describe_camera_pose_and_light(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path))
    description = SampleDescriber(stage).describe_sample(3)
    renderer = SampleRenderer(stage)
    metadata = json.loads(encode_json(renderer.render_sample(description).metadata))
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
        metadata["world_from_camera"]["position_m"],
        description.state.world_from_mirror.translation,
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


def test_pose_is_position_and_quaternion() -> None:
    described = describe_pose(Pose.from_rpy((1.0, 2.0, -3.0), (0.0, 0.0, np.pi / 2)))
    assert described["position_m"] == [1.0, 2.0, -3.0]
    assert described["quaternion_xyzw"] == pytest.approx([0.0, 0.0, 0.5**0.5, 0.5**0.5])
