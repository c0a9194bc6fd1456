"""Touch sensors: contact switches; all switches of a robot report in one line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import TouchReadings
from catoptra_protocol.usarsim.reports import TouchConfiguration
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)

# A base stops within a tenth of a millimetre of an obstacle (`simulation/drive.py`): a switch that
# yields by a millimetre is pressed there.
_TRAVEL_M = 1e-3
# Rays in diameters of a switch, in the plane of its face: the centre and four points on the edge.
_RAY_OFFSETS = np.array([[0, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
_NUM_RAYS = len(_RAY_OFFSETS)


@dataclass(frozen=True, slots=True)
class TouchDescription:
    """A contact switch, facing along the x axis of the mount."""

    name: str
    interval_s: float
    mount: Mount
    diameter_m: float
    has_timestamp: bool = True
    """Whether UDK's readings, unlike UT2004's, carry a time."""


class _TouchSensorBank:
    """Contact of each switch, by five rays that start behind its face."""

    def __init__(
        self, descriptions: Sequence[TouchDescription], base: DriveBase, random_source: RandomSource
    ) -> None:
        self._descriptions = tuple(descriptions)
        self._ray_origins = np.concatenate(
            [_ray_origins_in_robot(description) for description in descriptions]
        )
        # The x axis of a mount is the first column of its rotation.
        forward = [d.mount.parent_from_item().rotation[:, 0] for d in descriptions]
        self._forward = np.repeat(forward, _NUM_RAYS, axis=0)
        self._reach_m = np.repeat([d.diameter_m + _TRAVEL_M for d in descriptions], _NUM_RAYS)

    def update(self, motion: MotionStep) -> None:
        """Nothing to integrate: a contact has one time."""

    def read(self, context: SensorContext) -> TouchReadings:
        """Whether each switch is pressed."""
        pose = context.world_from_robot
        distances = context.environment.distances(
            pose.transform_points(self._ray_origins), pose.rotate_directions(self._forward)
        )
        pressed = np.any((distances <= self._reach_m).reshape(-1, _NUM_RAYS), axis=1)
        names = (description.name for description in self._descriptions)
        # One time for the line: present only if every switch's class has one.
        has_timestamp = all(description.has_timestamp for description in self._descriptions)
        time_s = context.time_s if has_timestamp else None
        return TouchReadings(tuple(zip(names, pressed.tolist(), strict=True)), time_s)


def _ray_origins_in_robot(description: TouchDescription) -> Floats:
    """Origins (5, 3) of the rays, a diameter behind the face of a switch."""
    # Behind: a ray that started on the face could miss a surface that already touches the switch.
    behind = np.array([-description.diameter_m, 0.0, 0.0])
    return description.mount.parent_from_item().transform_points(
        behind + 0.5 * description.diameter_m * _RAY_OFFSETS
    )


def _read_description(item: ConfiguredSensor) -> TouchDescription:
    diameter_m = item.get_float("Diameter", 0.01, 10.0)
    has_timestamp = item.has_timestamp(True)
    return TouchDescription(item.name, item.interval_s, item.mount, diameter_m, has_timestamp)


TOUCH = SensorKind(
    "Touch",
    TouchDescription,
    _TouchSensorBank,
    {"touchsensor": _read_description, "touch": _read_description},
    lambda switch: TouchConfiguration(switch.name, switch.diameter_m),
    shared_stream="all touch sensors",
    casts_rays=True,
)
