"""Sections of a recipe that say where its samples are taken: random, grid, path or drive.

    [Catoptra.RandomPoses]  Clearance, MaxTries, X, Y, Yaw, Speed, YawRate
    [Catoptra.GridPoses]    X, Y, Yaw: (Min=,Max=,Count=)
    [Catoptra.PathPoses]    Points=(X=,Y=), one a line; Spacing, Speed
    [Catoptra.DrivePoses]   Samples, Interval, WheelSpeed, Hold; for its start, all of RandomPoses

The robot stands on the floor: a pose is X, Y in metres and Yaw in radians, clockwise from above.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.world_values import MAX_LENGTH_M
from catoptra_server.datasets.recipe import (
    DrivePoses,
    GivenPose,
    GivenPoses,
    PoseRecipe,
    RandomPoses,
    ValueRange,
)
from catoptra_server.datasets.recipe_values import read_range, read_range_struct
from catoptra_server.simulation.robot_description import PlanarPose

POSE_KINDS = ("random", "grid", "path", "drive")
TICK_S = 0.02
"""Tick of drives, that of a server by default."""

_FULL_TURN = ValueRange(0.0, 2.0 * math.pi)
_ZERO = ValueRange(0.0, 0.0)
_MAX_TURN_RAD = 100.0
_MAX_SPEED = 100.0
# Each pose is checked against the obstacles of each world before anything is drawn.
_MAX_POSES = 1_000_000
_MAX_COUNT = 10_000


def read_poses(file: IniFile, kind: str) -> PoseRecipe:
    """Poses of a kind.

    Raises:
        ConfigError: For a missing key, an empty range, or too many poses.
    """
    match kind:
        case "random":
            return _read_random(file.get_section("Catoptra.RandomPoses"))
        case "grid":
            return _read_grid(file.get_section("Catoptra.GridPoses"))
        case "path":
            return _read_path(file.get_section("Catoptra.PathPoses"))
        case _:
            return _read_drive(file.get_section("Catoptra.DrivePoses"))


def _read_random(section: SectionReader) -> RandomPoses:
    return RandomPoses(
        clearance_m=section.get_float("Clearance", 0.02, min_value=0.0, max_value=100.0),
        max_tries=section.get_int("MaxTries", 1000, min_value=1, max_value=1_000_000),
        x_m=_read_extent(section, "X"),
        y_m=_read_extent(section, "Y"),
        yaw_rad=read_range(
            section, "Yaw", _FULL_TURN, min_value=-_MAX_TURN_RAD, max_value=_MAX_TURN_RAD
        ),
        speed_m_s=read_range(section, "Speed", _ZERO, min_value=-_MAX_SPEED, max_value=_MAX_SPEED),
        yaw_rate_rad_s=read_range(
            section, "YawRate", _ZERO, min_value=-_MAX_SPEED, max_value=_MAX_SPEED
        ),
        where=section.where,
    )


def _read_extent(section: SectionReader, key: str) -> ValueRange | None:
    if not section.get_str(key, ""):
        return None
    return read_range(section, key, _ZERO, min_value=-MAX_LENGTH_M, max_value=MAX_LENGTH_M)


def _read_grid(section: SectionReader) -> GivenPoses:
    xs, ys = (_read_axis(section, key, MAX_LENGTH_M) for key in "XY")
    yaws = _read_axis(section, "Yaw", _MAX_TURN_RAD) if section.has_key("Yaw") else [0.0]
    if len(xs) * len(ys) * len(yaws) > _MAX_POSES:
        raise section.make_error("X", expected=f"a grid of at most {_MAX_POSES} poses")
    where = section.find_location("X")
    poses = tuple(GivenPose(PlanarPose(x, y, yaw), where) for x in xs for y in ys for yaw in yaws)
    return GivenPoses(poses, is_path=False, interval_s=0.0, speed_m_s=0.0)


def _read_axis(section: SectionReader, key: str, max_value: float) -> list[float]:
    """Evenly spaced values, both ends included."""
    struct = section.get_struct(key, example="(Min=-1,Max=1,Count=5)")
    extent = read_range_struct(section, key, struct, -max_value, max_value)
    count = struct.get_int("Count", min_value=1, max_value=_MAX_COUNT)
    return [float(value) for value in np.linspace(extent.low, extent.high, count)]


def _read_path(section: SectionReader) -> GivenPoses:
    spacing_m = section.get_float("Spacing", 0.1, min_value=1e-3, max_value=MAX_LENGTH_M)
    speed_m_s = section.get_float("Speed", 0.5, min_value=1e-3, max_value=_MAX_SPEED)
    points = section.get_structs("Points", example="(X=0,Y=0)")
    if len(points) < 2:
        raise section.make_error("Points", expected="at least two points, such as (X=0,Y=0)")
    places = [
        np.array([p.get_float(k, min_value=-MAX_LENGTH_M, max_value=MAX_LENGTH_M) for k in "XY"])
        for p in points
    ]
    poses: list[GivenPose] = []
    travelled_m = 0.0  # along all lines so far
    for begin, end, point in zip(places, places[1:], points[1:], strict=False):
        length_m = float(np.hypot(*(end - begin)))
        if length_m == 0.0:
            raise point.make_error("X", expected="a point apart from the one before")
        yaw_rad = math.atan2(end[1] - begin[1], end[0] - begin[0])
        # The next multiple of the spacing, counted from the first point: corners do not restart it.
        first = math.ceil(travelled_m / spacing_m - 1e-9)
        last = math.floor((travelled_m + length_m) / spacing_m + 1e-9)
        if len(poses) + last - first > _MAX_POSES:
            raise section.make_error("Spacing", expected=f"a path of at most {_MAX_POSES} poses")
        for number in range(first, last + 1):
            if number < len(poses):  # a pose at the corner belongs to the line before
                continue
            x, y = begin + (end - begin) * ((number * spacing_m - travelled_m) / length_m)
            poses.append(GivenPose(PlanarPose(float(x), float(y), yaw_rad), point.where))
        travelled_m += length_m
    return GivenPoses(
        tuple(poses), is_path=True, interval_s=spacing_m / speed_m_s, speed_m_s=speed_m_s
    )


def _read_drive(section: SectionReader) -> DrivePoses:
    interval_s = section.get_float("Interval", 0.2, min_value=TICK_S, max_value=3600.0)
    ticks = round(interval_s / TICK_S)
    if abs(ticks * TICK_S - interval_s) > 1e-9:
        raise section.make_error("Interval", expected=f"a multiple of the tick of {TICK_S} s")
    return DrivePoses(
        start=_read_random(section),
        num_samples=section.get_int("Samples", 50, min_value=1, max_value=100_000),
        interval_s=interval_s,
        wheel_speed_rad_s=read_range(
            section, "WheelSpeed", ValueRange(-1.0, 5.0), min_value=-1000.0, max_value=1000.0
        ),
        hold_s=read_range(
            section, "Hold", ValueRange(0.5, 2.0), min_value=TICK_S, max_value=3600.0
        ),
    )
