from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_server.render.staging import captured, scene_motion, staged
from catoptra_server.scene.motion import AT_REST, Twist
from helpers.effects import BODY, EXPOSURE


class Named:
    """As much of an effect as staging asks for."""

    def __init__(self, name: str) -> None:
        self.name = name


def test_own_body_when_asked_for_is_seen_after_all_others() -> None:
    own = replace(BODY, world_from_body=Pose.from_rpy((0, 0, 0)))
    exposure = replace(EXPOSURE, own_body=own)
    assert staged(exposure, ()).bodies == (BODY,)
    assert staged(exposure, (Named("OwnBody"),)).bodies == (BODY, own)  # type: ignore[arg-type]
    assert staged(EXPOSURE, (Named("OwnBody"),)).bodies == (BODY,)  # type: ignore[arg-type]


def test_shadows_when_asked_for_are_cast() -> None:
    assert not staged(EXPOSURE, ()).has_shadows
    assert staged(EXPOSURE, (Named("Shadows"),)).has_shadows  # type: ignore[arg-type]


@pytest.mark.parametrize("mover", [0, 1])
def test_motion_when_captured_is_how_points_move_in_the_mirror_frame(mover: int) -> None:
    pose, step_s = EXPOSURE.world_from_mirror, 1e-6
    point = np.array((1.1, 0.4, -0.2))
    body = BODY.twist.at(point - BODY.world_from_body.translation).linear_m_s
    after_point = point + step_s * np.asarray(body if mover else (0.0, 0.0, 0.0))
    after = _moved(pose, EXPOSURE.twist, step_s)
    local = pose.inverse().points(point)
    velocity = (after.inverse().points(after_point) - local) / step_s
    seen = captured(EXPOSURE).motion[mover].at(local)
    np.testing.assert_allclose(seen.linear_m_s, velocity, atol=1e-5)


def test_motion_of_the_scene_alone_is_the_first_of_what_is_captured() -> None:
    alone, first = scene_motion(EXPOSURE), captured(EXPOSURE).motion[0]
    np.testing.assert_allclose(alone.linear_m_s, first.linear_m_s, atol=1e-15)
    np.testing.assert_allclose(alone.angular_rad_s, first.angular_rad_s, atol=1e-15)
    assert scene_motion(replace(EXPOSURE, twist=AT_REST)) == AT_REST


def _moved(pose: Pose, twist: Twist, step_s: float) -> Pose:
    turn = np.eye(3) + np.cross(np.eye(3), np.asarray(twist.angular_rad_s) * step_s)
    linear = np.asarray(twist.linear_m_s) * step_s
    return Pose(turn @ pose.rotation, pose.translation + linear)
