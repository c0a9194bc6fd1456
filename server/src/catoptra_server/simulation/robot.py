"""A spawned robot: body, sensors, cameras, mission packages, battery, reports and notes.

A robot moves by one tick at a time and reads sensors when reports are due. Who gives the commands
is not known here. Viewers get the robots as a frozen `FleetState`: poses, commanded speeds, newest
readings, published notes.

* All periods start together: the first reports are due at once. A period of 0.05 s keeps the mean
  in ticks of 0.02 s.
* Random numbers are keyed by the server's seed and the robot's name, never by the order of
  connections: a drive is reproducible whichever clients are connected.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.optics.elementary import arctan2, hypot, matmul
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.commands import Command, Drive, MisPkg, Note, line_from_command
from catoptra_protocol.usarsim.reports import Report, VehicleStatus
from catoptra_protocol.vectors import Vector3
from catoptra_server.frames.multi_view import Viewports
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.drive import MoveBase, RobotBody, WheelSpin, step_body
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors import (
    EMPTY_ENVIRONMENT,
    MotionStep,
    Part,
    Sensor,
    SensorContext,
    SensorEnvironment,
    build_sensors,
)
from catoptra_server.simulation.sensors.mission_package import MissionPackage
from catoptra_server.simulation.sensors.omni_camera import OmniCameraSensor
from catoptra_server.simulation.sensors.perspective_camera import PerspectiveCameraSensor
from catoptra_server.world.objects import NoiseSeed, OrientedBox
from catoptra_server.world.world_description import AT_REST, Twist

CameraSensor = OmniCameraSensor | PerspectiveCameraSensor
EnvironmentProvider = Callable[[], SensorEnvironment]
# Name of the random numbers of wheel slip.
_SLIP_STREAM = "slip"


# A note, and the simulation time of its arrival.
_PublishedNote = tuple[Note, float]
# Number from 1 on, simulation time, line without end.
_LoggedCommand = tuple[int, float, str]
# Of lines of commands that are kept, and of those that one reply may have.
_MAX_COMMANDS_BYTES, _MAX_LISTED_BYTES = 2**18, 2**16
# Ticks that are kept, and those that one reply may have.
_MAX_TICKS, _MAX_LISTED_TICKS = 256, 64


class Robot:
    """A robot of one client.

    All random numbers follow from the server's seed and the robot's name, so that a drive is
    reproducible whichever clients are connected.
    """

    def __init__(
        self,
        description: RobotDescription,
        body: RobotBody,
        *,
        name: str,
        seed: int,
        time_s: float,
        number: int = 1,
    ) -> None:
        """Spawn the robot.

        Args:
            description: Class of the robot.
            body: Its base, where it stands.
            name: Name that no other robot has.
            seed: Seed of the server.
            time_s: Simulation time; the first reports are due at once.
            number: Number among all robots that were ever spawned, from 1.
        """
        self.name = name
        self.number = number
        self.description = description
        self.omni_cameras = [
            OmniCameraSensor(omni, description) for omni in description.omni_cameras
        ]
        self.perspective_cameras = [
            PerspectiveCameraSensor(camera, description)
            for camera in description.perspective_cameras
        ]
        self.mission_packages = [MissionPackage(each) for each in description.mission_packages]
        # Joints of the chassis, such as flippers, move like a package's and report with STA.
        joints = description.chassis_joints
        self._chassis_joints = [MissionPackage(joints)] if joints else []
        self.sensors: list[Sensor] = build_sensors(
            description.sensors,
            description.drive,
            lambda part: RandomSource.from_names(seed, name, _stream_name(part)),
        )
        self._body = body
        self.world_from_start = self.world_from_robot
        """Pose of the chassis frame at which the robot was spawned."""
        self._slip = RandomSource.from_names(seed, name, _SLIP_STREAM)
        self._noise_sources = {
            camera.name: RandomSource.from_names(seed, name, f"noise of {camera.name}")
            for camera in self.all_cameras
        }
        # The last entry of the schedule is the status, which has no sensor.
        intervals = [sensor.interval_s for sensor in self.sensors]
        self._schedule = _ReportSchedule([*intervals, description.status_interval_s], time_s)
        self._battery_empty_s = time_s + description.battery_s
        self._light = False
        # Set by a command whose driver may fall silent.
        self._halt_at_s = math.inf
        self.twist = AT_REST
        """Motion in the last tick, slip included, at the chassis origin in world axes."""
        self.commands = CommandLog()
        # Only for who asks: a scan has some hundred numbers.
        self._ticks: deque[TickSnapshot] | None = None
        # One entry a sensor: as many as the robot file lists.
        self._newest_reports: dict[object, Report] = {}
        self._notes: dict[str, _PublishedNote] = {}
        self.shares_control = False
        """Whether other clients may drive the robot."""
        self.viewports = Viewports([camera.name for camera in self.all_cameras])
        self.tile_index = -1
        """Tile of the first camera in a multi-view, -1 without one."""

    @property
    def class_name(self) -> str:
        """Class of the robot with its package, such as USARBot.OmniP2AT."""
        return self.description.class_name

    @property
    def world_from_robot(self) -> Pose:
        """Pose of the chassis frame."""
        return self._body.world_from_robot

    @property
    def mishap(self) -> str:
        """In words, how the robot lies after a fall; empty on its wheels."""
        return self._body.mishap

    @property
    def tilt_sine(self) -> float:
        """Sine of the angle between the robot's axis and the vertical."""
        down = float(self._body.world_from_robot.rotation[2, 2])
        return math.sqrt(max(0.0, 1.0 - down * down))

    @property
    def is_solid(self) -> bool:
        """Whether others meet, measure and see it: no tripod."""
        return not self.description.drive.is_tripod

    @property
    def may_move(self) -> bool:
        """Whether it may be elsewhere after the next tick."""
        return self.is_rolling or not self._body.is_settled

    @property
    def location_m(self) -> Vector3:
        """Origin of the chassis frame in the world."""
        x, y, z = self.world_from_robot.translation.tolist()
        return x, y, z

    @property
    def is_rolling(self) -> bool:
        """Whether a wheel speed other than 0 is commanded."""
        return self._body.spin != WheelSpin()

    @property
    def wheel_speeds_rad_s(self) -> tuple[float, float]:
        """Commanded speeds of the left and the right wheels."""
        return self._body.spin.left_rad_s, self._body.spin.right_rad_s

    @property
    def newest_reports(self) -> tuple[Report, ...]:
        """Newest report of each sensor and package, and the newest status."""
        return tuple(self._newest_reports.values())

    @property
    def notes(self) -> tuple[_PublishedNote, ...]:
        """Newest note of each name, in the order of the names' first notes."""
        return tuple(self._notes.values())

    def publish(self, note: Note, time_s: float) -> None:
        """Store a note in place of the older one of that name.

        Raises:
            LocalProtocolError: The robot has notes of as many other names as it may.
        """
        from catoptra_protocol.notes import check_note_count

        check_note_count(self._notes, note.name)
        self._notes[note.name] = (note, time_s)

    @property
    def bounding_box(self) -> OrientedBox:
        """Box that other robots collide with and measure: from the plane of the wheels up."""
        drive = self.description.drive
        size_m = drive.collision_size_m
        middle = Pose(np.eye(3), np.array((0.0, 0.0, drive.ride_height_m - 0.5 * size_m[2])))
        return OrientedBox(self.world_from_robot @ middle, size_m)

    @property
    def all_cameras(self) -> list[CameraSensor]:
        """Cameras of the robot, the omnidirectional ones first."""
        return [*self.omni_cameras, *self.perspective_cameras]

    def find_camera(self, name: str) -> CameraSensor | None:
        """Camera of a name in any case; the first camera for an empty name."""
        named = (c for c in self.all_cameras if name.lower() in ("", c.name.lower()))
        return next(named, None)

    def noise_seed_for(self, camera: str) -> NoiseSeed:
        """Seed of the image noise of a camera in this tick."""
        # The tick, not a frame number: a second client that requests frames of the same camera
        # changes nobody's noise.
        return NoiseSeed.from_source(self._noise_sources[camera], self._body.tick)

    @property
    def joint_angles_rad(self) -> dict[str, float]:
        """Angles of the chassis's and all packages' joints, by link name in lower case."""
        chains = (*self._chassis_joints, *self.mission_packages)
        return {name: angle for chain in chains for name, angle in chain.joint_angles_rad().items()}

    def has_power(self, time_s: float) -> bool:
        """Whether the battery is not empty; without power the robot executes no command."""
        return time_s < self._battery_empty_s

    def drive_wheels(self, drive: Drive, time_s: float) -> None:
        """Set wheel speeds and the head light; a side that the command leaves out is unchanged."""
        if not self.has_power(time_s):
            return
        self.commands.add(drive, time_s)
        max_rad_s = self.description.drive.max_speed_rad_s
        unit = max_rad_s / 100.0 if drive.normalized else 1.0  # normalized: in per cent
        spin = self._body.spin
        left = spin.left_rad_s if drive.left is None else unit * drive.left
        right = spin.right_rad_s if drive.right is None else unit * drive.right
        self._body = dataclasses.replace(
            self._body, spin=WheelSpin(left, right).limit_to(max_rad_s)
        )
        if drive.flip:
            self._body = dataclasses.replace(self._body, is_flipping=True, is_settled=False)
        self._light = self._light if drive.light is None else drive.light
        if drive.left is not None or drive.right is not None:
            after_s = math.inf if drive.halt_after_s is None else drive.halt_after_s
            self._halt_at_s = time_s + after_s

    def drive_joint(self, name: str, value: float | None, order: int) -> None:
        """Command a joint by the name of the link; an unknown name has no effect."""
        for chain in (*self._chassis_joints, *self.mission_packages):
            number = chain.find_link_number(name)
            if number is not None and value is not None:
                chain.command_joint(number, value, order)

    def drive_mission_package(self, command: MisPkg) -> None:
        """Command the links of a package; grippers and sequences are not simulated."""
        for package in self.mission_packages:
            if package.name.lower() == command.name.lower():
                for link in command.links:
                    if link.value is not None:
                        package.command_joint(link.link, link.value, link.order)

    def step(self, duration_s: float, time_s: float, move: MoveBase) -> None:
        """Move body and joints by one tick, and update the sensors.

        Args:
            duration_s: Length of the tick.
            time_s: Simulation time at the end of the tick.
            move: The ground.
        """
        if self.has_power(time_s):
            for chain in (*self._chassis_joints, *self.mission_packages):
                chain.step(duration_s)
        else:
            self._body = dataclasses.replace(self._body, spin=WheelSpin())
        if time_s >= self._halt_at_s:
            self._halt_at_s = math.inf
            self._body = dataclasses.replace(self._body, spin=WheelSpin())
        before = self._body
        self._body, travel = step_body(before, duration_s, move=move, random_source=self._slip)
        # From poses, not from wheel travel: slip and obstacles are part of the motion blur.
        self.twist = _mean_twist(before, self._body, duration_s)
        motion = MotionStep(travel, self._body.tick, duration_s, self._body.pose)
        # Without power, too: the errors of a drifting sensor grow while the robot stands.
        for sensor in self.sensors:
            sensor.instrument.update(motion)

    def sensor_context(
        self, time_s: float, environment: SensorEnvironment = EMPTY_ENVIRONMENT
    ) -> SensorContext:
        """State that readings of this time depend on."""
        return SensorContext(
            time_s, self._body.tick, self.world_from_robot, environment, self.joint_angles_rad
        )

    def read_all(
        self, time_s: float, sense: EnvironmentProvider = lambda: EMPTY_ENVIRONMENT
    ) -> list[Report]:
        """Reports of a whole cycle in UT2004's order: sensors, mission packages, STA."""
        return self._log_tick(time_s, self._read(range(len(self.sensors) + 1), time_s, sense))

    def read_due(
        self, time_s: float, sense: EnvironmentProvider = lambda: EMPTY_ENVIRONMENT
    ) -> list[Report]:
        """Reports that are due at a time, which is taken off the schedule."""
        return self._log_tick(time_s, self._read(self._schedule.pop_due(time_s), time_s, sense))

    def _log_tick(self, time_s: float, reports: list[Report]) -> list[Report]:
        """The reports, which become part of the tick of a time where ticks are kept."""
        if self._ticks is not None:
            has_tick = self._ticks and self._ticks[-1].time_s == time_s
            before = self._ticks.pop().reports if has_tick else ()
            pose, speeds = self.world_from_robot, self.wheel_speeds_rad_s
            self._ticks.append(TickSnapshot(time_s, pose, speeds, (*before, *reports)))
        return reports

    def list_ticks_after(self, time_s: float) -> tuple[TickSnapshot, ...]:
        """Ticks after a time, as many as a reply may have; they are kept from now on."""
        if self._ticks is None:
            self._ticks = deque(maxlen=_MAX_TICKS)
        newer = (tick for tick in self._ticks if tick.time_s > time_s)
        return tuple(itertools.islice(newer, _MAX_LISTED_TICKS))

    def _read(
        self, indices: Sequence[int], time_s: float, sense: EnvironmentProvider
    ) -> list[Report]:
        """Reports of the sensors with these indices; the index after the last is the status."""
        # Most ticks have no due report: the boxes of the other robots are not computed for them.
        if not indices:
            return []
        context = self.sensor_context(time_s, sense())
        due = [i for i in indices if i < len(self.sensors)]
        reports: list[Report] = [self.sensors[i].instrument.read(context) for i in due]
        if len(due) < len(indices):
            reports += [*(p.status(time_s) for p in self.mission_packages), self._status(time_s)]
        for report in reports:
            self._newest_reports[type(report), getattr(report, "name", "")] = report
        return reports

    def _status(self, time_s: float) -> VehicleStatus:
        # Whole seconds, as UT2004 counts down.
        left_s = max(0, int(self._battery_empty_s - time_s))
        joints = tuple(
            joint for chain in self._chassis_joints for joint in chain.list_joint_angles()
        )
        return VehicleStatus(time_s, left_s, light=self._light, view=self.tile_index, joints=joints)

    def find_parts_of_type(self, type_: str) -> list[Part]:
        """Parts of a type in any case, in the order of their reports."""
        reporting = (part for sensor in self.sensors for part in sensor.parts)
        parts: list[Part] = [*reporting, *self.all_cameras, *self.mission_packages]
        return [part for part in parts if part.type.lower() == type_.lower()]


