"""Sensors of a robot's section: items of `Sensors=` (UT2004) and `AddParts=` (UDK).

_READERS is the table of classes, by the last part of a class's name. Parameters are in the section
of the class; defaults are those of UDK's DefaultUSAR.ini. To add a sensor, write a reader, and add
a line to the table for each name of the class.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mounting import read_mount
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.sensor_item import SensorItem
from catoptra_server.robot.robot_description import (
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
from catoptra_server.robot.sensor_descriptions import MAX_ECHO_INCIDENCE_RAD

log = logging.getLogger(__name__)


def item_class(item: SectionReader) -> str:
    """Class of an item without its package, in lower case."""
    return item.get_str("ItemClass").rpartition(".")[2].lower()


def is_sensor(item: SectionReader) -> bool:
    """Whether an item's class is a sensor of _READERS."""
    return item_class(item) in _READERS


def read_sensor(file: IniFile, robot: SectionReader, struct: SectionReader) -> SensorDescription:
    """Description of an item for which `is_sensor` holds."""
    item = SensorItem(
        struct=struct,
        name=struct.get_wire_name("ItemName"),
        mount=read_mount(robot, struct),
        section=file.get_section(struct.get_str("ItemClass")),
    )
    return _READERS[item_class(struct)](item)


def report_unknown_class(item: SectionReader) -> None:
    """Log a warning for an item of an unknown class, and none for each of its keys."""
    log.warning(
        "%s: class %s is unknown: item %s has no effect",
        item.where,
        item.get_str("ItemClass"),
        item.get_str("ItemName", "without a name"),
    )
    item.ignore_all()


def _read_odometry(item: SensorItem) -> SensorDescription:
    section = item.section
    return OdometryDescription(
        name=item.name,
        interval_s=item.interval_s,
        distance_scale=item.get_float("DistanceScale", 1.0, 10.0),
        turn_scale=item.get_float("TurnScale", 1.0, 10.0),
        drift_rad_per_m=section.get_float("DriftPerMetre", 0.0, min_value=-10.0, max_value=10.0),
        distance_noise_m=item.get_float("DistanceNoise", 0.0, 10.0),
        turn_noise_rad=item.get_float("TurnNoise", 0.0, 10.0),
        heading_noise_rad=item.get_float("HeadingNoise", 0.0, 10.0),
        mount=item.mount,
        has_timestamp=item.has_timestamp(True),
    )


def _read_ground_truth(item: SensorItem) -> SensorDescription:
    # USARSim prints two; experiments that compare poses need more.
    decimals = item.section.get_int("Decimals", 2, min_value=0, max_value=12)
    # False is the older UDK, which reports the sensor's own pose instead of the robot's.
    is_of_robot = item.section.get_bool("FixedToPlatform", True)
    return GroundTruthDescription(item.name, item.interval_s, decimals, item.mount, is_of_robot)


def _range_scanner_reader(
    fov_rad: float, resolution_rad: float, max_range_m: float
) -> Callable[[SensorItem], SensorDescription]:
    def read(item: SensorItem) -> SensorDescription:
        section = item.section
        fov = section.get_float("ScanFov", fov_rad, min_value=0.0, max_value=6.2832)
        # A line has 4095 bytes, the buffer of old clients: 500 beams of 8 characters.
        min_resolution_rad = max(fov / 500.0, 1e-4)
        return RangeScannerDescription(
            name=item.name,
            interval_s=item.interval_s,
            mount=item.mount,
            fov_rad=fov,
            resolution_rad=section.get_float(
                "Resolution", resolution_rad, min_value=min_resolution_rad, max_value=6.3
            ),
            min_range_m=item.get_float("MinRange", 0.1),
            max_range_m=item.get_float("MaxRange", max_range_m),
            noise_m=item.get_float("Noise", 0.0, 10.0),
            is_panning=section.get_bool("bYaw", True),
            is_tilting=section.get_bool("bPitch", False),
        )

    return read


