"""All sensors that a robot can carry, in one visible table, in the order of UT2004's cycle.

To add one: describe it in `robot/sensor_descriptions.py`, read it in `config/sensor_readers.py`,
write `<name>.py` beside the others (the protocol is in `sensor.py`), its report in the wire's
`readings`, then its line here: in `_SHARED_STREAM_NAMES` if all of a robot report together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import (
    DriveBase,
    EncoderDescription,
    GpsDescription,
    GroundTruthDescription,
    InsDescription,
    OdometryDescription,
    RangeScannerDescription,
    RfidDescription,
    SensorDescription,
    SonarDescription,
    TachometerDescription,
    TouchDescription,
    VictimSensorDescription,
)
from catoptra_server.sensors.encoder import EncoderBank
from catoptra_server.sensors.gps import GpsSensor
from catoptra_server.sensors.ground_truth import GroundTruthSensor
from catoptra_server.sensors.ins import InsSensor
from catoptra_server.sensors.odometry import OdometrySensor
from catoptra_server.sensors.range_scanner import RangeScannerSensor
from catoptra_server.sensors.rfid import RfidSensor
from catoptra_server.sensors.sensor import MotionStep, Part, Sensor, SensorContext
from catoptra_server.sensors.sonar import SonarRing
from catoptra_server.sensors.tachometer import TachometerSensor
from catoptra_server.sensors.touch import TouchSensorBank
from catoptra_server.sensors.victim_sensor import VictimSensor

_SENSORS: dict[type, Callable[..., Sensor]] = {
    SonarDescription: SonarRing,
    RangeScannerDescription: RangeScannerSensor,
    InsDescription: InsSensor,
    OdometryDescription: OdometrySensor,
    EncoderDescription: EncoderBank,
    TachometerDescription: TachometerSensor,
    TouchDescription: TouchSensorBank,
    RfidDescription: RfidSensor,
    VictimSensorDescription: VictimSensor,
    GroundTruthDescription: GroundTruthSensor,
    GpsDescription: GpsSensor,
}
# Of these, all that a robot has make one sensor: USARSim sends them in one line. Their noise has
# one stream, with a name that no sensor has: with a space.
_SHARED_STREAM_NAMES = {
    SonarDescription: "all sonars",
    EncoderDescription: "all encoders",
    TouchDescription: "all touch sensors",
}


def build_sensors(
    descriptions: Sequence[SensorDescription],
    base: DriveBase,
    stream_of: Callable[[str], RandomSource],
) -> list[Sensor]:
    """Return a robot's sensors in the order of UT2004's cycle.

    The noise of each comes from the stream of its name, or of the line that it shares.
    """
    sensors: list[Sensor] = []
    for kind, sensor in _SENSORS.items():
        alike = [description for description in descriptions if type(description) is kind]
        if alike and kind in _SHARED_STREAM_NAMES:
            sensors.append(sensor(alike, base, stream_of(_SHARED_STREAM_NAMES[kind])))
        elif alike:
            sensors.extend(sensor(one, base, stream_of(one.name)) for one in alike)
    return sensors


__all__ = ["SensorContext", "MotionStep", "Part", "Sensor", "build_sensors"]
