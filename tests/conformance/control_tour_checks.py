"""Checks of a recorded tour: the numbers of all reports and replies against each other.

Each compares two statements of the server, or one with what was commanded. Tolerances are physical:
printed decimals, the noise of a sensor, slip; a report that is late by one interval, a wrong unit,
sign or axis, or a scale that is wrong by a tenth exceeds most of them. What a server does not
report is not checked.
"""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from catoptra_protocol.usarsim.grammar import Message, items_from_message, split_groups
from conformance.check import (
    CheckFailed,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.control_forms import LISTED_TYPES, READING_FORMS, find_form, matches_form
from conformance.control_readings import (
    POSE_SENSORS,
    Floats,
    find_item_names,
    find_sonar_ranges,
    find_ticks,
    numbers_from_commas,
    read_number,
    read_numbers,
    wrap,
)
from conformance.control_session import ReceivedLine
from conformance.control_tour import (
    FOV_RAD,
    LINK_VALUES,
    PART_TYPES,
    Instant,
    Tour,
    joint_names,
    number_of,
    record_standing,
    record_tour,
    record_visits,
    start_poses,
)

TURNS, STRAIGHTS = ("right", "left"), ("first", "second")
_MOTIONS = (*TURNS, *STRAIGHTS)
# Two truncated decimals of either number.
_PLACE_M, _ANGLE_RAD = 0.04, 0.04
# Metres and radians in the root of a second: three deviations of the INS of UDK's DefaultUSAR.ini.
_DRIFT = 0.03
# Of a direction, besides the last decimals of a path of some decimetres.
_HEADING_RAD = 0.03
# Of lengths by the wheels alone, and of turns, whose wheels scrub.
_WHEELS, _WHEELS_IN_TURN, _SLIP = 0.05, 0.07, 0.3
_SPEED = 0.07
_SURFACE_M, _LEVEL_M = 0.15, 0.02
_METRES_PER_DEGREE = 111_200.0
# Of a scan's points in a turn: errors of the pose, and the distance between two rays of a degree.
_SCAN_MISS_M, _SCAN_MISS_PART, _MIN_POINTS = 0.06, 0.02, 20
# Clients read into buffers of 4096 bytes (Player, MATLAB's toolbox, UvA).
_MAX_LINE_BYTES = 4095
_LINE = re.compile(r"[A-Z]+( \{[^{}]*\})*")
# UDK leaves out some spaces, and has an empty body behind a space.
_UDK_LINE = re.compile(r"[A-Z]+( ?\{[^{}]*\})* ?")
_EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+|[-+]?(nan|inf|infinity)", re.IGNORECASE)


def _require(is_right: bool, reason: str) -> None:
    if not is_right:
        raise CheckFailed(reason)


def _is_close(a: float, b: float, relative: float, absolute: float) -> bool:
    return abs(a - b) <= relative * abs(b) + absolute


# --- Time ---


def check_times(tour: Tour) -> None:
    """Time is one clock: alike in all reports of an instant, as fast as the wall clock."""
    instants = [one for one in tour.instants if not math.isnan(one.time_s)]
    _require(len(instants) > 3, "no reports with a Time")
    times = np.array([one.time_s for one in instants])
    interval_s = float(np.median(np.diff(times)))
    lateness: dict[tuple[str, str], list[float]] = {}
    for instant in instants:
        for one in instant.reports:
            if (time_s := number_of(one, "Time")) is not None:
                key = one.word, one.get("Type") or ""
                lateness.setdefault(key, []).append(abs(time_s - instant.time_s))
    for key, values in lateness.items():
        late_s = statistics.median(values)
        _require(
            late_s <= 0.4 * interval_s + 0.011,
            f"{' '.join(key)}: Time differs by {late_s:.3f} s from that of reports sent together",
        )
    wall_s = instants[-1].received_s - instants[0].received_s
    elapsed_s = float(times[-1] - times[0])
    # A starved server leaves out some time; between most reports it keeps to the clock.
    intervals_s = np.diff([one.received_s for one in instants])
    # Two of a busy server may arrive at once.
    rate = np.median(np.diff(times) / np.maximum(intervals_s, 1e-6))
    _require(
        (_is_close(elapsed_s, wall_s, 0.25, 0.3) or _is_close(rate, 1.0, 0.1, 0.0))
        and (np.diff(times) > 0.0).all(),
        f"Time grew by {elapsed_s:.2f} s in {wall_s:.2f} s of the wall clock",
    )
    _require(times[-1] < 864_000.0, f"Time {times[-1]}: expected seconds since the start")
    for i, line in enumerate(tour.lines):
        if line.message.word == "RES" and (time_s := number_of(line.message, "Time")) is not None:
            before = [one.time_s for one in instants if one.received_s <= line.received_s]
            after = [one.time_s for one in instants if one.received_s > line.received_s]
            _require(
                max(before) - 0.05 <= time_s <= min(after, default=math.inf) + 0.05,
                f"line {i}, {line.text}: between reports of {max(before)} s and later",
            )


def check_intervals(tour: Tour) -> None:
    """A sensor reports as often as the ScanInterval of its CONF says."""
    for conf in tour.messages:
        interval_s = number_of(conf, "ScanInterval") if conf.word == "CONF" else None
        if interval_s is None:
            continue
        type_ = (conf.get("Type") or "").lower()
        times = [one.time_s for one in tour.instants if one.find(type_)]
        if len(times) > 3:
            mean_s = (times[-1] - times[0]) / (len(times) - 1)
            _require(
                _is_close(mean_s, interval_s, 0.06, 0.0), f"{conf}: a report each {mean_s:.3f} s"
            )


# --- Status and joints ---


def check_status(tour: Tour) -> None:
    """STA: battery by the clock, no steering of a skid-steered robot, light as commanded."""
    status = [(one.time_s, sta) for one in tour.instants for sta in one.find("sta")]
    (start_s, first), (end_s, last) = status[0], status[-1]
    fall = read_number(first, "Battery") - read_number(last, "Battery")
    rates = (0.0, 1.0) if tour.dialect == "udk" else (1.0,)
    _require(
        any(_is_close(fall, rate * (end_s - start_s), 0.05, 1.2) for rate in rates)
        and read_number(last, "Battery") >= 0.0,
        f"Battery fell by {fall} in {end_s - start_s:.1f} s",
    )
    robot = tour.find_robot("CONF")
    for side in ("Front", "Rear"):
        limit = read_number(robot, f"Max{side}Steer")
        _require(limit == 0.0, f"{robot}: a skid-steered robot does not steer")
        _require(abs(read_number(last, f"{side}Steer")) <= limit, f"{last}: {side}Steer")
    lit = tour.instants_of("light")[-1].find("sta")[-1]
    _require(
        (first.get("LightToggle"), lit.get("LightToggle")) == ("False", "True"),
        f"{first}, {lit}: the light was switched on",
    )
    for _, message in status:
        intensity = 100.0 if tour.dialect == "udk" or message.get("LightToggle") == "True" else 0.0
        _require(read_number(message, "LightIntensity") == intensity, f"{message}: LightIntensity")
    # With tiles a CONF of each camera comes unasked.
    if tour.dialect == "ut2004":
        has_tiles = any(
            line.message.word == "CONF" for line in tour.lines[: tour.marks["query"][0]]
        )
        view = read_number(last, "View")
        _require(view >= 0.0 if has_tiles else view == -1.0, f"{last}: View")
    else:
        _require(last.get("View") is None, f"{last}: UDK has no View")


def check_joints(tour: Tour) -> None:
    """Links and joints move to their commanded values, as fast as MaxSpeed, and so encoders."""
    # At rest in the first one.
    instants = [tour.instants_of("second")[-1], *tour.instants_of("joints")]
    limits = {
        ((conf.get("Name") or ""), read_number(group, "Link")): group
        for conf in tour.find_replies("CONF", "mispkg")
        for group in split_groups(conf, "Link")
    }
    values: dict[tuple[str, float], list[float]] = {}
    for instant in instants:
        for one in instant.reports:
            for link in split_groups(one, "Link") if one.word in ("MISSTA", "ASTA") else ():
                key = (one.get("Name") or ""), read_number(link, "Link")
                values.setdefault(key, []).append(read_number(link, "Value"))
                torque = abs(number_of(link, "Torque") or 0.0)
                _require(
                    key in limits and torque <= read_number(limits[key], "MaxTorque"),
                    f"{one}: Torque, or a link that CONF has not",
                )
    _require(list(values) == list(limits), f"links of CONF {limits}, of status {set(values)}")
    times = np.array([one.time_s for one in instants])
    for (name, link), series in values.items():
        goal = LINK_VALUES[int(link) - 1] if 1 <= link <= len(LINK_VALUES) else series[0]
        _require(abs(series[-1] - goal) < 0.01, f"{name}, link {link}: {series[-1]}, not {goal}")
        low, high = (read_number(limits[name, link], f"{key}Range") for key in ("Min", "Max"))
        _require(
            low > high or low - 0.02 <= min(series) <= max(series) <= high + 0.02,
            f"{name}, link {link}: {min(series)} to {max(series)} beyond {low} to {high}",
        )
        speeds = np.abs(np.diff(series) / np.diff(times))
        fastest, limit = float(speeds.max()), read_number(limits[name, link], "MaxSpeed")
        _require(
            0.5 * limit <= fastest <= 1.15 * limit + 0.01 or abs(goal - series[0]) < 0.05,
            f"{name}, link {link} moves by {fastest:.3f} rad/s: MaxSpeed {limit}",
        )
    for encoder, angles in _shaft_angles(tour, instants).items():
        change = angles - angles[0]
        # A single reading is a tick or two off, the mean of those at the goal is not: from there,
        # lest the noise of the first one counts as a delay.
        at_goal = angles - angles[-len(angles) // 3 :].mean()
        fits = [
            (series, _delay(at_goal, np.array(series) - series[-1]))
            for series in values.values()
            if abs(series[-1] - series[0] - change[-1]) < 0.03
        ]
        if abs(change[-1]) > 0.05 and values:
            _require(bool(fits), f"{encoder} turned by {change[-1]:.3f} rad, no link does")
            # A tick may take an interval: truncation and noise leave a deviation of 0.2.
            late = [round(delay, 2) for _, delay in fits]
            _require(any(abs(x) < 0.65 for x in late), f"{encoder} follows by {late} intervals")
    for name in joint_names(instants[-1].find("sta")[-1]):
        angle = read_number(instants[-1].find("sta")[-1], name)
        _require(abs(angle - LINK_VALUES[0]) < 0.01, f"{name}: {angle}, not {LINK_VALUES[0]}")


# --- Poses and wheels ---


def check_senses(tour: Tour) -> None:
    """The left side forward turns right, clockwise, on the place; a robot stands when told to."""
    for phase, sign in (("right", 1.0), ("left", -1.0)):
        for type_, track in _tracks(tour, phase).items():
            turn, away_m = sign * _turn(track), math.hypot(*(track[-1] - track[0])[:2])
            _require(turn > 0.25 and away_m < 0.3, f"{phase}: {type_} turned by {turn:.2f} rad")
    for type_, track in _tracks(tour, "light").items():
        away_m = math.hypot(*(track[-1] - track[0])[:2])
        _require(
            away_m < _PLACE_M and abs(_turn(track)) < _ANGLE_RAD,
            f"both sides 0: {type_} still moves, by {away_m:.3f} m",
        )


def check_headings(tour: Tour) -> None:
    """A robot that drives straight ahead moves along its yaw, by each sensor."""
    for phase in STRAIGHTS:
        for type_, track in _tracks(tour, phase).items():
            step = track[-1] - track[0]
            length = math.hypot(*step[:2])
            _require(length > 0.2, f"{type_}: moved by {length:.3f} m, driven ahead")
            error = wrap(math.atan2(step[1], step[0]) - _mean_angle(track[[0, -1], 5]))
            _require(
                abs(error) < _HEADING_RAD + 1.5 * _resolution_m(tour, type_) / length,
                f"{type_}: heading {track[-1, 5]:.3f} rad, motion {step[0]:.3f}, {step[1]:.3f} m",
            )


def check_world_poses(tour: Tour) -> None:
    """GroundTruth and the INS on its mount report one pose in the world, level on a level floor."""
    mounts = list(_places(tour, "ins").values())[:1] or [np.zeros(6)]
    for phase in ("stand", *_MOTIONS):
        for instant in (tour.instants_of(phase)[0], tour.instants_of(phase)[-1]):
            poses = _poses(instant)
            for type_ in poses.keys() & {"groundtruth", "ins"}:
                angles = poses[type_][3:]
                _require(
                    bool(
                        (
                            np.abs(angles[:2] - math.tau * np.round(angles[:2] / math.tau))
                            < _ANGLE_RAD
                        ).all()
                    )
                    and (tour.dialect == "udk" or bool(((angles >= 0) & (angles < 6.2832)).all())),
                    f"{type_}: Orientation {angles}",
                )
            if {"groundtruth", "ins"} <= poses.keys():
                difference = poses["ins"] - _compose(poses["groundtruth"], mounts[0])
                drift = _DRIFT * math.sqrt(max(instant.time_s - tour.instants[0].time_s, 0.0))
                _require(
                    bool((np.abs(difference[:3]) < _PLACE_M + drift).all())
                    and all(abs(wrap(float(x))) < _ANGLE_RAD + drift for x in difference[3:]),
                    f"{phase}: INS and GroundTruth differ by {np.round(difference, 3)}",
                )


def check_wheels(tour: Tour) -> None:
    """Encoders, tachometer and odometry measure one rolling, the robot moves as its wheels do."""
    conf, geo = tour.find_robot("CONF"), tour.find_robot("GEO")
    radius_m, separation_m = read_number(geo, "WheelRadius"), read_number(geo, "WheelSeparation")
    spin_rad_s = 0.01 * tour.speed_percent * read_number(conf, "MaxSpeed")
    for phase in _MOTIONS:
        instants, tracks = tour.instants_of(phase), _tracks(tour, phase)
        signs = {"right": (1, -1), "left": (-1, 1)}.get(phase, (1, 1))
        sides = _side_angles(tour, instants)
        tachometer = _tachometer(instants)
        for side, sign in zip(("left", "right"), signs, strict=True):
            series = [
                one for source in (sides, tachometer) for key, one in source.items() if key == side
            ]
            for one in series:
                speed = sign * _steady_speed(instants, one)
                _require(
                    _is_close(speed, spin_rad_s, _SPEED, 0.02),
                    f"{phase}: wheels of the {side} side turn at {speed:.3f} rad/s, "
                    f"commanded {spin_rad_s:.3f}",
                )
            if len(series) == 2:
                a, b = (float(one[-1] - one[0]) for one in series)
                _require(
                    _is_close(a, b, _WHEELS, 0.05),
                    f"{phase}, {side}: encoders {a:.3f} rad, tachometer {b:.3f} rad",
                )
        _require_spins(instants, spin_rad_s, signs)
        # Of a robot without encoders the only measure of Normalized; turns take a report or two.
        for type_, track in tracks.items() if phase in STRAIGHTS else ():
            path = np.hypot(*(track - track[0])[:, :2].T)
            speed_m_s, rolled_m_s = _steady_speed(instants, path), radius_m * spin_rad_s
            _require(
                _is_close(speed_m_s, rolled_m_s, _SLIP, 0.05),
                f"{phase}: {type_} {speed_m_s:.3f} m/s, {tour.speed_percent:g} % are "
                f"{rolled_m_s:.3f}",
            )
        if not sides:
            continue
        left_m, right_m = (radius_m * float(sides[x][-1] - sides[x][0]) for x in ("left", "right"))
        rolled_m, turned_rad = 0.5 * (left_m + right_m), (left_m - right_m) / separation_m
        for type_, track in tracks.items():
            length = math.hypot(*(track[-1] - track[0])[:2])
            turn = wrap(track[-1, 5] - track[0, 5])
            is_exact = type_ == "odometry"
            if phase in STRAIGHTS:
                tolerance = _WHEELS if is_exact else _SLIP
                is_right = _is_close(length, rolled_m, tolerance, 0.01)
            else:
                tolerance = _WHEELS_IN_TURN if is_exact else _SLIP
                is_right = _is_close(turn, wrap(turned_rad), tolerance, 0.02)
            _require(
                is_right,
                f"{phase}: {type_} {length:.3f} m, {turn:.3f} rad; wheels {rolled_m:.3f} m, "
                f"{turned_rad:.3f} rad",
            )


def check_progress(tour: Tour) -> None:
    """All sensors follow one motion: none is late by an interval."""
    for phase in _MOTIONS:
        instants = tour.instants_of(phase)
        series: dict[str, Floats] = dict(_motion_series(tour, phase, instants))
        shares = {
            name: (one - one[0]) / (one[-1] - one[0])
            for name, one in series.items()
            if abs(one[-1] - one[0]) > 0.1
        }
        if len(shares) < 2:
            continue
        common = np.median(np.array(list(shares.values())), axis=0)
        for name, share in shares.items():
            late = _delay(share, common)
            # A beam may meet another part of a surface, and be ahead by that; no sensor really is.
            least, most = (-1.5, 0.75) if name.startswith(("sonar", "scan")) else (-0.5, 0.5)
            _require(least < late < most, f"{phase}: {name} is late by {late:.2f} intervals")


def check_odometry_origin(tour: Tour) -> None:
    """Odometry begins at 0, and RESET makes the pose of the robot the origin; RES (UT2004)."""
    for phase, instant in (
        ("stand", tour.instants_of("stand")[0]),
        ("reset", tour.instants_of("reset")[-1]),
    ):
        for one in instant.find("odometry"):
            pose = read_numbers(one, "Pose", 3)
            _require(max(map(abs, pose)) < 0.02, f"{phase}: {one}: expected the origin")
    if tour.dialect == "ut2004" and tour.instants[-1].find("odometry"):
        results = [one for one in tour.find_replies("RES", "odometry", "reset")]
        _require(any(one.get("Status") == "OK" for one in results), "RESET: no RES with OK")


# --- Ranges ---


def check_scan(tour: Tour) -> None:
    """A scan has FOV / Resolution + 1 ranges, as CONF states; without an echo MaxRange."""
    confs = {one.get("Name"): one for one in tour.find_replies("CONF", "rangescanner")}
    ranges: list[float] = []
    for instant in tour.instants:
        for one in instant.find("rangescanner"):
            conf = confs[one.get("Name")]
            values = numbers_from_commas(one.get("Range") or "")
            fov, resolution = read_number(one, "FOV"), read_number(one, "Resolution")
            fewest, most = fov / (resolution + 1e-4) + 0.999, (fov + 1e-4) / resolution + 1.001
            _require(fewest <= len(values) <= most, f"{one.word}: {len(values)} ranges in {fov}")
            for name, value in (("Fov", fov), ("Resolution", resolution)):
                _require(abs(read_number(conf, name) - value) < 2e-4, f"{conf}: {name} {value}")
            ranges += values
    for conf in confs.values():
        _require_limits(conf, ranges)


def check_scan_order(tour: Tour) -> None:
    """Scans of a robot before and after a turn meet the same surfaces."""
    stops = tour.instants_of("stand")[0], tour.instants_of("right")[-1]
    before, after = (_scan_points(tour, one) for one in stops)
    if before is None or after is None or min(len(before), len(after)) < _MIN_POINTS:
        return
    ranges = np.linalg.norm(after - _first_pose(_poses(stops[1]))[:2], axis=1)
    misses = np.linalg.norm(after[:, None] - before, axis=-1).min(axis=1)
    # Of most points: others were hidden, or are between two rays.
    miss_m, far_m = float(np.median(misses)), float(np.median(ranges))
    _require(
        miss_m < _SCAN_MISS_M + _SCAN_MISS_PART * far_m,
        f"points of the scan are {miss_m:.2f} m off those before a turn, at {far_m:.1f} m",
    )


def check_sonars(tour: Tour) -> None:
    """Sonars see no further than the scanner, in its plane as far, from where GEO has them."""
    confs = {(one.get("Name") or "").lower(): one for one in tour.find_replies("CONF", "sonar")}
    stops = [tour.instants_of("stand")[0], *(tour.instants_of(one)[-1] for one in _MOTIONS)]
    readings = [find_sonar_ranges({"sonar": one.find("sonar")}) for one in tour.instants]
    for conf in confs.values():
        _require_limits(conf, [x for one in readings for x in one.values()])
    places = _places(tour, "sonar")
    heights = [one[2] for one in _places(tour, "rangescanner").values()]
    points = [_scan_points(tour, stop) for stop in stops]
    surfaces = np.concatenate([one for one in points if one is not None] or [np.zeros((0, 2))])
    checked, wrong = 0, []
    for stop in stops if len(surfaces) else ():
        pose = _poses(stop).get("groundtruth")
        if pose is None:
            continue
        for name, range_m in find_sonar_ranges({"sonar": stop.find("sonar")}).items():
            beam_rad = next(
                read_number(confs[name], key)
                for key in ("BeamAngle", "beamAngle")
                if confs[name].get(key) is not None
            )
            sonar = _compose(pose, places[name])
            offsets = surfaces - sonar[:2]
            distances = np.hypot(*offsets.T)
            angles = np.arctan2(offsets[:, 1], offsets[:, 0]) - sonar[5]
            angles = np.abs(angles - math.tau * np.round(angles / math.tau))
            inner = distances[angles < 0.3 * beam_rad]
            outer = distances[angles < 0.5 * beam_rad + 0.1]
            if inner.size and range_m < 0.98 * read_number(confs[name], "MaxRange"):
                checked += 1
                # Of what is lower, or higher, than the scanner's plane only a sonar in it knows.
                is_level = min(abs(places[name][2] - z) for z in heights) < _LEVEL_M
                least = outer.min() - _SURFACE_M if is_level else 0.0
                if not least <= range_m <= inner.min() + _SURFACE_M:
                    wrong.append(f"{name} {range_m:.2f} ({outer.min():.2f}-{inner.min():.2f})")
    _require(len(wrong) <= 0.1 * checked, f"sonars against the scanner: {', '.join(wrong)}")


def check_victims(tour: Tour) -> None:
    """A victim's part stays at its place in the world while the robot turns and drives."""
    places = _places(tour, "victsensor")
    seen: dict[str, list[Floats]] = {}
    for instant in tour.instants:
        for one in instant.find("victsensor"):
            if "groundtruth" not in _poses(instant):
                continue
            sensor = _compose(
                _poses(instant)["groundtruth"], places[(one.get("Name") or "").lower()]
            )
            for part in split_groups(one, "PartName"):
                x, y, z = read_numbers(part, "Location", 3)
                world = _compose(sensor, np.array([x, y, z, 0.0, 0.0, 0.0]))
                seen.setdefault(part.get("PartName") or "", []).append(world[:3])
    floor = max(read_numbers(tour.find_robot("GEO"), "Dimensions", 3))
    for name, where in seen.items():
        above = [_poses(tour.instants[0])["groundtruth"][2] - float(one[2]) for one in where]
        _require(-floor < min(above) and max(above) < 3.0, f"victim {name}: height {above[0]:.2f}")
        spread = np.abs(np.array(where) - np.median(where, axis=0))
        _require(
            float(spread.mean(axis=0).max()) < 0.03 and float(spread.max()) < 0.15,
            f"victim {name}: places differ by {np.round(spread.max(axis=0), 2)} m",
        )


# --- Configuration and geometry ---


def check_robot(tour: Tour) -> None:
    """Sizes of the robot fit together: wheels in its outline, mass to its volume."""
    conf, geo = tour.find_robot("CONF"), tour.find_robot("GEO")
    length, width, height = size = read_numbers(geo, "Dimensions", 3)
    # Classes of UDK state the rectangle of their wheels, without a height.
    is_flat = tour.dialect == "udk" and height == 0.0
    _require(min(size[: 2 if is_flat else 3]) > 0.02 and max(size) < 10.0, f"{geo}: Dimensions")
    _require(length >= 0.6 * width and height <= 2.0 * width, f"{geo}: Dimensions")
    mass, height_m = read_number(conf, "Mass"), 0.5 * width if is_flat else height
    # A flying robot has the density of its rods.
    _require(10.0 < mass / (length * width * height_m) < 1500.0, f"{conf}, {geo}: Mass")
    # Captures of UDK have 50000.
    most = 1e5 if tour.dialect == "udk" else 100.0 * mass
    _require(1.0 <= read_number(conf, "MaxTorque") <= most, f"{conf}: MaxTorque")
    for name, most in (("WheelSeparation", width), ("WheelBase", length)):
        _require(0.3 * most <= read_number(geo, name) <= 1.02 * most, f"{geo}: {name}")
    _require(0.02 * length < read_number(geo, "WheelRadius") < 0.5 * length, f"{geo}: WheelRadius")
    centre = read_numbers(geo, "COG", 3)
    _require(all(abs(x) <= 0.5 * y for x, y in zip(centre, size, strict=True)), f"{geo}: COG")


def check_parts(tour: Tour) -> None:
    """Parts are on the robot, angles within a turn, limits in order and positive."""
    size = max(read_numbers(tour.find_robot("GEO"), "Dimensions", 3))
    for message in tour.messages:
        if message.word == "GEO" and message.get("Dimensions") is None:
            links = split_groups(message, "Link")
            for item in links or items_from_message(message):
                if item.get("Location") is None:
                    continue
                location = read_numbers(item, "Location", 3)
                _require(max(map(abs, location)) <= 1.2 * size, f"{item}: off the robot")
                angles = read_numbers(item, "Orientation", 3)
                _require(max(map(abs, angles)) <= math.pi + 0.01, f"{item}: Orientation")
            numbers = [read_number(one, "Link") for one in links]
            _require(numbers == sorted(set(numbers)), f"{message}: Link")
            parents = {read_number(one, "ParentLink") for one in links}
            _require(parents <= {-1.0, *numbers}, f"{message}: ParentLink")
        elif message.word == "CONF":
            links = split_groups(message, "Link")
            numbers = [read_number(one, "Link") for one in links]
            _require(numbers == sorted(set(numbers)), f"{message}: Link")
            for part in links or [message]:
                _require_plausible(part)


def check_cameras(tour: Tour) -> None:
    """CONF and GEO of a camera agree with the stream; SET FOV is in RES and CONF."""
    confs = {one.get("Name"): one for one in tour.find_replies("CONF", "camera")}
    geos = {one.get("Name"): one for one in tour.find_replies("GEO", "camera")}
    for name, (fields, place) in tour.cameras.items():
        conf, geo = confs[name], geos[name]
        for key, value in fields.items():
            if key in ("Mirror", "Lens", "Picture"):
                _require(conf.get(key) == value, f"{conf}: {key} is {value} by the stream")
            if not key.startswith("Error") and re.fullmatch(r"-?[\d.]+(e-?\d+)?", value):
                is_angle = key == "HorizontalFov"
                number = math.degrees(float(value)) if is_angle else float(value)
                stated = conf.get("CameraFov" if is_angle else key)
                # An ordinary camera has no size in CONF.
                _require(
                    (stated is None and conf.get("Mirror") is None)
                    or (stated is not None and _is_close(float(stated), number, 1e-6, 1.1e-3)),
                    f"{conf}: {key} is {value} by the stream",
                )
        if conf.get("Mirror") is not None:
            location = read_numbers(geo, "Location", 3)
            _require(
                all(abs(a - b) < 0.011 for a, b in zip(location, place, strict=True)),
                f"{geo}: at {place} by the stream",
            )
    for conf in confs.values():
        fov, low, high, default = (
            read_number(conf, f"Camera{key}Fov") for key in ("", "Min", "Max", "Def")
        )
        is_right = 0.0 <= low <= fov <= high < 360.0 and low <= default <= high
        _require(is_right, f"{conf}: fields of view")
        height_m = number_of(conf, "ViewpointHeight")
        if height_m is not None and conf.get("Name") in geos:
            _, _, z = read_numbers(geos[conf.get("Name")], "Location", 3)
            size = read_numbers(tour.find_robot("GEO"), "Dimensions", 3)
            _require(0.0 <= height_m + z <= size[2], f"{conf}: ViewpointHeight, {z} m on the robot")
    later = {one.get("Name"): one for one in tour.find_replies("CONF", "camera", "camera")}
    results = tour.find_replies("RES", "camera", "camera")
    is_set = any(one.get("Mirror") is None and one.get("Lens") is None for one in later.values())
    _require(bool(results) or not is_set or tour.dialect == "udk", "SET FOV: no RES")
    for result in results:
        fov_rad = read_number(result, "FOV")
        _require(abs(fov_rad - FOV_RAD) < 2e-4, f"{result}: FOV {FOV_RAD} was set")
    for conf in later.values():
        if conf.get("Mirror") is None and conf.get("Lens") is None:
            fov_rad = math.radians(read_number(conf, "CameraFov"))
            _require(abs(fov_rad - FOV_RAD) < 2e-4, f"{conf}: FOV {FOV_RAD} was set")
            break


# --- The world ---


def check_visits(tour: Tour) -> None:
    """A robot of a start pose stands there, in the world frame; start poses are as many as said."""
    poses = start_poses(tour.messages)
    for name, lines in tour.visits:
        x, y, _, _, _, yaw = poses[name]
        truth = _truth(lines)
        if truth is not None:
            _require(
                math.hypot(truth[0] - x, truth[1] - y) < 0.05 and abs(wrap(truth[5] - yaw)) < 0.03,
                f"start pose {name} at {x}, {y}, {yaw}: the robot is at {np.round(truth, 3)}",
            )
    stated = [int(read_number(x, "StartPoses")) for x in tour.messages if x.get("StartPoses")]
    _require(all(x == len(poses) for x in stated), f"StartPoses {stated}: {len(poses)} poses")
    limits = [number_of(one, "TimeLimit") for one in tour.messages if one.get("Gametype")]
    _require(all(x is None or 0 <= x < 10_000 for x in limits), f"TimeLimit {limits}")


def check_gps(tour: Tour) -> None:
    """GPS and GroundTruth agree about the way between start poses, but for the north."""
    fixes = [_geodetic(one.message) for one in tour.lines if one.sensor_type == "gps"]
    found = [one for one in fixes if one is not None]
    truths = [
        _poses(one)["groundtruth"][:2] for one in tour.instants if "groundtruth" in _poses(one)
    ]
    if found and (np.ptp(np.array(truths), axis=0) > 0.3).all():
        for i, name in enumerate(("Latitude", "Longitude")):
            _require(len({one[i] for one in found}) > 1, f"{name} is constant in a drive")
    places = []
    for _, lines in tour.visits:
        fixes = [_geodetic(one.message) for one in lines if one.sensor_type == "gps"]
        coordinates, truth = [one for one in fixes if one is not None], _truth(lines)
        if coordinates and truth is not None:
            latitude, longitude = np.mean(coordinates, axis=0)
            places.append((complex(latitude, longitude), complex(truth[0], truth[1])))
    if len(places) < 3:
        return
    gps, truth = (np.array(one) for one in zip(*places, strict=True))
    parallel = math.cos(math.radians(gps.real.mean()))
    gps, truth = (gps - gps.mean()) * _METRES_PER_DEGREE, truth - truth.mean()
    gps = gps.real + 1j * parallel * gps.imag
    turn = np.vdot(gps, truth)
    errors = np.abs(truth - gps * turn / abs(turn))
    _require(
        bool((errors < 0.03 * np.abs(truth) + 0.8).all()),
        f"GPS and GroundTruth of start poses differ by {np.round(errors, 2)} m",
    )


def check_forms(tour: Tour) -> None:
    """Each line ends with CR LF; a blank between blocks, the fields of its kind in order."""
    pattern = _UDK_LINE if tour.dialect == "udk" else _LINE
    for line in tour.lines:
        excerpt = f"{line.data[:120]!r}...{line.data[-12:]!r}"
        _require(line.data.endswith(b"\r\n"), f"{excerpt}: expected CR LF at the end of the line")
        _require(len(line.data) <= _MAX_LINE_BYTES, f"{excerpt}: {len(line.data)} bytes")
        _require(
            pattern.fullmatch(line.text) is not None, f"{excerpt}: expected WORD {{Name Value}}"
        )
        for name, value in line.message.pairs:
            is_number = name.lower() != "name" and any(map(_EXPONENT.fullmatch, _split(value)))
            _require(not is_number, f"{excerpt}: expected decimals without exponents")
        form = find_form(line.message, tour.dialect)
        if form and not _is_empty_reply(line.message):
            _require(
                matches_form(line.text.rstrip(), form, tour.dialect),
                f"{excerpt}: expected {form}",
            )


def check_sensors(tour: Tour) -> None:
    """Each sensor that reports has CONF and GEO, and the reverse; lists have all sensors."""
    names: dict[str, list[set[str]]] = {}
    for message in tour.messages:
        if message.word == "SEN":
            type_ = (message.get("Type") or "").lower()
            names.setdefault(type_, []).append(set(find_item_names(message)))
    for type_ in LISTED_TYPES[tour.dialect]:
        lists = names.get(type_, [])
        all_names = set().union(*lists)
        is_whole = all(one == all_names for one in lists)
        _require(is_whole, f"lines of type {type_}: expected one line with {all_names}")
    for type_ in map(str.lower, PART_TYPES):
        words = {word: bool(tour.find_replies(word, type_)) for word in ("CONF", "GEO")}
        if type_ in READING_FORMS[tour.dialect]:
            words["SEN"] = type_ in names
        _require(len(set(words.values())) == 1, f"lines of type {type_}: {words}")


def _split(value: str) -> list[str]:
    return re.split("[ ,]", value)


# --- Readings ---


def _poses(instant: Instant) -> dict[str, Floats]:
    """x, y, z, roll, pitch, yaw by type; of odometry z, roll and pitch are 0."""
    poses = {}
    for type_ in ("groundtruth", "ins", "odometry"):
        for one in instant.find(type_)[:1]:
            if type_ == "odometry":
                x, y, yaw = read_numbers(one, "Pose", 3)
                poses[type_] = np.array([x, y, 0.0, 0.0, 0.0, yaw])
            else:
                numbers = *read_numbers(one, "Location", 3), *read_numbers(one, "Orientation", 3)
                poses[type_] = np.array(numbers)
    return poses


def _first_pose(poses: dict[str, Floats]) -> Floats:
    """Pose of the best sensor."""
    return next(poses[type_] for type_ in POSE_SENSORS if type_ in poses)


def _turn(track: Floats) -> float:
    """Turn of a track to the right, of any angle."""
    yaw = np.unwrap(track[:, 5])
    return float(yaw[-1] - yaw[0])


def _tracks(tour: Tour, phase: str) -> dict[str, Floats]:
    """(n, 6) poses of a phase by type, of the sensors that are in its first and last instant."""
    poses = [_poses(one) for one in tour.instants_of(phase)]
    common = set(poses[0]).intersection(*poses)
    # What drifts by centimetres shows neither delay nor direction.
    ends = [_poses(tour.instants_of("stand")[0]), _poses(tour.instants_of("second")[-1])]
    if all({"groundtruth", "ins"} <= one.keys() for one in ends):
        before, after = (one["ins"] - one["groundtruth"] for one in ends)
        if math.dist(before[:2], after[:2]) > _PLACE_M or abs(wrap(after[5] - before[5])) > 0.03:
            common -= {"ins"}
    return {type_: np.array([one[type_] for one in poses]) for type_ in sorted(common)}


def _resolution_m(tour: Tour, type_: str) -> float:
    """Unit of the last decimal of a place."""
    message = next(found for one in tour.instants for found in one.find(type_))
    text = (message.get("Location") or message.get("Pose") or "").partition(",")[0]
    return 10.0 ** -len(text.partition(".")[2])


def _mean_angle(angles: Floats) -> float:
    return math.atan2(float(np.sin(angles).sum()), float(np.cos(angles).sum()))


def _compose(pose: Floats, local: Floats) -> Floats:
    """A pose on a level robot, in the frame of the robot's pose."""
    cos, sin = math.cos(pose[5]), math.sin(pose[5])
    x, y = cos * local[0] - sin * local[1], sin * local[0] + cos * local[1]
    return np.array([pose[0] + x, pose[1] + y, pose[2] + local[2], 0, 0, pose[5] + local[5]])


def _places(tour: Tour, type_: str) -> dict[str, Floats]:
    """Pose on the robot of each part of a type, by name in lower case."""
    return {
        (one.get("Name") or "").lower(): np.array(
            [*read_numbers(one, "Location", 3), *read_numbers(one, "Orientation", 3)]
        )
        for one in tour.find_replies("GEO", type_)
        if one.get("Location") is not None
    }


def _shaft_angles(tour: Tour, instants: list[Instant]) -> dict[str, Floats]:
    """Angle of each encoder's shaft in all instants."""
    resolutions = {
        (one.get("Name") or "").lower(): read_number(one, "Resolution")
        for one in tour.find_replies("CONF", "encoder")
        if one.get("Name")
    }
    ticks = [find_ticks({"encoder": one.find("encoder")}) for one in instants]
    common = set(ticks[0]).intersection(*ticks)
    return {
        name: resolutions[name] * np.array([one[name] for one in ticks]) for name in sorted(common)
    }


def _side_angles(tour: Tour, instants: list[Instant]) -> dict[str, Floats]:
    """Angle of the wheels of a side by an encoder of its name; none if it does not say a side."""
    angles = _shaft_angles(tour, instants)
    sides = {
        side: one for name, one in angles.items() for side in ("left", "right") if side in name
    }
    return sides if len(sides) == 2 else {}


def _tachometer(instants: list[Instant]) -> dict[str, Floats]:
    """Angle of the front wheels: the right one is first."""
    positions = [
        numbers_from_commas(report.get("Pos") or "0")
        for one in instants
        for report in one.find("tachometer")[:1]
    ]
    if len(positions) != len(instants) or {len(one) for one in positions} != {4}:
        return {}
    _, left, right, _ = np.array([[a, b, c, d] for a, b, c, d in positions]).T
    return {"left": left, "right": right}


def _require_spins(instants: list[Instant], spin_rad_s: float, signs: tuple[int, int]) -> None:
    """Fail where the velocity of a tachometer is not the commanded one, or not that of Pos."""
    spins = [
        numbers_from_commas(report.get("Vel") or "0")
        for one in instants
        for report in one.find("tachometer")
    ]
    if spins and {len(one) for one in spins} == {4}:
        right, left, *_ = np.median(np.array(spins)[len(spins) // 3 : -len(spins) // 3], axis=0)
        for speed, sign in ((left, signs[0]), (right, signs[1])):
            _require(_is_close(sign * speed, spin_rad_s, _SPEED, 0.02), f"Vel {speed}: tachometer")
    positions = _tachometer(instants)
    if positions and len(spins) == len(instants):
        turns = np.abs(np.diff(positions["left"]))
        is_turning = turns > 0.3 * turns.max()
        for i in np.flatnonzero(is_turning[:-1] & is_turning[1:]) + 1:
            _require(abs(spins[i][1]) > 0.5 * spin_rad_s, f"Vel {spins[i]} while Pos changes")


def _steady_speed(instants: list[Instant], angles: Floats) -> float:
    """Median rate of change in the instants between the first and the last change."""
    times = np.array([one.time_s for one in instants])
    rates = np.diff(angles) / np.diff(times)
    moving = np.flatnonzero(np.abs(rates) > 0.1 * np.abs(rates).max() + 1e-9)[1:-1]
    return float(np.mean(rates[moving])) if moving.size else 0.0


def _delay(series: Floats, reference: Floats) -> float:
    """Intervals by which a series follows another one of the same values."""
    steps = np.diff(reference, prepend=reference[0])
    total = float((steps**2).sum())
    return float(((reference - series) * steps).sum()) / total if total > 0.0 else 0.0


def _motion_series(tour: Tour, phase: str, instants: list[Instant]) -> Iterator[tuple[str, Floats]]:
    for type_, track in _tracks(tour, phase).items():
        yaw = np.unwrap(track[:, 5])
        if phase in TURNS:
            yield f"{type_} yaw", yaw
        else:
            yield f"{type_} x", track[:, 0]
            yield f"{type_} y", track[:, 1]
    yield from _side_angles(tour, instants).items()
    for side, angles in _tachometer(instants).items():
        yield f"tachometer {side}", angles
    if phase in STRAIGHTS:
        lengths = [math.hypot(*(x[-1] - x[0])[:2]) for x in _tracks(tour, phase).values()]
        for name, ranges in _approaches(tour, instants):
            if _is_close(float(ranges[0] - ranges[-1]), statistics.median(lengths), 0.1, 0.02):
                yield name, ranges


def _approaches(tour: Tour, instants: list[Instant]) -> Iterator[tuple[str, Floats]]:
    """Ranges that shrink evenly: those straight ahead of the scan and of sonars."""
    places = _places(tour, "sonar")
    sonars = [find_sonar_ranges({"sonar": one.find("sonar")}) for one in instants]
    scans = [
        numbers_from_commas(report.get("Range") or "0")
        for one in instants
        for report in one.find("rangescanner")[:1]
    ]
    candidates = {
        f"sonar {name}": np.array([one[name] for one in sonars])
        for name in set(sonars[0]).intersection(*sonars)
        if abs(places[name][5]) < 0.3
    }
    if len(scans) == len(instants) and len({len(one) for one in scans}) == 1:
        table = np.array(scans)
        middle = table.shape[1] // 2
        candidates["scan"] = np.median(table[:, middle - 2 : middle + 3], axis=1)
    for name, one in candidates.items():
        steps = np.diff(one)
        # Another surface comes into view with a jump.
        if one[0] - one[-1] > 0.25 and np.abs(steps).max() < 0.1:
            yield name, one


def _scan_points(tour: Tour, instant: Instant) -> Floats | None:
    """(n, 2) points of a scan in the frame of the best pose."""
    scans = instant.find("rangescanner")
    if not _poses(instant) or not scans:
        return None
    pose = _first_pose(_poses(instant))
    name = (scans[0].get("Name") or "").lower()
    conf = next(iter(tour.find_replies("CONF", "rangescanner")))
    ranges = np.array(numbers_from_commas(scans[0].get("Range") or ""))
    scanner = _compose(pose, _places(tour, "rangescanner")[name])
    fov = read_number(scans[0], "FOV")
    angles = scanner[5] + np.linspace(0.5 * fov, -0.5 * fov, len(ranges))
    echo = ranges < 0.98 * read_number(conf, "MaxRange")
    # Between two beams of one surface it goes on: a cone may lie between them.
    points = scanner[:2] + ranges[:, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    result: Floats = points[echo]
    return result


def _require_limits(conf: Message, ranges_m: list[float]) -> None:
    """Fail where ranges exceed the limits of CONF, or where those without an echo are no limit."""
    low, high = read_number(conf, "MinRange"), read_number(conf, "MaxRange")
    if not ranges_m:
        return
    largest = max(ranges_m)
    _require(0.0 <= low < high, f"{conf}: MinRange and MaxRange")
    _require(
        min(ranges_m) >= low - 0.1 and largest <= high + 0.1,
        f"{conf}: ranges from {min(ranges_m)} to {largest}",
    )
    if sum(one == largest for one in ranges_m) > 5:
        _require(abs(largest - high) < 0.02, f"{conf}: {largest} m without an echo")


# Least and most of a number in CONF, where nothing measures it.
_PLAUSIBLE = {
    "Resolution": (1e-5, 0.2),
    "EncoderResolution": (0.0, 0.2),
    "BeamAngle": (0.01, math.pi),
    "maxAngleOfIncidence": (0.0, math.pi / 2.0),
    "tracesPerCone": (1.0, 64.0),
    "numberOfCones": (1.0, 64.0),
    "Diameter": (0.0005, 0.09),
    "Fov": (0.01, math.tau),
    "MaxTorque": (0.01, 1e4),
    "ScanInterval": (0.001, 5.0),
}


def _require_plausible(part: Message) -> None:
    for name, (least, most) in _PLAUSIBLE.items():
        # That of the robot itself: check_robot.
        is_robot = part.get("SteeringType") is not None
        value = None if is_robot and name == "MaxTorque" else number_of(part, name)
        _require(value is None or least <= value <= most, f"{part}: {name}")
    high = number_of(part, "MaxRange")
    # Links have angles, and without a limit their order is reversed.
    if part.get("Link") is None and high is not None:
        _require(0.05 < high < 200.0, f"{part}: MaxRange")


def _is_empty_reply(message: Message) -> bool:
    # To requests without a name.
    return message.word in ("CONF", "GEO") and [name for name, _ in message.pairs] == ["Type"]


def _geodetic(message: Message) -> tuple[float, float] | None:
    """Latitude and longitude in degrees; None without a fix."""
    fix, satellites = read_number(message, "Fix"), read_number(message, "Satellites")
    _require(fix in (0.0, 1.0) and 0.0 <= satellites <= 64.0, f"{message}: Fix, Satellites")
    if not fix:
        return None
    _require(satellites >= 3.0, f"{message}: a fix needs satellites")
    angles = []
    for name, sides, most in (("Latitude", "NS", 90.0), ("Longitude", "EW", 180.0)):
        found = re.fullmatch(rf"(\d+),(\d+\.\d+),([{sides}])", message.get(name) or "")
        _require(found is not None, f"{message}: {name}")
        assert found is not None, "required above"
        angle = int(found[1]) + float(found[2]) / 60.0
        _require(angle <= most and float(found[2]) < 60.0, f"{message}: {name}")
        angles.append(-angle if found[3] == sides[1] else angle)
    return angles[0], angles[1]


def _truth(lines: tuple[ReceivedLine, ...]) -> Floats | None:
    """Pose of the first report of GroundTruth."""
    for one in (line.message for line in lines if line.sensor_type == "groundtruth"):
        numbers = *read_numbers(one, "Location", 3), *read_numbers(one, "Orientation", 3)
        return np.array(numbers)
    return None


LINE_CHECKS: dict[str, Callable[[Tour], None]] = {
    "forms": check_forms,
    "sensors": check_sensors,
    "parts": check_parts,
}
TOUR_CHECKS: dict[str, Callable[[Tour], None]] = {
    **LINE_CHECKS,
    "times": check_times,
    "intervals": check_intervals,
    "status": check_status,
    "joints": check_joints,
    "senses": check_senses,
    "headings": check_headings,
    "world_poses": check_world_poses,
    "wheels": check_wheels,
    "progress": check_progress,
    "odometry_origin": check_odometry_origin,
    "scan": check_scan,
    "scan_order": check_scan_order,
    "sonars": check_sonars,
    "victims": check_victims,
    "robot": check_robot,
    "cameras": check_cameras,
}
VISIT_CHECKS: dict[str, Callable[[Tour], None]] = {"visits": check_visits, "gps": check_gps}


def find_contradiction(tour: Tour, checks: Mapping[str, Callable[[Tour], None]]) -> str:
    """Name and reason of the first check that fails; empty if none does."""
    for name, check in checks.items():
        try:
            check(tour)
        except CheckFailed as failure:
            return f"{name}: {failure}"
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            return f"{name}: a reply that cannot be read: {type(error).__name__}: {error}"
    return ""


@retry_once
def check_lines(server: ServerUnderTest) -> None:
    """Each line has its form; each sensor reports, and has CONF and GEO."""
    reason = find_contradiction(record_standing(server), LINE_CHECKS)
    _require(not reason, reason)


@retry_once
def check_tour(server: ServerUnderTest) -> None:
    """Standing, turning, driving, commanded: all numbers of reports, CONF and GEO agree."""
    reason = find_contradiction(record_tour(server), TOUR_CHECKS)
    _require(not reason, reason)


@retry_once
def check_start_pose_visits(server: ServerUnderTest) -> None:
    """Robots stand at the start poses that are named, and GPS measures the way between them."""
    reason = find_contradiction(record_visits(record_standing(server)), VISIT_CHECKS)
    _require(not reason, reason)


TOUR_ROWS = (
    check_from_function("lines", "control", check_lines),
    check_from_function("tour", "control", check_tour),
    replace(
        check_from_function("start_pose_visits", "control", check_start_pose_visits),
        needs_empty_world=True,
    ),
)