@dataclass(frozen=True, slots=True, eq=False)
class RobotSnapshot:
    """One robot at one time."""

    name: str
    class_name: str
    world_from_robot: Pose
    """True pose of the chassis frame."""
    world_from_start: Pose
    """Pose at which the robot was spawned."""
    wheel_speeds_rad_s: tuple[float, float]
    """Commanded speeds of the left and the right wheels."""
    shares_control: bool
    wheel_radius_m: float
    wheel_separation_m: float


@dataclass(frozen=True, slots=True, eq=False)
class TickSnapshot:
    """A robot after a tick, with the reports of this tick."""

    time_s: float
    world_from_robot: Pose
    wheel_speeds_rad_s: tuple[float, float]
    reports: tuple[Report, ...]


@dataclass(frozen=True, slots=True, eq=False)
class FleetState:
    """All robots at one time, and the details of one of them."""

    robots: tuple[RobotSnapshot, ...]
    """In the order of spawning."""
    robot: str = ""
    """Robot of readings and notes; empty for none."""
    reports: tuple[Report, ...] = ()
    """Newest reading of each sensor, and the status."""
    notes: tuple[_PublishedNote, ...] = ()
    """Notes with the simulation times of their arrival."""
    commands: tuple[_LoggedCommand, ...] = ()
    """Commands to it, as far as requested."""
    ticks: tuple[TickSnapshot, ...] = ()
    """Its ticks, as far as requested."""


