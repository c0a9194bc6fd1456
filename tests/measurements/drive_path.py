"""The exposures of a robot that drives through a world and weaves a little, one a tick."""

from __future__ import annotations

import math

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.scene.twist import Twist

TICK_S = 0.02
SPEED_M_S = 0.5
# Where a way begins, x and y in metres.
STARTS = {"field": (-2.5, 0.3), "corridor": (-5.0, -0.2)}


def drive_path(world: str, ticks: int) -> tuple[CameraState, ...]:
    """Return the exposures of a drive; speeds vary by a hundredth, as where wheels slip."""
    x, y = STARTS.get(world, (-2.5, 0.3))
    exposures = []
    for tick in range(ticks):
        yaw = 0.15 * math.sin(tick / 80.0)
        turning = 0.15 / 80.0 / TICK_S * math.cos(tick / 80.0)
        speed = SPEED_M_S * (1.0 + 0.01 * math.sin(1.7 * tick))
        velocity = (speed * math.cos(yaw), speed * math.sin(yaw), 0.0)
        pose = Pose.from_rpy((x, y, -0.6), (0.0, 0.0, yaw))
        exposures.append(CameraState(pose, twist=Twist(velocity, (0.0, 0.0, turning))))
        x, y = x + TICK_S * velocity[0], y + TICK_S * velocity[1]
    return tuple(exposures)
