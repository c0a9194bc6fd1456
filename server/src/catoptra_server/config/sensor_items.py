"""The sensors of a robot's section: items of `Sensors=` (UT2004) and `AddParts=` (UDK).

A sensor's class is known by the last part of its name. What an item leaves open its class's section
says, what that leaves open our table: the defaults of UDK's DefaultUSAR.ini.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.mounting import mount_of
from catoptra_server.config.sensor_item import SensorItem
from catoptra_server.config.settings import Settings
from catoptra_server.robot.description import (
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
from catoptra_server.robot.sensor_descriptions import FLATTEST_ECHO_RAD

log = logging.getLogger(__name__)


def class_of(struct: Settings) -> str:
    """Return the class of an item without its package, in lower case."""
    return struct.text("ItemClass").rpartition(".")[2].lower()


def is_sensor(struct: Settings) -> bool:
    """Return whether we know the class of an item as a sensor's."""
    return class_of(struct) in _READERS


def read_sensor(file: IniFile, robot: Settings, struct: Settings) -> SensorDescription:
    """Return the description of an item whose class is known."""
    item = SensorItem(
        struct=struct,
        name=struct.word("ItemName"),
        mount=mount_of(robot, struct),
        section=file.section(struct.text("ItemClass")),
    )
    return _READERS[class_of(struct)](item)


def report_unknown_class(struct: Settings) -> None:
    """Warn of an item that does nothing here, as one warns of an unknown key."""
    log.warning(
        "%s: class %s is not known here: %s has no effect",
        struct.where,
        struct.text("ItemClass"),
        struct.text("ItemName", "it"),
    )
    struct.pass_over()


def _odometry(item: SensorItem) -> SensorDescription:
    section = item.section
    return OdometryDescription(
        name=item.name,
        interval_s=item.interval_s,
        distance_scale=item.number("DistanceScale", 1.0, 10.0),
        turn_scale=item.number("TurnScale", 1.0, 10.0),
        drift_rad_per_m=section.number("DriftPerMetre", 0.0, at_least=-10.0, at_most=10.0),
        distance_noise_m=item.number("DistanceNoise", 0.0, 10.0),
        turn_noise_rad=item.number("TurnNoise", 0.0, 10.0),
        heading_noise_rad=item.number("HeadingNoise", 0.0, 10.0),
        mount=item.mount,
        is_timed=item.is_timed(True),
    )


def _ground_truth(item: SensorItem) -> SensorDescription:
    decimals = item.section.integer("Decimals", 2, at_least=0, at_most=12)
    is_of_robot = item.section.boolean("FixedToPlatform", True)
    return GroundTruthDescription(item.name, item.interval_s, decimals, item.mount, is_of_robot)


def _scanner(
    fov_rad: float, resolution_rad: float, max_range_m: float
) -> Callable[[SensorItem], SensorDescription]:
    def read(item: SensorItem) -> SensorDescription:
        section = item.section
        fov = section.number("ScanFov", fov_rad, at_least=0.0, at_most=6.2832)
        # Clients read lines of 4096 bytes: 500 beams of 8 characters.
        least = max(fov / 500.0, 1e-4)
        return RangeScannerDescription(
            name=item.name,
            interval_s=item.interval_s,
            mount=item.mount,
            fov_rad=fov,
            resolution_rad=section.number(
                "Resolution", resolution_rad, at_least=least, at_most=6.3
            ),
            min_range_m=item.number("MinRange", 0.1),
            max_range_m=item.number("MaxRange", max_range_m),
            noise_m=item.number("Noise", 0.0, 10.0),
            turns_in_yaw=section.boolean("bYaw", True),
            turns_in_pitch=section.boolean("bPitch", False),
        )

    return read


def _sonar(item: SensorItem) -> SensorDescription:
    return SonarDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        beam_rad=item.number("BeamAngle", 0.3491, 3.1416),
        min_range_m=item.number("MinRange", 0.1),
        max_range_m=item.number("MaxRange", 5.0),
        noise_m=item.number("Noise", 0.0, 10.0),
        cones=item.section.integer("NumberOfCones", 3, at_least=0, at_most=64),
        rays=item.section.integer("TracesPerCone", 8, at_least=1, at_most=256),
        max_incidence_rad=item.number("MaxAngleOfIncidence", FLATTEST_ECHO_RAD, 3.1416),
    )


def _ins(item: SensorItem) -> SensorDescription:
    return InsDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        noise=item.number("Noise", 0.0, 10.0),
        is_drifting=item.section.boolean("Drifting", True),
        precision=item.number("Precision", 0.0, 1e9),
        is_timed=item.is_timed(False),
    )


# What an encoder counts is in its Parent, or else in its name: ECLeft, ECPan; or W and a wheel's
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


def _encoder(item: SensorItem) -> SensorDescription:
    spoken = item.struct.text("Parent", "").lower() or item.name.lower()
    shafts = [shaft for word, shaft in _SHAFTS.items() if word in spoken]
    return EncoderDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        shaft=shafts[0] if shafts else spoken,
        resolution_rad=item.section.number("Resolution", 0.01745, at_least=1e-6, at_most=6.3),
        noise_rad=item.number("Noise", 0.0, 10.0),
        is_timed=item.is_timed(True),
    )


def _tachometer(item: SensorItem) -> SensorDescription:
    wheels = item.section.integer("Wheels", 4, at_least=1, at_most=64)
    return TachometerDescription(item.name, item.interval_s, item.mount, wheels)


def _touch(item: SensorItem) -> SensorDescription:
    diameter_m = item.number("Diameter", 0.01, 10.0)
    is_timed = item.is_timed(True)
    return TouchDescription(item.name, item.interval_s, item.mount, diameter_m, is_timed)


def _rfid(item: SensorItem) -> SensorDescription:
    return RfidDescription(item.name, item.interval_s, item.mount, item.number("MaxRange", 6.0))


def _victim_sensor(item: SensorItem) -> SensorDescription:
    return VictimSensorDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        fov_rad=item.number("FOV", 0.6981, 6.2832),
        max_range_m=item.number("MaxRange", 6.0),
    )


def _gps(item: SensorItem) -> SensorDescription:
    return GpsDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        noise_m=item.number("Noise", 0.0),
        is_timed=item.is_timed(False),
    )


_LMS200 = _scanner(3.14159, 0.01745, 20.0)
# By class name in lower case: UT2004's names and UDK's.
_READERS: dict[str, Callable[[SensorItem], SensorDescription]] = {
    "odometrysensor": _odometry,
    "odometry": _odometry,
    "groundtruthsensor": _ground_truth,
    "groundtruth": _ground_truth,
    "rangescanner": _LMS200,
    "sicklms": _LMS200,
    "sicklms200": _LMS200,
    "sick": _LMS200,
    "hokuyourg04lx": _scanner(4.189, 0.0184, 4.0),
    "sonarsensor": _sonar,
    "sonar": _sonar,
    "inssensor": _ins,
    "ins": _ins,
    "encodersensor": _encoder,
    "encoder": _encoder,
    "tachometer": _tachometer,
    "touchsensor": _touch,
    "touch": _touch,
    "rfidsensor": _rfid,
    "rfid": _rfid,
    "victsensor": _victim_sensor,
    "victimsensor": _victim_sensor,
    "gpssensor": _gps,
    "gps": _gps,
}
