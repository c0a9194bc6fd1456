"""All sensors that a robot can carry, in the order of UT2004's cycle.

To add a sensor: write `<name>.py` beside the others, with description, reader, instrument and a
`SensorKind`, and add a line for each of its classes to the table below. The report belongs to the
protocol, in the module `usarsim/readings_*` of the most similar reports.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_protocol.lazy_table import LazyTable
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, SensorDescription
from catoptra_server.simulation.sensors.sensor import Sensor, SensorKind

SENSOR_KINDS: LazyTable[SensorKind] = LazyTable(
    __name__,
    {
        "sonarsensor": "sonar.SONAR",
        "sonar": "sonar.SONAR",
        "rangescanner": "range_scanner.RANGE_SCANNER",
        "sicklms": "range_scanner.RANGE_SCANNER",
        "sicklms200": "range_scanner.RANGE_SCANNER",
        "sick": "range_scanner.RANGE_SCANNER",
        "hokuyourg04lx": "range_scanner.RANGE_SCANNER",
        "inssensor": "ins.INS",
        "ins": "ins.INS",
        "odometrysensor": "odometry.ODOMETRY",
        "odometry": "odometry.ODOMETRY",
        "encodersensor": "encoder.ENCODER",
        "encoder": "encoder.ENCODER",
        "tachometer": "tachometer.TACHOMETER",
        "touchsensor": "touch.TOUCH",
        "touch": "touch.TOUCH",
        "rfidsensor": "rfid.RFID",
        "rfid": "rfid.RFID",
        "victsensor": "victim_sensor.VICTIM_SENSOR",
        "victimsensor": "victim_sensor.VICTIM_SENSOR",
        "groundtruthsensor": "ground_truth.GROUND_TRUTH",
        "groundtruth": "ground_truth.GROUND_TRUTH",
        "gpssensor": "gps.GPS",
        "gps": "gps.GPS",
    },
)
"""Kinds by the name of a class in robot files, in lower case."""


def build_sensors(
    descriptions: Sequence[SensorDescription],
    base: DriveBase,
    random_source_of: Callable[[str], RandomSource],
    kinds: Sequence[SensorKind] = (),
) -> list[Sensor]:
    """Build the sensors of a robot, in the order of the table.

    Args:
        base: Base whose wheels the sensors measure.
        random_source_of: Random numbers by the name of a sensor or a shared stream.
        kinds: Kinds besides those of the table.
    """
    sensors: list[Sensor] = []
    for kind in (*SENSOR_KINDS.find_present(), *kinds):
        # By exact class, in the order of the robot file: the order of the items in a shared line.
        alike = [each for each in descriptions if type(each) is kind.description]
        if alike and kind.shared_stream is not None:
            instrument = kind.create(alike, base, random_source_of(kind.shared_stream))
            sensors.append(kind.assemble(kind.part_type, alike, instrument))
            continue
        for each in alike:
            instrument = kind.create(each, base, random_source_of(each.name))
            sensors.append(kind.assemble(each.name, [each], instrument))
    return sensors


def casts_rays(description: SensorDescription) -> bool:
    """Whether readings of a sensor measure the scene."""
    loaded = SENSOR_KINDS.find_present()
    return any(kind.casts_rays for kind in loaded if type(description) is kind.description)