def _read_sonar(item: SensorItem) -> SensorDescription:
    return SonarDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        beam_rad=item.get_float("BeamAngle", 0.3491, 3.1416),
        min_range_m=item.get_float("MinRange", 0.1),
        max_range_m=item.get_float("MaxRange", 5.0),
        noise_m=item.get_float("Noise", 0.0, 10.0),
        num_cones=item.section.get_int("NumberOfCones", 3, min_value=0, max_value=64),
        rays_per_cone=item.section.get_int("TracesPerCone", 8, min_value=1, max_value=256),
        # Without a limit a level sonar would hear the floor: echoes of grazing surfaces are lost.
        max_incidence_rad=item.get_float("MaxAngleOfIncidence", MAX_ECHO_INCIDENCE_RAD, 3.1416),
    )


def _read_ins(item: SensorItem) -> SensorDescription:
    return InsDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        noise=item.get_float("Noise", 0.0, 10.0),
        is_drifting=item.section.get_bool("Drifting", True),
        precision=item.get_float("Precision", 0.0, 1e9),
        has_timestamp=item.has_timestamp(False),
    )


# The shaft of an encoder is in its Parent, or else in its name: ECLeft, ECPan; or W and a wheel's
# number, as in UDK: 0 front right, 1 front left, 2 back right, 3 back left. Source: P3AT.uc.
_SHAFTS = {
    "left": "left",
    "right": "right",
    "tilt": "CameraTilt",
    "pan": "CameraPan",
    "w0": "right",
    "w1": "left",
    "w2": "right",
    "w3": "left",
}


def _read_encoder(item: SensorItem) -> SensorDescription:
    shaft_name = item.struct.get_str("Parent", "").lower() or item.name.lower()
    shafts = [shaft for word, shaft in _SHAFTS.items() if word in shaft_name]
    return EncoderDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        # Any other name is that of a joint, such as a flipper's: `joint_parts` has the names.
        shaft=shafts[0] if shafts else shaft_name,
        resolution_rad=item.section.get_float("Resolution", 0.01745, min_value=1e-6, max_value=6.3),
        noise_rad=item.get_float("Noise", 0.0, 10.0),
        has_timestamp=item.has_timestamp(True),
    )


def _read_tachometer(item: SensorItem) -> SensorDescription:
    wheels = item.section.get_int("Wheels", 4, min_value=1, max_value=64)
    return TachometerDescription(item.name, item.interval_s, item.mount, wheels)


def _read_touch(item: SensorItem) -> SensorDescription:
    diameter_m = item.get_float("Diameter", 0.01, 10.0)
    has_timestamp = item.has_timestamp(True)
    return TouchDescription(item.name, item.interval_s, item.mount, diameter_m, has_timestamp)


def _read_rfid(item: SensorItem) -> SensorDescription:
    return RfidDescription(item.name, item.interval_s, item.mount, item.get_float("MaxRange", 6.0))


def _read_victim_sensor(item: SensorItem) -> SensorDescription:
    return VictimSensorDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        fov_rad=item.get_float("FOV", 0.6981, 6.2832),
        max_range_m=item.get_float("MaxRange", 6.0),
    )


def _read_gps(item: SensorItem) -> SensorDescription:
    return GpsDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        noise_m=item.get_float("Noise", 0.0),
        has_timestamp=item.has_timestamp(False),
    )


# Field of view, resolution and range as DefaultUSAR.ini has them.
_READ_LMS200 = _range_scanner_reader(3.14159, 0.01745, 20.0)
# By class name in lower case: UT2004's names and UDK's.
_READERS: dict[str, Callable[[SensorItem], SensorDescription]] = {
    "odometrysensor": _read_odometry,
    "odometry": _read_odometry,
    "groundtruthsensor": _read_ground_truth,
    "groundtruth": _read_ground_truth,
    "rangescanner": _READ_LMS200,
    "sicklms": _READ_LMS200,
    "sicklms200": _READ_LMS200,
    "sick": _READ_LMS200,
    "hokuyourg04lx": _range_scanner_reader(4.189, 0.0184, 4.0),
    "sonarsensor": _read_sonar,
    "sonar": _read_sonar,
    "inssensor": _read_ins,
    "ins": _read_ins,
    "encodersensor": _read_encoder,
    "encoder": _read_encoder,
    "tachometer": _read_tachometer,
    "touchsensor": _read_touch,
    "touch": _read_touch,
    "rfidsensor": _read_rfid,
    "rfid": _read_rfid,
    "victsensor": _read_victim_sensor,
    "victimsensor": _read_victim_sensor,
    "gpssensor": _read_gps,
    "gps": _read_gps,
}
