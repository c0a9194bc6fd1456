"""The command `catoptra-studies ramps`: what the tilt of a robot does to landmarks and filters.

The arena's six beacons stand upright on a floor that is tilted about its y axis, at the same places
of the floor on every slope. A run is the paper's simulated drive: on the level floor it is steered,
on each slope the same wheel speeds follow, with the same slip. Landmarks are detected in rendered
frames. Each drive is evaluated with the robot taken for level, and with measurements and odometry
made level by roll and pitch of its INS. The INS has noise in place and heading alone, and rounds
all angles to 0.01 rad: so more noise is evaluated, too. Truth is range and bearing from above.
"""

from __future__ import annotations

import argparse
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from catoptra_client import localization
from catoptra_client.bundled_landmarks import find_landmark_file
from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.landmarks import (
    ColourClassifier,
    Detection,
    Viewpoint,
    detect,
    level_detection,
    make_detector,
)
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_client.localization.motion_model import propagate_pose
from catoptra_client.robot_client import RobotClient
from catoptra_client.training_frames import ROBOT_CLASS
from catoptra_protocol.command_line import parse_count, parse_integer
from catoptra_protocol.landmarks import Landmark, read_landmarks
from catoptra_protocol.optics.numerics import Floats, wrap_angle
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_studies import commands, plot_style
from catoptra_studies.experiment import drive_log, experiment_runner, experiment_setups, metrics
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep
from catoptra_studies.experiment.localization_filter import replay_filter
from catoptra_studies.experiment.route import Waypoint, WheelCommand
from catoptra_studies.reports import format_number, markdown_table, replace_block
from catoptra_studies.run_statistics import median_with_interval

_SLOPES_DEG, _SHOWN_SLOPE_DEG = (0, 5, 10, 15, 20, 25), 20
# By which roll and pitch of the INS are multiplied, and the noise added to them in each step.
_WAYS: Mapping[str, tuple[float, float]] = {
    "taken for level": (0.0, 0.0),
    "roll and pitch of the INS": (1.0, 0.0),
    "these with 1° of noise": (1.0, math.radians(1.0)),
}
_REACH_M = experiment_setups.MAX_RANGE_M
_FILTERS = (experiment_setups.PAPER_FILTER, experiment_setups.CONSISTENT_FILTER)
_QUANTITIES = (
    f"beacons found within {_REACH_M} m, %",
    "bearing, rms °",
    "range, rms m",
    "paper's filter, rms m",
    "consistent filter, rms m",
)
# The floor is 8 x 6 m; route and beacons lie within 2.9 m of its centre.
_HALF_LENGTH_M = 4.0
# RideHeight of the P2AT: the robot's origin above the plane of its wheels.
_ORIGIN_HEIGHT_M = 0.1457
# The INS of p2at_omni_full.ini. One ray a pixel finds 99 % of the beacons in half of the time.
_ROBOT_INI = f"""\
[Configuration]
BasedOn={experiment_setups.SIM.robot_file.removesuffix(".ini")}
[{ROBOT_CLASS}]
+Sensors=(ItemClass=class'USARBot.INSSensor',ItemName="INS",Position=(X=0),Direction=(X=0))
[USARBot.INSSensor]
Noise=0.002
[Catoptra.OmniCaptureCamera]
Samples=1
"""
_WORLD_INI = """\
[Catoptra.World]
Landmarks={name}.csv
Background=(R=182,G=202,B=222)
Lights=(Type=Hemisphere,Up=(R=200,G=200,B=200),Down=(R=150,G=150,B=145))
Lights=(Type=Directional,Direction=(X=0.35,Y=0.2,Z=0.9),Brightness=0.55)
Rectangles=(Position=(X=0,Y=0,Z={z}),Direction=(X=0,Y={slope_rad},Z=0),Size=(X=8,Y=6),\
Colour=(R=150,G=146,B=140))
"""


class _Drive(NamedTuple):
    landmarks: tuple[Landmark, ...]
    camera: OmniCamera
    viewpoint: Viewpoint
    steps: tuple[DriveStep, ...]
    """Truth and odometry."""
    detections: list[tuple[Detection, ...]]
    """Of each step; none at the start."""
    attitudes: list[tuple[float, ...]]
    """Roll and pitch of the INS."""
    frame: UInt8Array
    """The last frame."""


