"""Labels of frames: flow to the channel's last frame, limits, rays that are closed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.medium.misalignment import Misalignment
from catoptra_server.frames.frame_labeller import FrameLabeller
from catoptra_server.frames.frame_request import CameraChannel
from catoptra_server.frames.renderer_recovery import ViewFailedError
from catoptra_server.ground_truth.label_rays import DrawnExposure
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.planning.renderer_pool import RendererPool
from helpers.labelled_rooms import CAMERAS, SCENE, STATE, WORLD

CHANNEL = CameraChannel("Mine", "Omni")
DRAWN = DrawnExposure(CAMERAS["paper"], STATE)
LATER = replace(STATE, world_from_mirror=Pose.from_rpy((0.35, 0.17, -0.6), (0.02, -0.03, 0.3)))


@pytest.fixture(scope="module")
def pool() -> Iterator[RendererPool]:
    found = RendererPool(choose_renderer("trace", SCENE, WORLD, threads=1))
    yield found
    found.close()


@pytest.fixture
def labeller(pool: RendererPool) -> Iterator[FrameLabeller]:
    found = FrameLabeller(pool, SceneSummarizer(SCENE, WORLD))
    yield found
    found.close()


def test_flow_leads_to_the_last_frame_of_the_same_channel(labeller: FrameLabeller) -> None:
    first = labeller.label(DRAWN, ("flow",), CHANNEL, 1.0)
    other = labeller.label(DRAWN, ("flow",), CameraChannel("Other", "Omni"), 1.5)
    second = labeller.label(replace(DRAWN, camera_state=LATER), ("flow",), CHANNEL, 2.0)
    assert (first.flow_to_time_s, other.flow_to_time_s) == (None, None)
    assert np.isnan(first.truth.channels["flow"]).all()
    assert second.flow_to_time_s == 1.0
    assert np.nanmax(np.abs(second.truth.channels["flow"])) > 0.5


def test_frames_without_flow_are_not_remembered(labeller: FrameLabeller) -> None:
    labeller.label(DRAWN, ("ids",), CHANNEL, 1.0)
    assert labeller.label(DRAWN, ("flow",), CHANNEL, 2.0).flow_to_time_s is None


def test_displaced_camera_is_reported(labeller: FrameLabeller) -> None:
    displaced = replace(DRAWN, image_effects=(Misalignment(x_m=0.002),))
    assert labeller.label(displaced, ("ids",), CHANNEL, 1.0).is_displaced
    assert not labeller.label(DRAWN, ("ids",), CHANNEL, 1.0).is_displaced


def test_labels_of_a_huge_image_are_rejected(labeller: FrameLabeller) -> None:
    huge = replace(DRAWN, camera=replace(CAMERAS["fish-eye"], width_px=4096, height_px=4096))
    with pytest.raises(ViewFailedError, match="4096 x 4096 px take 192 MiB, more than 64"):
        labeller.label(huge, ("point",), CHANNEL, 1.0)


def test_labeller_goes_on_after_its_rays_were_closed(labeller: FrameLabeller) -> None:
    before = labeller.label(DRAWN, ("ids",), CHANNEL, 1.0)
    labeller.close()
    after = labeller.label(DRAWN, ("ids",), CHANNEL, 1.0)
    np.testing.assert_array_equal(before.truth.channels["ids"], after.truth.channels["ids"])
