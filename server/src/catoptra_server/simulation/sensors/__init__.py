"""All sensors that a robot can carry, in the order of UT2004's cycle.

To add a sensor: write `<name>.py` beside the others, with description, reader, instrument and a
`SensorKind`, and add a line for each of its classes to the table below. The report belongs to the
protocol, in the module `usarsim/readings_*` of the most similar reports.

All sensors have in common their interface, environment and mounted parts. A sensor is updated in
every tick of the robot and read when a report is due. Each measures the world through one ray
caster, the renderer's in the server and exact rooms in tests. Other robots are boxes that are
intersected directly: 0.6 ms a cycle of the P2AT among seven others
(`tests/measurements/sensor_times.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.lazy_table import LazyTable
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.reports import (
    AnyConfiguration,
    GeometryItem,
    MissionPackageGeometry,
    Report,
    ScanIntervalConfiguration,
)
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.drive import WheelTravel
from catoptra_server.simulation.robot_description import (
    DriveBase,
    Mount,
    PlanarPose,
    SensorDescription,
)
from catoptra_server.world.objects import OrientedBox, box_distances, closest_box_hits
from catoptra_server.world.world_description import GpsOrigin, RfidTag, Victim


@dataclass(frozen=True, slots=True)
class _MountedPart:
    """A named part on a mount."""

    type: str
    name: str
    mount: Mount
    configuration_report: AnyConfiguration

    def configuration(self) -> AnyConfiguration:
        """Reply to GETCONF."""
        return self.configuration_report

    def geometry(self) -> GeometryItem:
        """Reply to GETGEO: pose and parent of the mount."""
        # The pose in the frame of the parent, not of the robot, as USARSim reports parts.
        mount = self.mount
        return GeometryItem(self.name, mount.position_m, mount.rotation_rad, mount.parent)


Triangles = npt.NDArray[np.int32]


class RayCaster(Protocol):
    """Distances in a static scene: the renderer's in the server, exact ones of rooms in tests."""

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Distances (n,) to the first surface along unit (n, 3) directions; inf without one."""

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distances, and unit normals (n, 3) of either side; inf and 0 without a surface."""

    def closest_triangles(self, origins: Floats, directions: Floats) -> tuple[Floats, Triangles]:
        """Distances, and indices (n,) of the triangles; inf and -1 without a surface."""


