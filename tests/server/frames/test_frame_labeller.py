"""Labels of frames: flow to the channel's last frame, limits, rays that are closed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.medium.misalignment import Misalignment
from catoptra_server.frames.frame import CameraChannel, ViewRequest
from catoptra_server.frames.labels.labels import DrawnExposure
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import FrameLabeller, ViewCache, ViewFailedError
from catoptra_server.render.render_settings import (
    MirrorSurface,
    PerPixel,
    RenderSettings,
    Tessellation,
)
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


def test_request_beside_a_picture_names_what_the_channels_need(labeller: FrameLabeller) -> None:
    found = labeller.request(DRAWN, ("flow", "range"))
    assert found is not None
    assert found.channels == {"flow", "range", "ids", "point"}
    assert found.centres.samples == 1


def test_request_that_cannot_be_answered_leaves_the_picture_alone(labeller: FrameLabeller) -> None:
    huge = replace(DRAWN, camera=replace(CAMERAS["fish-eye"], width_px=4096, height_px=4096))
    assert labeller.request(huge, ("point",)) is None


@pytest.mark.parametrize("surface", [PerPixel(), Tessellation(24, 12)], ids=str)
def test_labels_are_found_while_a_picture_with_the_rays_of_the_model_is_drawn(
    surface: MirrorSurface,
) -> None:
    """Not beside a picture of a mirror mesh, whose rays are others."""
    spec = OmniCameraSpec(CAMERAS["paper"], RenderSettings(surface, samples=2))
    choice = choose_renderer("trace", SCENE, WORLD, threads=1)
    views = ViewCache(RenderPlanner(RendererPool(choice)), SceneSummarizer(SCENE, WORLD))
    try:
        request = ViewRequest(spec, STATE, partial(views.request_labels, ("ids", "agreement")))
        rendered = views.render(request)
        labels = views.label(rendered, ("ids", "agreement"), CHANNEL, 1.0)
        assert (rendered.labels is None) == isinstance(surface, Tessellation)
        assert labels.truth.channels["ids"].max() > 0
        if rendered.labels is not None:
            assert labels.truth.channels["ids"] is rendered.labels["ids"]
    finally:
        views.close()
