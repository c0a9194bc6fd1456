"""Variants of a camera's frames, and what is behind a pixel, from a real server."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from catoptra_client.frame_pictures import make_panorama
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.stream.requests import (
    FrameVariant,
    GetFrameRequest,
    ImageEncoding,
    Transform,
)
from helpers.configs import FIELD, OMNI_ROBOT
from helpers.server_process import RunningServer, start_server

NAME = "Own"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("variants")
    with start_server(folder, "--clock", "lockstep", robot=OMNI_ROBOT, world=FIELD) as running:
        yield running
        assert running.terminate() == 0
        assert "Traceback" not in running.log.read_text()


@pytest.fixture
def client(server: RunningServer) -> Iterator[StreamClient]:
    with StreamClient.connect(port=server.stream_port, timeout_s=30.0) as client:
        client.spawn(client.get_status().class_names[0], name=NAME, location_m=(1.0, 0.5, 0.0))
        yield client


def test_variant_differs_from_the_exact_frame_by_its_polygons(client: StreamClient) -> None:
    raw = ImageEncoding.RAW
    plain = client.get_frame(encoding=raw, robot=NAME)
    variant = FrameVariant(polygons=16, reference="camera")
    frame = client.get_frame(encoding=raw, robot=NAME, variant=variant)
    assert frame.rgb.shape == plain.rgb.shape
    assert frame.difference is not None
    assert frame.difference_rgb is not None
    expected = np.abs(frame.rgb.astype(int) - plain.rgb.astype(int))
    np.testing.assert_array_equal(frame.difference_rgb, expected)
    assert frame.difference.max_levels == expected.max() > 100
    assert frame.error_bound_px is not None
    assert plain.error_bound_px is not None
    assert frame.error_bound_px > 10.0 * plain.error_bound_px
    assert "polygons" in (frame.plan or "")
    # The camera's own frames stay as they are.
    again = client.get_frame(encoding=raw, robot=NAME)
    np.testing.assert_array_equal(again.rgb, plain.rgb)
    assert again.difference_rgb is None


def test_picture_from_another_pose_is_that_of_a_robot_there(client: StreamClient) -> None:
    raw = ImageEncoding.RAW
    here = client.get_frame(encoding=raw, robot=NAME)
    client.reset()
    client.spawn(client.get_status().class_names[0], name=NAME, location_m=(-1.0, 0.2, 0.0))
    there = client.get_state(NAME).robots[0].world_from_robot
    seen = client.get_frame(encoding=raw, robot=NAME)
    client.reset()
    client.spawn(client.get_status().class_names[0], name=NAME, location_m=(1.0, 0.5, 0.0))
    variant = FrameVariant(world_from_robot=there)
    header, (picture,) = client.get_encoded_frame(GetFrameRequest(0, NAME, "", raw, variant))
    assert header.world_from_robot == there
    assert picture == seen.rgb.tobytes()
    assert client.get_frame(encoding=raw, robot=NAME).rgb.tobytes() == here.rgb.tobytes()
    flat = Transform((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.1))
    with pytest.raises(CatoptraError, match="no rotation"):
        client.get_frame(robot=NAME, variant=FrameVariant(world_from_robot=flat))


def test_picture_of_the_other_hand_is_the_same_picture_with_its_own_model(
    client: StreamClient,
) -> None:
    raw = ImageEncoding.RAW
    own = client.get_frame(encoding=raw, robot=NAME)
    assert isinstance(own.camera, OmniCamera)
    assert own.camera.picture is Picture.MIRRORED
    variant = FrameVariant(picture="flipped")
    turned = client.get_frame(encoding=raw, robot=NAME, variant=variant)
    np.testing.assert_array_equal(turned.rgb, own.rgb[:, ::-1])
    assert turned.camera == own.camera.with_picture(Picture.FLIPPED)
    same = client.get_frame(encoding=raw, robot=NAME, variant=FrameVariant(picture="mirrored"))
    np.testing.assert_array_equal(same.rgb, own.rgb)
    assert same.camera == own.camera
    compared = client.get_frame(
        encoding=raw, robot=NAME, variant=FrameVariant(picture="flipped", reference="camera")
    )
    np.testing.assert_array_equal(compared.rgb, turned.rgb)
    assert compared.difference is not None
    assert compared.difference.max_levels == 0


def test_panoramas_of_both_hands_are_one(client: StreamClient) -> None:
    panoramas = [
        make_panorama(
            client.get_frame(
                encoding=ImageEncoding.RAW, robot=NAME, variant=FrameVariant(picture=picture.value)
            ),
            300,
        ).astype(int)
        for picture in Picture
    ]
    # Interpolated from the other side: a level of rounding.
    assert np.abs(panoramas[0] - panoramas[1]).max() <= 1


def test_exact_variant_does_not_differ_from_its_reference(client: StreamClient) -> None:
    variant = FrameVariant(polygons=0, samples=4, renderer="trace", reference="exact")
    frame = client.get_frame(encoding=ImageEncoding.PNG, robot=NAME, variant=variant)
    assert frame.difference is not None
    assert (frame.difference.max_levels, frame.difference.changed_fraction) == (0, 0.0)


def test_variant_with_a_tolerance_names_its_neighbours(client: StreamClient) -> None:
    variant = FrameVariant(max_error_px=0.5)
    frame = client.get_frame(robot=NAME, variant=variant)
    assert frame.predicted_ms is not None
    assert frame.error_bound_px is not None
    assert frame.error_bound_px <= 0.5
    assert frame.more_accurate is not None
    assert frame.more_accurate.error_bound_px < frame.error_bound_px
    assert client.set_accuracy().max_error_px == 0.0


@pytest.mark.parametrize(
    ("variant", "reason"),
    [
        (FrameVariant(polygons=17), "17 polygons"),
        (FrameVariant(effects={"Rain": "always"}), "no effect 'Rain'"),
        (FrameVariant(reference="best"), "no reference 'best'"),
        (FrameVariant(picture="upside"), "no picture 'upside': expected one of mirrored, flipped"),
    ],
)
def test_impossible_variant_is_refused_with_the_reason(
    client: StreamClient, variant: FrameVariant, reason: str
) -> None:
    with pytest.raises(CatoptraError, match=reason):
        client.get_frame(robot=NAME, variant=variant)
    assert client.get_frame(robot=NAME).robot_name == NAME


def test_pixel_beyond_the_mirror_and_of_an_unknown_camera(client: StreamClient) -> None:
    outside = client.get_pixel(0.5, 0.5, robot=NAME)
    assert (outside.theta_rad, outside.range_m, outside.object) == (None, None, "")
    with pytest.raises(CatoptraError, match="no camera 'Rear'"):
        client.get_pixel(0.5, 0.5, robot=NAME, camera="Rear")
