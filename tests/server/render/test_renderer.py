"""The parts of the renderer protocol that need no renderer."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.world.camera_state import CameraState


def test_camera_state_has_no_objects_by_default() -> None:
    assert CameraState(Pose.identity()).objects == ()


@pytest.mark.parametrize("face", list(Face))
def test_face_is_a_square_camera_of_90_degrees_turned(face: Face) -> None:
    camera = FaceCamera(face, 64)
    corner, valid = camera.perspective_camera.direction_from_pixel(np.array([64.0, 64.0]))
    assert valid
    np.testing.assert_allclose(corner / corner[0], (1.0, 1.0, 1.0), rtol=1e-15)
    assert np.array_equal(camera.mirror_from_camera, MIRROR_FROM_FACE_ROTATIONS[face])
