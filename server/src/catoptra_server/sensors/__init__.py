"""All sensors that a robot can carry, in one visible table.

To add one: describe it in `robot/description.py`, read it in `config/robot_file.py`, write
`<name>.py` beside the others (the protocol is in `sensor.py`), its report in the wire's `readings`,
then its line here.
"""

from __future__ import annotations

from collections.abc import Callable

from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import (
    DriveBase,
    GroundTruthDescription,
    OdometryDescription,
    SensorDescription,
)
from catoptra_server.sensors.ground_truth import GroundTruthSensor
from catoptra_server.sensors.odometry import OdometrySensor
from catoptra_server.sensors.sensor import Part, Sensor

_SENSORS: dict[type, Callable[..., Sensor]] = {
    OdometryDescription: OdometrySensor,
    GroundTruthDescription: GroundTruthSensor,
}


def build_sensor(description: SensorDescription, base: DriveBase, stream: RandomStream) -> Sensor:
    """Return the sensor of a description; its noise comes from the stream alone."""
    return _SENSORS[type(description)](description, base, stream)


__all__ = ["Part", "Sensor", "build_sensor"]