def collect_fleet_state(
    robots: Iterable[Robot],
    detailed: Robot | None,
    commands_after: int | None = None,
    ticks_after: float | None = None,
) -> FleetState:
    """State of robots, with readings, notes, and commands and ticks after some of one, if any."""
    snapshots = tuple(
        RobotSnapshot(
            robot.name,
            robot.class_name,
            robot.world_from_robot,
            robot.world_from_start,
            robot.wheel_speeds_rad_s,
            robot.shares_control,
            robot.description.drive.wheel_radius_m,
            robot.description.drive.wheel_separation_m,
        )
        for robot in robots
    )
    if detailed is None:
        return FleetState(snapshots)
    commands = () if commands_after is None else detailed.commands.list_after(commands_after)
    ticks = () if ticks_after is None else detailed.list_ticks_after(ticks_after)
    reports, notes = detailed.newest_reports, detailed.notes
    return FleetState(snapshots, detailed.name, reports, notes, commands, ticks)


class CommandLog:
    """The newest commands to a robot, from INIT on, with numbers and times."""

    def __init__(self) -> None:
        self._records: deque[_LoggedCommand] = deque()
        self._num_commands = self._num_bytes = 0

    def add(self, command: Command, time_s: float) -> None:
        """Add a command that is executed at a simulation time."""
        self._num_commands += 1
        try:
            line = line_from_command(command).decode("latin-1").rstrip("\r\n")
        except LocalProtocolError:  # of the stream, with a name that no line can have
            return
        self._records.append((self._num_commands, time_s, line))
        self._num_bytes += len(line)
        while self._num_bytes > _MAX_COMMANDS_BYTES:
            self._num_bytes -= len(self._records.popleft()[2])

    def list_after(self, number: int) -> tuple[_LoggedCommand, ...]:
        """Commands after that of a number, as many as a reply may have."""
        found: list[_LoggedCommand] = []
        num_bytes = 0
        for record in self._records:
            if record[0] > number:
                num_bytes += len(record[2])
                if found and num_bytes > _MAX_LISTED_BYTES:
                    break
                found.append(record)
        return tuple(found)