def main(arguments: Sequence[str]) -> int:
    """Drive on slopes, and write a table and two pictures."""
    parser = commands.make_parser(
        "ramps",
        "Drive on floors of 0 to 25 degrees, and compare bearings, ranges and filters of a robot "
        "taken for level with those that roll and pitch of its INS correct.",
    )
    commands.add_output(parser, "out/ramps", "folder for table, pictures and servers' logs")
    add = parser.add_argument
    add("--runs", type=parse_count, default=20, metavar="N", help="drives on each slope")
    add("--seed", type=parse_integer, default=0, metavar="N", help="seed of all random numbers")
    add("--quick", action="store_true", help="the first 30 steps on 0 and 20 degrees")
    add("--page", type=Path, metavar="FILE",
        help="file whose block ramps gets the table; the pictures go into its folder")  # fmt: skip
    return _run(commands.parse_study(parser, arguments))


def _run(parsed: argparse.Namespace) -> int:
    slopes_deg = (0, _SHOWN_SLOPE_DEG) if parsed.quick else _SLOPES_DEG
    (parsed.out / "robot.ini").write_text(_ROBOT_INI, encoding="utf-8")
    with commands.open_progress() as progress:
        on_drive = progress.add_task("drives", len(slopes_deg) * parsed.runs)
        drives = _drive_slopes(parsed, slopes_deg, on_drive)
    results = {slope: _evaluate(one, parsed.seed) for slope, one in drives.items()}
    text = _format_table(results, parsed.runs, parsed.seed)
    (parsed.out / "ramps.md").write_text(text + "\n", encoding="utf-8")
    _draw_errors(results, parsed.out / "ramps.png")
    _draw_horizons(drives[_SHOWN_SLOPE_DEG][-1], parsed.out / "ramps-horizon.png")
    if parsed.page:
        replace_block(parsed.page, "ramps", text)
        for name in ("ramps.png", "ramps-horizon.png"):
            shutil.copyfile(parsed.out / name, parsed.page.parent / name)
    commands.print_line(f"{text}\nwritten: {parsed.out}")
    return 0


def _floor_height_m(x_m: float, slope_rad: float) -> float:
    """Height of the floor, which rises along x from z = 0."""
    return _HALF_LENGTH_M * math.sin(slope_rad) + x_m * math.tan(slope_rad)


def _write_world(folder: Path, slope_deg: int) -> tuple[Path, tuple[Landmark, ...]]:
    """World file of a slope, and its landmarks with heights above the tilted floor."""
    slope_rad, name = math.radians(slope_deg), f"slope_{slope_deg}"
    landmarks, rows = [], [[field.name for field in fields(Landmark)]]
    for one in read_landmarks(find_landmark_file("arena")):
        landmarks.append(replace(one, x_m=one.x_m * math.cos(slope_rad)))
        # The file's heights are above z = 0: the white foot of a beacon begins below the floor.
        foot_m = _floor_height_m(landmarks[-1].x_m, slope_rad)
        band_m = {key: getattr(one, key) + foot_m for key in ("band_bottom_m", "band_top_m")}
        rows.append([str(value) for value in astuple(replace(landmarks[-1], **band_m))])
    (folder / f"{name}.csv").write_text("\n".join(map(",".join, rows)), encoding="utf-8")
    text = _WORLD_INI.format(name=name, z=-_floor_height_m(0.0, slope_rad), slope_rad=slope_rad)
    (folder / f"{name}.ini").write_text(text, encoding="utf-8")
    return (folder / f"{name}.ini").resolve(), tuple(landmarks)


