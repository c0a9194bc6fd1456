"""Corners of objects' boxes in the image: by the camera model, with validity of each."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.labels.ground_truth import LabelledObject
from catoptra_protocol.optics.camera_rays import pixel_from_point
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose


def project_box(
    labelled: LabelledObject, camera: OmniCamera | PerspectiveCamera, world_from_camera: Pose
) -> tuple[Floats, Bools]:
    """(8, 2) pixels of a box's corners, nan where invalid, and (8,) validity.

    A corner is valid if the camera's domain and image hold its pixel; other things may hide it. The
    order is that of `LabelledObject.corners`.
    """
    in_camera = world_from_camera.inverse().transform_points(labelled.corners())
    if isinstance(camera, PerspectiveCamera):
        pixels, valid = camera.pixel_from_direction(in_camera)
    else:
        pixels, valid = pixel_from_point(camera, in_camera)
    size = (camera.width_px, camera.height_px)
    valid = valid & ((pixels >= 0.0) & (pixels <= size)).all(axis=-1)
    return np.where(valid[:, None], pixels, np.nan), valid
