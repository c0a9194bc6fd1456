from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.world.camera_state import scene_twist_in_mirror
from catoptra_server.world.world_description import AT_REST, Twist
from helpers.effect_measurement import DRIVING_STATE, DYNAMIC_OBJECT
from helpers.motion_reference import camera_state_after, relative_twist


@pytest.mark.parametrize("twist", [AT_REST, Twist((0.0, -0.6, 0.0), (0.3, 0.0, 1.0))])
def test_relative_twist_when_applied_moves_points_as_in_the_mirror_frame(twist: Twist) -> None:
    dynamic_object, step_s = replace(DYNAMIC_OBJECT, twist=twist), 1e-6
    point = np.array((1.1, 0.4, -0.2))
    offset = point - dynamic_object.world_from_object.translation
    velocity = twist.at_offset(offset).linear_m_s
    local = DRIVING_STATE.world_from_mirror.inverse().transform_points(point)
    later = camera_state_after(DRIVING_STATE, step_s).world_from_mirror.inverse()
    moved = later.transform_points(point + step_s * np.asarray(velocity))
    relative = relative_twist(DRIVING_STATE, dynamic_object).at_offset(local)
    np.testing.assert_allclose(relative.linear_m_s, (moved - local) / step_s, atol=1e-5)


def test_twist_of_the_scene_is_that_of_an_object_at_rest() -> None:
    scene = scene_twist_in_mirror(DRIVING_STATE)
    at_rest = relative_twist(DRIVING_STATE, replace(DYNAMIC_OBJECT, twist=AT_REST))
    np.testing.assert_allclose(scene.linear_m_s, at_rest.linear_m_s, atol=1e-15)
    np.testing.assert_allclose(scene.angular_rad_s, at_rest.angular_rad_s, atol=1e-15)
    assert scene_twist_in_mirror(replace(DRIVING_STATE, twist=AT_REST)) == AT_REST