def _drive_slopes(
    parsed: argparse.Namespace, slopes_deg: Sequence[int], on_drive: Callable[[], None]
) -> dict[int, list[_Drive]]:
    """Drive all runs on each slope; the first slope is level, and has the steered drives."""
    drives: dict[int, list[_Drive]] = {}
    driven: list[list[WheelCommand]] = [[] for _ in range(parsed.runs)]
    classifier: ColourClassifier | None = None
    for slope_deg in slopes_deg:
        world_file, landmarks = _write_world(parsed.out, slope_deg)
        setup = replace(
            experiment_setups.SIM,
            name=world_file.stem,
            robot_file=str(parsed.out.resolve() / "robot.ini"),
            route=experiment_setups.SIM.route[: 31 if parsed.quick else None],
        )
        config = experiment_runner.ExperimentConfig(
            config_folder=None,
            output_folder=parsed.out,
            setups=(setup,),
            num_runs=parsed.runs,
            seed=parsed.seed,
            num_training_frames=10 if parsed.quick else 30,
            server_arguments=("--renderer", "trace", "--threads", "1"),
            other_world=(world_file, landmarks),
        )
        with experiment_runner.open_server(config, setup) as address:
            # Once: the labels of training frames are those of a level robot.
            classifier = classifier or experiment_runner.train_on_server(config, address)
            for run in range(parsed.runs):
                slope_rad = math.radians(slope_deg)
                drive = _drive(config, run, address, slope_rad, classifier, driven[run])
                drives.setdefault(slope_deg, []).append(drive)
                on_drive()
    return drives


def _drive(
    config: experiment_runner.ExperimentConfig,
    run: int,
    address: ServerAddress,
    slope_rad: float,
    classifier: ColourClassifier,
    driven: list[WheelCommand],
) -> _Drive:
    """Drive one run as it was driven before; the first time steer along the route."""
    start = config.setups[0].route[0]
    with (
        RobotClient.connect(address.host, address.control_port) as robot,
        ImageClient.connect(address.host, address.image_port) as images,
    ):
        x_m = start.x_m * math.cos(slope_rad)
        robot.spawn(
            ROBOT_CLASS,
            # The server's noise follows the name.
            name=f"Run{run}",
            # From above: the robot stands on the first surface below.
            location_m=(x_m, start.y_m, -_floor_height_m(x_m, slope_rad) - 1.0),
            rotation_rad=(0.0, 0.0, start.yaw_rad),
        )
        camera, height_m = robot.get_camera_and_height()
        viewpoint = Viewpoint(height_m)
        detector = make_detector(
            camera, classifier, landmarks=config.landmarks, viewpoint=viewpoint
        )
        pitch = slope_rad if math.cos(start.yaw_rad) > 0.0 else -slope_rad
        found: list[tuple[Detection, ...]] = [()]
        attitudes: list[tuple[float, ...]] = [(0.0, pitch)]
        frames = [images.get_frame().rgb]

        def measure(truth: Waypoint) -> tuple[drive_log.LandmarkMeasurement, ...]:
            assert robot.ins is not None, "the robot file has an INS"
            # On the wire angles are 0 to 2 pi.
            attitudes.append(tuple(wrap_angle(angle) for angle in robot.ins.rotation_rad[:2]))
            frames[0] = images.get_frame().rgb
            found.append(detect(detector, frames[0]))
            return ()

        steps = drive_log.drive_route(config.setups[0], robot, measure, commands=driven)
    return _Drive(config.landmarks, camera, viewpoint, steps, found, attitudes, frames[0])


def _evaluate(drives: Sequence[_Drive], seed: int) -> Floats:
    """(ways, runs, quantities) numbers of the drives on one slope."""
    landmarks = drives[0].landmarks
    landmark_map = localization.make_landmark_map(landmarks)
    numbers = []
    for factor, sigma_rad in _WAYS.values():
        for run, drive in enumerate(drives):
            # The same noise on every slope.
            generator = np.random.Generator(np.random.Philox(key=[seed, run]))
            noise = generator.normal(size=(len(drive.steps), 2))
            attitudes = factor * np.array(drive.attitudes)
            log = DriveLog("ramps", run, _level_steps(drive, attitudes + sigma_rad * noise))
            range_m, bearing_deg = metrics.rms_errors([log], landmarks)
            found = metrics.detection_rate([log], landmarks, max_distance_m=_REACH_M)
            errors_m = (
                replay_filter(log, experiment_setups.SIM, one, landmark_map).estimate_error_m[1:]
                for one in _FILTERS
            )
            rms_m = [math.sqrt(np.square(one).mean()) for one in errors_m]
            numbers.append([100.0 * found, bearing_deg, range_m, *rms_m])
    return np.array(numbers).reshape(len(_WAYS), len(drives), len(_QUANTITIES))