# Two times closer than this are one tick: due times are sums of periods as floats.
_SAME_TIME_S = 1e-6


class _ReportSchedule:
    """Periods that start together: all first reports are due at once."""

    def __init__(self, intervals_s: Sequence[float], time_s: float) -> None:
        """Start the periods at a simulation time, one for each interval."""
        self._intervals_s = tuple(intervals_s)
        self._due_s = [time_s] * len(self._intervals_s)

    def pop_due(self, time_s: float) -> list[int]:
        """Indices that are due at a time, in order; their next times are set."""
        found = [i for i, due_s in enumerate(self._due_s) if time_s >= due_s - _SAME_TIME_S]
        for i in found:
            # Counted from the due time, not from now, so that a period of 0.05 s keeps its mean in
            # ticks of 0.02 s; after a pause from now, so that no burst of reports follows.
            self._due_s[i] = max(self._due_s[i] + self._intervals_s[i], time_s)
        return found


def _mean_twist(before: RobotBody, after: RobotBody, duration_s: float) -> Twist:
    """Mean motion between two poses."""
    # In plain floats: computed for every robot in every tick, where arrays of three are slow.
    if before.world_from_robot is after.world_from_robot:
        return AT_REST
    start, end = (one.world_from_robot.translation.tolist() for one in (before, after))
    vx, vy, vz = ((b - a) / duration_s for a, b in zip(start, end, strict=True))
    # The short way around: yaw is wrapped to (-pi, pi], and no tick turns by half a turn.
    turn_rad = math.remainder(after.pose.yaw_rad - before.pose.yaw_rad, math.tau)
    rotations = [one.world_from_robot.rotation for one in (before, after)]
    if rotations[0][2, 2] == 1.0 == rotations[1][2, 2]:
        return Twist((vx, vy, vz), (0.0, 0.0, turn_rad / duration_s))
    turned = matmul(rotations[1], rotations[0].T).tolist()
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = turned
    # The axis, by twice the sine of the angle. Half a turn has none here, and no tick has that.
    axis = (m21 - m12, m02 - m20, m10 - m01)
    sine, cosine = 0.5 * hypot(*axis), 0.5 * (m00 + m11 + m22 - 1.0)
    scale = 0.5 / duration_s * (arctan2(sine, cosine) / sine if sine > 0.0 else 1.0)
    return Twist((vx, vy, vz), (scale * axis[0], scale * axis[1], scale * axis[2]))


def _stream_name(part: str) -> str:
    """Name of a part's random numbers: the part's own, made distinct from the slip's."""
    # Names of parts have no space: "part slip" is no other part's name.
    return f"part {part}" if part == _SLIP_STREAM else part
