"""Touch sensors: whether something is at the switch; all of a robot share one line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.usarsim.reports import TouchConfiguration, TouchReadings
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, TouchDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext

# A base stops within a tenth of a millimetre of what it hits (robot/robot_body); a switch gives way by a
# millimetre.
_TRAVEL_M = 1e-3


class TouchSensorBank:
    """Feel along five rays that start behind each switch: its middle and its edge."""

    type = "Touch"

    def __init__(
        self, descriptions: Sequence[TouchDescription], base: DriveBase, stream: RandomSource
    ) -> None:
        self.name = self.type
        self.interval_s = min(description.interval_s for description in descriptions)
        self._descriptions = tuple(descriptions)
        self._ray_origins = np.concatenate(
            [_ray_origins_in_robot(description) for description in descriptions]
        )
        forward = [d.mount.parent_from_item().rotation[:, 0] for d in descriptions]
        self._forward = np.repeat(forward, _NUM_RAYS, axis=0)
        self._reach_m = np.repeat([d.diameter_m + _TRAVEL_M for d in descriptions], _NUM_RAYS)

    @property
    def parts(self) -> Sequence[Part]:
        """Return the switches."""
        return tuple(
            MountedPart(self.type, d.name, d.mount, TouchConfiguration(d.name, d.diameter_m))
            for d in self._descriptions
        )

    def update(self, motion: MotionStep) -> None:
        """Ignore the way: a touch is of one moment."""

    def read(self, context: SensorContext) -> TouchReadings:
        """Return which switches are pressed."""
        pose = context.world_from_robot
        distances = context.environment.distances(
            pose.transform_points(self._ray_origins), pose.rotate_directions(self._forward)
        )
        pressed = np.any((distances <= self._reach_m).reshape(-1, _NUM_RAYS), axis=1)
        names = (description.name for description in self._descriptions)
        time_s = (
            context.time_s
            if all(description.has_timestamp for description in self._descriptions)
            else None
        )
        return TouchReadings(tuple(zip(names, pressed.tolist(), strict=True)), time_s)


# The middle of a switch and four places on its edge.
_RAY_OFFSETS = np.array([[0, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
_NUM_RAYS = len(_RAY_OFFSETS)


def _ray_origins_in_robot(description: TouchDescription) -> Floats:
    """Return (5, 3) points in the robot's frame, a diameter behind the face of the switch."""
    behind = np.array([-description.diameter_m, 0.0, 0.0])
    return description.mount.parent_from_item().transform_points(
        behind + 0.5 * description.diameter_m * _RAY_OFFSETS
    )
