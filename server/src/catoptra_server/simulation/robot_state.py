"""The robots as a viewer sees them: poses, commanded speeds, newest readings, published notes."""

from __future__ import annotations

from collections.abc import Iterable

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.reports import Report
from catoptra_server.simulation.robot import PublishedNote, Robot


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


@dataclass(frozen=True, slots=True, eq=False)
class FleetState:
    """All robots at one time, and the details of one of them."""

    robots: tuple[RobotSnapshot, ...]
    """In the order of spawning."""
    robot: str = ""
    """Robot of readings and notes; empty for none."""
    reports: tuple[Report, ...] = ()
    """Newest reading of each sensor, and the status."""
    notes: tuple[PublishedNote, ...] = ()


def collect_fleet_state(robots: Iterable[Robot], detailed: Robot | None) -> FleetState:
    """State of robots, with readings and notes of one of them, if any."""
    snapshots = tuple(map(_snapshot, robots))
    if detailed is None:
        return FleetState(snapshots)
    return FleetState(snapshots, detailed.name, detailed.newest_reports, detailed.notes)


def _snapshot(robot: Robot) -> RobotSnapshot:
    return RobotSnapshot(
        robot.name,
        robot.class_name,
        robot.world_from_robot,
        robot.world_from_start,
        robot.wheel_speeds_rad_s,
        robot.shares_control,
    )
