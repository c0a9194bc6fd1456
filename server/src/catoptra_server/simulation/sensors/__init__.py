"""All sensors that a robot can carry, in the order of UT2004's cycle.

To add a sensor: write `<name>.py` beside the others, with description, reader, instrument and a
`SensorKind`, and add the kind to the table below. The report belongs to the protocol, in the module
`usarsim/readings_*` of the most similar reports.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, SensorDescription
from catoptra_server.simulation.sensors.encoder import ENCODER
from catoptra_server.simulation.sensors.gps import GPS
from catoptra_server.simulation.sensors.ground_truth import GROUND_TRUTH
from catoptra_server.simulation.sensors.ins import INS
from catoptra_server.simulation.sensors.odometry import ODOMETRY
from catoptra_server.simulation.sensors.range_scanner import RANGE_SCANNER
from catoptra_server.simulation.sensors.rfid import RFID
from catoptra_server.simulation.sensors.sensor import Sensor, SensorKind
from catoptra_server.simulation.sensors.sonar import SONAR
from catoptra_server.simulation.sensors.tachometer import TACHOMETER
from catoptra_server.simulation.sensors.touch import TOUCH
from catoptra_server.simulation.sensors.victim_sensor import VICTIM_SENSOR

SENSOR_KINDS: tuple[SensorKind, ...] = (
    SONAR,
    RANGE_SCANNER,
    INS,
    ODOMETRY,
    ENCODER,
    TACHOMETER,
    TOUCH,
    RFID,
    VICTIM_SENSOR,
    GROUND_TRUTH,
    GPS,
)


def build_sensors(
    descriptions: Sequence[SensorDescription],
    base: DriveBase,
    random_source_of: Callable[[str], RandomSource],
    kinds: Sequence[SensorKind] = SENSOR_KINDS,
) -> list[Sensor]:
    """Build the sensors of a robot, in the order of the table.

    Args:
        base: Base whose wheels the sensors measure.
        random_source_of: Random numbers by the name of a sensor or a shared stream.
    """
    sensors: list[Sensor] = []
    for kind in kinds:
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
    return any(kind.casts_rays for kind in SENSOR_KINDS if type(description) is kind.description)
