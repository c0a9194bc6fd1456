"""Annotations of objects, and the corners of their boxes."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.labels import GroundTruth, LabelledObject
from catoptra_protocol.labels.annotations import annotate_objects, project_boxes
from catoptra_protocol.labels.spherical_box import PixelSphere
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from helpers.labelled_rooms import CAMERAS
from helpers.mirror_checks import make_camera
from helpers.run_lengths import mask_from_string

BOX = LabelledObject(
    1,
    "crate",
    "object",
    1,
    Pose.from_rpy((1.5, 0.4, -0.2), (0.0, 0.0, 0.5)),
    np.array((0.3, 0.2, 0.2)),
)
POSE = Pose.from_rpy((0.1, 0.0, -0.6), (0.02, 0.01, 0.3))


def project_one(
    box: LabelledObject, camera: OmniCamera | PerspectiveCamera, pose: Pose
) -> tuple[np.ndarray, np.ndarray]:
    pixels, valid = project_boxes([box], camera, pose)
    return pixels[0], valid[0]


def test_rays_of_the_pixels_pass_through_the_corners() -> None:
    for camera in CAMERAS.values():
        pixels, valid = project_one(BOX, camera, POSE)
        assert valid.all()
        origins, directions, _ = ray_from_pixel(camera, pixels)
        to_corner = POSE.inverse().transform_points(BOX.corners()) - origins
        miss = np.linalg.norm(np.cross(to_corner, directions), axis=-1)
        assert miss.max() < 1e-5


@pytest.mark.parametrize("rim_deg", [90.0, 150.0, 170.0, 175.0])
def test_corners_near_a_ball_are_valid_where_a_ray_of_the_ball_meets_them(rim_deg: float) -> None:
    camera = make_camera(SphericalMirror(0.03, 0.4, math.radians(rim_deg)))
    rim_ratio = camera.rim_radius_px / camera.scale_px
    t, r, z = camera.mirror.ray_from_radius_ratio(np.linspace(0.0, rim_ratio, 4_001))
    theta = 2.0 * np.arctan(np.minimum(t, camera.rim_t))
    rng = np.random.default_rng(3)
    num_valid = 0
    for half_m in (0.002, 0.01, 0.03):
        for place in rng.uniform(-0.08, 0.08, (10, 3)):
            box = replace(BOX, world_from_box=Pose.from_rpy(place), half_size_m=np.full(3, half_m))
            _, valid = project_one(box, camera, Pose.identity())
            corners = box.corners()
            aside = np.hypot(corners[:, 0], corners[:, 1])[:, None] - r
            ahead = corners[:, 2][:, None] - z
            # The corner's distance across each ray changes its sign between two that pass it.
            across = aside * np.cos(theta) - ahead * np.sin(theta)
            is_met = (across[:, 1:] * across[:, :-1] <= 0.0) & (
                (aside * np.sin(theta) + ahead * np.cos(theta))[:, 1:] > 0.0
            )
            np.testing.assert_array_equal(valid, is_met.any(axis=1))
            num_valid += np.count_nonzero(valid)
    assert 25 < num_valid < 235


def test_corners_outside_the_image_are_invalid() -> None:
    camera = PerspectiveCamera(64, 48, 1.0)
    behind = Pose.from_rpy((3.0, 0.4, -0.2))
    pixels, valid = project_one(BOX, camera, behind)
    assert not valid.any()
    assert np.isnan(pixels).all()
    # From within the box some corners are ahead, others behind.
    _, partly = project_one(BOX, camera, Pose.from_rpy((1.25, 0.3, -0.2), (0.0, 0.0, 0.5)))
    assert not partly.all()


CAMERA = CAMERAS["fish-eye"]
IDS = np.zeros((96, 96), dtype=np.uint16)
IDS[30:40, 50:60] = 2
IDS[48, 95] = 7
VALID = np.ones((96, 96), dtype=np.uint8)
OBJECTS = tuple(
    LabelledObject(number, name, "object", 1, Pose.from_rpy(place), np.full(3, 0.1))
    for number, name, place in (
        (2, "crate", (0.5, 0.5, 0.4)),
        (7, "post", (0.0, 0.0, -9.0)),
        (8, "unseen", (1.0, 0.0, 0.0)),
    )
)


def test_each_object_in_view_has_an_annotation() -> None:
    truth = GroundTruth({"ids": IDS, "valid": VALID}, OBJECTS)
    sphere = PixelSphere(CAMERA, np.eye(3))
    found = annotate_objects(truth, CAMERA, Pose.identity(), sphere, {2: 0.25})
    assert [one.labelled.name for one in found] == ["crate", "post"]
    assert [one.is_truncated for one in found] == [False, True]
    assert [one.occluded_fraction for one in found] == [0.25, None]
    record = json.loads(json.dumps(found[0].to_json(), allow_nan=False))
    assert (record["area_px"], record["box_px"]) == (100, [50, 30, 10, 10])
    mask = mask_from_string(record["mask"]["counts"], 96, 96)
    np.testing.assert_array_equal(mask, IDS == 2)
    assert record["polygons"] == [[[50, 30], [60, 30], [60, 40], [50, 40]]]
    assert sum(corner is not None for corner in record["box_3d"]["corners_px"]) == 8
    # Straight above: outside the domain of a camera that hangs.
    above = found[1].to_json()["box_3d"]["corners_px"]
    assert above == 8 * [None]