class EmptyScene:
    """A scene without surfaces."""

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Infinite distances (n,)."""
        return np.full(len(directions), np.inf)

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Infinite distances (n,) and normals (n, 3) of 0."""
        return self.distances(origins, directions), np.zeros(directions.shape)

    def closest_triangles(self, origins: Floats, directions: Floats) -> tuple[Floats, Triangles]:
        """Infinite distances (n,) and no triangles."""
        return self.distances(origins, directions), np.full(len(directions), -1, dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class SensorEnvironment:
    """Everything that the sensors of one robot measure, in the world frame."""

    scene: RayCaster
    robot_boxes: Sequence[OrientedBox] = ()
    """Bounding boxes of the other robots."""
    rfid_tags: Sequence[RfidTag] = ()
    victims: Sequence[Victim] = ()
    gps_origin: GpsOrigin | None = None
    """None for a world without geodetic coordinates."""

    def distances(self, origin: Floats, directions: Floats) -> Floats:
        """Distances (n,) to the first surface.

        Args:
            origin: (3,) for all rays, or (n, 3).
            directions: (n, 3) unit vectors.
        """
        origins = np.broadcast_to(origin, directions.shape)
        # Boxes are intersected directly: in the ray caster's scene each move would need a commit.
        # 0.6 ms a cycle of the P2AT among seven robots (tests/measurements/sensor_times.py).
        scene = self.scene.distances(origins, directions)
        return np.minimum(scene, box_distances(self.robot_boxes, origins, directions))

    def closest_hits(self, origin: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distances, and normals (n, 3) of the first surfaces; arguments as of `distances`."""
        origins = np.broadcast_to(origin, directions.shape)
        scene, scene_normals = self.scene.closest_hits(origins, directions)
        boxes, box_normals = closest_box_hits(self.robot_boxes, origins, directions)
        is_box = (boxes < scene)[:, None]
        return np.minimum(scene, boxes), np.where(is_box, box_normals, scene_normals)


EMPTY_ENVIRONMENT = SensorEnvironment(EmptyScene())


@dataclass(frozen=True, slots=True)
class MotionStep:
    """Motion of a robot in one tick."""

    wheel_travel: WheelTravel
    """Travel of the wheels before slip."""
    tick: int
    """Number of the tick; index of random numbers."""
    duration_s: float
    pose: PlanarPose
    """True pose after the tick."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorContext:
    """State that a reading depends on."""

    time_s: float
    tick: int
    """Number of the tick; index of random numbers, so that additional readings change no other."""
    world_from_robot: Pose
    environment: SensorEnvironment = EMPTY_ENVIRONMENT
    joint_angles_rad: Mapping[str, float] = field(default_factory=dict)
    """Angle of each joint by lower-case link name."""


class Part(Protocol):
    """Anything on a robot that replies to GETCONF and GETGEO."""

    @property
    def type(self) -> str:
        """Type by which the part is requested, as USARSim spells it."""

    @property
    def name(self) -> str:
        """Name that no other part of the robot has."""

    def configuration(self) -> AnyConfiguration:
        """Reply to GETCONF."""

    def geometry(self) -> GeometryItem | MissionPackageGeometry:
        """Reply to GETGEO."""


class _Instrument(Protocol):
    """The measuring part of a sensor."""

    def update(self, motion: MotionStep) -> None:
        """Integrate the motion of one tick."""

    def read(self, context: SensorContext) -> Report:
        """Report at one time."""


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """Source of one report: one part, or several that share a line, such as a ring of sonars."""

    type: str
    name: str
    interval_s: float
    """Simulation time between two reports."""
    parts: tuple[Part, ...]
    """Parts that reply to GETCONF and GETGEO."""
    instrument: _Instrument


class _SensorKeys(Protocol):
    """Keys of a section or an item of a robot file; an invalid value raises ConfigError."""

    def get_float(self, key: str, default: float, *, min_value: float, max_value: float) -> float:
        """Number within bounds."""

    def get_int(self, key: str, default: int, *, min_value: int, max_value: int) -> int:
        """Whole number within bounds."""

    def get_bool(self, key: str, default: bool) -> bool:
        """Truth value."""

    def get_str(self, key: str, default: str) -> str:
        """Text without quotes."""


class ConfiguredSensor(Protocol):
    """One sensor item of a robot file, with the section of the item's class."""

    @property
    def name(self) -> str:
        """Name of the sensor."""

    @property
    def interval_s(self) -> float:
        """Simulation time between two readings."""

    @property
    def mount(self) -> Mount:
        """Mounting pose."""

    @property
    def struct(self) -> _SensorKeys:
        """Keys of the item."""

    @property
    def section(self) -> _SensorKeys:
        """Keys of the class, shared by all items of the class."""

    def get_float(self, key: str, default: float, max_value: float = 1e4) -> float:
        """Non-negative number of the class."""

    def has_timestamp(self, default: bool) -> bool:
        """Whether readings in the UDK dialect carry a time, given UDK's default for the class."""


# By protocol: the reader of ini files is in `config`, a layer above sensors.
ReadDescription = Callable[[ConfiguredSensor], SensorDescription]


@dataclass(frozen=True, slots=True, eq=False)
class SensorKind:
    """One row of the table of sensors, defined at the end of the sensor's module."""

    part_type: str
    """Type by which the parts are requested, as USARSim spells it."""
    description: type
    """Class of the descriptions."""
    # Any: each kind takes its own description, or a sequence of them where they share a line.
    create: Callable[[Any, Any, Any], _Instrument]
    """Makes the instrument of a description, the base and a random source; of a sequence of
    descriptions where `shared_stream` is set."""
    readers: Mapping[str, ReadDescription]
    """Reader of an item's description by class name in lower case: UT2004's names and UDK's."""
    configure: Callable[[Any], AnyConfiguration] | None = None
    """Reply to GETCONF of a description; None for the interval alone."""
    shared_stream: str | None = None
    """Name of the random numbers, where all sensors of a robot report in one line as in USARSim;
    with a space, which no sensor's name has. None where each reports alone, under its own name."""
    casts_rays: bool = False
    """Whether readings measure the scene, which is then prepared before the server listens."""

    def assemble(
        self, name: str, descriptions: Sequence[SensorDescription], instrument: _Instrument
    ) -> Sensor:
        """Sensor of some descriptions, whose readings are of one instrument."""
        # One line for all, as often as the fastest of them.
        interval_s = min(description.interval_s for description in descriptions)
        parts = tuple(
            _MountedPart(self.part_type, each.name, each.mount, self._configure(each))
            for each in descriptions
        )
        return Sensor(self.part_type, name, interval_s, parts, instrument)

    def _configure(self, description: SensorDescription) -> AnyConfiguration:
        if self.configure is not None:
            return self.configure(description)
        return ScanIntervalConfiguration(self.part_type, description.name, description.interval_s)


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