def _level_steps(drive: _Drive, attitudes: Floats) -> tuple[DriveStep, ...]:
    """Steps as a level robot would log them, by (n, 2) roll and pitch; at zero as they are."""
    by_name = {one.name: one for one in drive.landmarks}
    pose, logged = np.zeros(3), []
    for number, step in enumerate(drive.steps):
        if number:
            control = localization.control_from_odometry(
                drive.steps[number - 1].odometry, step.odometry
            )
            mean_roll, mean_pitch = attitudes[number - 1 : number + 1].mean(axis=0).tolist()
            control = localization.level_control(control, roll_rad=mean_roll, pitch_rad=mean_pitch)
            pose = propagate_pose(pose, control)
        roll, pitch = attitudes[number].tolist()
        level = [
            level_detection(
                one,
                by_name[one.name],
                drive.viewpoint,
                roll_rad=roll,
                pitch_rad=pitch,
                origin_height_m=_ORIGIN_HEIGHT_M,
            )
            for one in drive.detections[number]
        ]
        odometry = localization.OdometryPose(*pose.tolist())
        logged.append(DriveStep(step.truth, odometry, drive_log.measurements_in_range(level)))
    return tuple(logged)


def _format_table(results: Mapping[int, Floats], num_runs: int, seed: int) -> str:
    rows = [
        [f"{slope}°, {way}", *(_format_cell(values) for values in numbers.T)]
        for slope, by_way in results.items()
        for way, numbers in zip(_WAYS, by_way, strict=True)
    ]
    table = markdown_table(("slope, robot", *_QUANTITIES), rows)
    return f"Seed {seed}, medians of {num_runs} runs with intervals of 95 %:\n\n{table}"


def _format_cell(values: Floats) -> str:
    median, low, high = map(format_number, median_with_interval(values))
    return median if low == "-" else f"{median} [{low}, {high}]"


def _draw_errors(results: Mapping[int, Floats], path: Path) -> None:
    colours = (plot_style.ODOMETRY, plot_style.ACCEPTED, plot_style.BLUE)
    with plot_style.open_chart(path, figsize=(plot_style.PAGE_WIDTH_IN, 4.4)) as figure:
        panels = figure.subplots(2, 2).flat
        for quantity, axes in enumerate(panels, 1):
            for way, (name, colour) in enumerate(zip(_WAYS, colours, strict=True)):
                ends = [median_with_interval(one[way, :, quantity]) for one in results.values()]
                median, low, high = np.array(ends).T
                # Thinner ones above: two of the three are nearly equal.
                axes.plot(
                    [*results],
                    median,
                    color=colour,
                    marker="o",
                    label=name,
                    ms=7 - 2 * way,
                    lw=3 - way,
                )
                axes.fill_between([*results], low, high, color=colour, alpha=0.2, lw=0)
            axes.set(title=_QUANTITIES[quantity], xlabel="slope, °", xticks=[*results])
            axes.set_ylim(bottom=0.0)
        plot_style.add_legend(figure, panels[0], loc="outside lower center", ncols=3)


def _draw_horizons(drive: _Drive, path: Path) -> None:
    """Draw a frame on a slope: the horizon, and that of a robot that is taken for level.

    Crosses are where a level robot at the same place would see the lower bands of the beacons.
    """
    side_px, (roll, pitch) = 2 * drive.frame.shape[1], drive.attitudes[-1]
    azimuth = np.linspace(0.0, math.tau, 361)
    level = np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros(361)), axis=-1)
    true = level @ rotation_from_rpy(roll, pitch, 0.0)
    with plot_style.open_page(path, side_px, side_px) as page:
        axes = plot_style.show_image(page, drive.frame, 0, 0, side_px)
        for directions, colour in ((level, plot_style.RED), (true, plot_style.BLUE)):
            pixels, valid = drive.camera.pixel_from_direction(directions)
            axes.plot(*np.where(valid[:, None], pixels, np.nan).T, color=colour)
        for one in drive.landmarks:
            range_m, bearing = metrics.true_range_bearing(drive.steps[-1], one)
            drop_m = drive.viewpoint.height_m - one.band_bottom_m - 0.05
            ray = np.array((range_m * math.cos(bearing), range_m * math.sin(bearing), drop_m))
            axes.plot(*drive.camera.pixel_from_direction(ray)[0], "+", color=plot_style.RED, ms=9)
