"""Camera states of a robot on a winding path through a world, one per tick."""

from __future__ import annotations

import math

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import Twist

TICK_S = 0.02
SPEED_M_S = 0.5
# Start of the path, x and y in metres.
STARTS = {"field": (-2.5, 0.3), "corridor": (-5.0, -0.2)}


def drive_path(world: str, ticks: int) -> tuple[CameraState, ...]:
    """Camera states of a drive; speeds vary by a hundredth, as with slipping wheels."""
    x, y = STARTS.get(world, (-2.5, 0.3))
    camera_states = []
    for tick in range(ticks):
        yaw = 0.15 * math.sin(tick / 80.0)
        turning = 0.15 / 80.0 / TICK_S * math.cos(tick / 80.0)
        speed = SPEED_M_S * (1.0 + 0.01 * math.sin(1.7 * tick))
        velocity = (speed * math.cos(yaw), speed * math.sin(yaw), 0.0)
        pose = Pose.from_rpy((x, y, -0.6), (0.0, 0.0, yaw))
        camera_states.append(CameraState(pose, twist=Twist(velocity, (0.0, 0.0, turning))))
        x, y = x + TICK_S * velocity[0], y + TICK_S * velocity[1]
    return tuple(camera_states)
