"""Corners of boxes in the image."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.labels.annotations import project_box
from catoptra_protocol.labels.channels import LabelledObject
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from helpers.labelled_rooms import CAMERAS

BOX = LabelledObject(
    1,
    "crate",
    "object",
    1,
    Pose.from_rpy((1.5, 0.4, -0.2), (0.0, 0.0, 0.5)),
    np.array((0.3, 0.2, 0.2)),
)
POSE = Pose.from_rpy((0.1, 0.0, -0.6), (0.02, 0.01, 0.3))


def test_rays_of_the_pixels_pass_through_the_corners() -> None:
    for camera in CAMERAS.values():
        pixels, valid = project_box(BOX, camera, POSE)
        assert valid.all()
        origins, directions, _ = ray_from_pixel(camera, pixels)
        to_corner = POSE.inverse().transform_points(BOX.corners()) - origins
        miss = np.linalg.norm(np.cross(to_corner, directions), axis=-1)
        assert miss.max() < 1e-5


def test_corners_outside_the_image_are_invalid() -> None:
    camera = PerspectiveCamera(64, 48, 1.0)
    behind = Pose.from_rpy((3.0, 0.4, -0.2))
    pixels, valid = project_box(BOX, camera, behind)
    assert not valid.any()
    assert np.isnan(pixels).all()
    # From within the box some corners are ahead, others behind.
    _, partly = project_box(BOX, camera, Pose.from_rpy((1.25, 0.3, -0.2), (0.0, 0.0, 0.5)))
    assert not partly.all()
