"""Command line: save a `snapshot` or a `calibration`, `train` a classifier, print `bearings`."""

from __future__ import annotations

import argparse
import math
import secrets
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from itertools import count, islice
from pathlib import Path

from catoptra_client.bundled_landmarks import find_landmark_file
from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame_pictures import make_panorama, write_image
from catoptra_client.frame_sources.frame_source import FrameSource, open_frame_source
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.landmarks import (
    DEFAULT_THETA,
    Detection,
    Viewpoint,
    detect,
    load_classifier,
    make_detector,
    save_classifier,
    train,
)
from catoptra_client.robot_client import RobotClient
from catoptra_client.training_frames import ROBOT_CLASS, capture_training_frames
from catoptra_protocol.calibration.calibration_folder import write_calibration
from catoptra_protocol.calibration.exports import DEFAULT_MAX_RESIDUAL_PX
from catoptra_protocol.errors import CatoptraError, RemoteProtocolError
from catoptra_protocol.landmarks import read_landmarks
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.stream.requests import ImageEncoding


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; 0 on success, 1 after an error message on stderr."""
    parsed = _make_parser().parse_args(arguments)
    try:
        parsed.run(parsed)
    # Expected failures only; a programming error keeps its traceback.
    except (CatoptraError, OSError) as error:
        print(f"catoptra-client: {error}", file=sys.stderr)
        return 1
    return 0


def _save_snapshot(parsed: argparse.Namespace) -> None:
    """Save one frame of a robot's camera, or its panorama, as an image file."""
    with ExitStack() as stack:
        robot = _spawn_for_snapshot(parsed, stack) if parsed.spawn else parsed.robot
        source = open_frame_source(
            _stream_url(parsed),
            robot=robot,
            camera=parsed.camera,
            encoding=ImageEncoding.PNG,
            picture=Picture(parsed.picture) if parsed.picture else None,
        )
        frame = stack.enter_context(source).get_frame()
    if frame.camera is None and not frame.rgb.any():
        raise CatoptraError(
            "nothing to save: no robot with a camera has been spawned; --spawn CLASS spawns one"
        )
    image = make_panorama(frame) if parsed.panorama else frame.rgb
    write_image(parsed.output, image)
    height, width = image.shape[:2]
    print(f"{parsed.output}: {width} x {height} px, {frame.camera_name or 'image port'}")


def _spawn_for_snapshot(parsed: argparse.Namespace, stack: ExitStack) -> str:
    """Spawn a robot for as long as a stack is open; its name."""
    client = stack.enter_context(StreamClient.connect(parsed.host, parsed.stream_port))
    # The stream selects cameras by the robot's name, so that name is chosen here.
    name = f"snapshot_{secrets.token_hex(4)}"
    starts = client.get_start_poses()
    start = parsed.start or (starts[0].name if starts else None)
    location_m = None if start else (0.0, 0.0, 0.0)
    moved_to = client.spawn(parsed.spawn, name=name, location_m=location_m, start_pose=start)
    if moved_to is not None:
        x, y, _ = moved_to
        print(f"the start is not free: the robot stands at {x:.2f}, {y:.2f}", file=sys.stderr)
    return name


def _write_calibration(parsed: argparse.Namespace) -> None:
    """Write a server's camera as calibration files of other programs."""
    with StreamClient.connect(parsed.host, parsed.stream_port) as client:
        name, camera, robot_from_mirror = client.get_mounted_camera(parsed.camera or "")
    if not isinstance(camera, OmniCamera):
        raise CatoptraError(f"{name} is no omnidirectional camera: --camera names another one")
    lines = write_calibration(
        camera,
        parsed.out,
        name=name,
        picture=Picture(parsed.picture),
        max_residual_px=parsed.max_residual_px,
        robot_from_mirror=robot_from_mirror.rotation,
    )
    print("\n".join(lines))


def _train(parsed: argparse.Namespace) -> None:
    """Train a classifier on labelled frames from random poses on the field."""
    landmarks = read_landmarks(find_landmark_file(parsed.landmarks))
    frame_numbers = count(1)
    frames = capture_training_frames(
        _server_address(parsed),
        landmarks=landmarks,
        num_frames=parsed.frames,
        seed=parsed.seed,
        robot_class=parsed.robot_class,
        on_frame=lambda: _print_progress(next(frame_numbers), parsed.frames),
    )
    classifier = train(frames, theta=parsed.theta)
    parsed.output.parent.mkdir(parents=True, exist_ok=True)
    save_classifier(classifier, parsed.output)
    print(f"classifier written to {parsed.output}, threshold {parsed.theta:g}")


def _print_progress(number: int, total: int) -> None:
    """Overwrite one line of stderr; stdout carries results alone."""
    print(f"\rlabelled frame {number} of {total}", end="", file=sys.stderr, flush=True)
    if number == total:
        print(file=sys.stderr)


def _print_bearings(parsed: argparse.Namespace) -> None:
    """Print the landmarks of every frame."""
    landmarks = read_landmarks(find_landmark_file(parsed.landmarks))
    classifier = load_classifier(parsed.classifier)
    address = _server_address(parsed)
    # The stream selects cameras by the robot's name, so that name is chosen here.
    name = f"bearings_{secrets.token_hex(4)}" if parsed.camera else None
    with RobotClient.connect(address.host, address.control_port) as robot:
        robot.spawn(parsed.robot_class, name=name, start_pose=parsed.start)
        # The server's configuration has the exact camera model: nothing to calibrate.
        try:
            camera, height_m = robot.get_camera_and_height(parsed.camera)
        except RemoteProtocolError as error:
            place = f"camera {parsed.camera!r} of {parsed.robot_class}" if name else "the camera"
            raise CatoptraError(f"{place} is missing or not omnidirectional: {error}") from error
        with _open_bearing_source(parsed, name) as images:
            viewpoint = _find_viewpoint(images, height_m) if name else Viewpoint(height_m)
            detector = make_detector(camera, classifier, landmarks=landmarks, viewpoint=viewpoint)
            # islice has no end for None: --frames 0 runs until interrupted.
            for frame in islice(images.iter_frames(), parsed.frames or None):
                print(f"frame {frame.sequence}")
                for detection in detect(detector, frame.rgb):
                    print("  " + _format_detection(detection))


def _open_bearing_source(parsed: argparse.Namespace, robot: str | None) -> FrameSource:
    """Frames of the image port, or of the selected camera over the stream."""
    if robot is None:
        return ImageClient.connect(parsed.host, parsed.image_port)
    url = _stream_url(parsed)
    return open_frame_source(url, robot=robot, camera=parsed.camera, encoding=ImageEncoding.PNG)


def _stream_url(parsed: argparse.Namespace) -> str:
    # An IPv6 address has colons of its own.
    host = f"[{parsed.host}]" if ":" in parsed.host else parsed.host
    return f"zmq://{host}:{parsed.stream_port}"


def _find_viewpoint(images: FrameSource, height_m: float) -> Viewpoint:
    """Viewpoint of the selected camera, as a frame states its mount."""
    mount = images.get_frame().robot_from_mirror
    if mount is None:
        return Viewpoint(height_m)
    # The robot's origin is as high as makes this the viewpoint's height; z points down.
    return Viewpoint.from_mount(mount, floor_from_robot_m=height_m + float(mount.translation[2]))


def _format_detection(detection: Detection) -> str:
    bearing = f"{math.degrees(detection.bearing_rad):+7.2f} deg"
    # Goals and landmarks near the horizon have a bearing alone.
    range_ = f"{detection.range_m:6.3f} m" if detection.has_range else "   ?    "
    return f"{detection.name:22} {bearing}  {range_}"


def _server_address(parsed: argparse.Namespace) -> ServerAddress:
    return ServerAddress(parsed.host, parsed.control_port, parsed.image_port)


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="catoptra-client", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    pictures = [picture.value for picture in Picture]
    snapshot = commands.add_parser(
        "snapshot", help="save one frame of a robot's camera as an image file"
    )
    snapshot.set_defaults(run=_save_snapshot)
    add = snapshot.add_argument
    add("output", type=Path, metavar="OUT.png", help="PNG or JPEG file")
    add("--robot", help="name of the robot; the image port's picture")
    add("--camera", help="name of the camera; the robot's first one")
    add("--spawn", metavar="CLASS", help="spawn a robot of a class for the picture")
    add("--start", metavar="TAG", help="start pose of that robot; the world's first one")
    add("--panorama", action="store_true", help="the panorama instead of the camera's image")
    add("--picture", choices=pictures, help="hand of the image; as the camera has it")
    calibration = commands.add_parser(
        "calibration", help="write a camera as calibration files of other programs"
    )
    calibration.set_defaults(run=_write_calibration)
    add = calibration.add_argument
    add("--camera", help="name of the camera; the first one")
    add("--out", type=Path, required=True, metavar="DIR")
    hand = "hand of the pictures that the files describe"
    add("--picture", choices=pictures, default=Picture.FLIPPED.value, help=hand)
    add("--max-residual-px", type=float, default=DEFAULT_MAX_RESIDUAL_PX, metavar="PX")
    for command in (snapshot, calibration):
        command.add_argument("--host", default="127.0.0.1")
        command.add_argument("--stream-port", type=int, default=5005)
    training = commands.add_parser("train", help="train the colour classifier from labelled frames")
    training.set_defaults(run=_train)
    add = training.add_argument
    add("--output", type=Path, default=Path("out/classifier.npz"))
    add("--theta", type=float, default=DEFAULT_THETA, help="threshold of Eq. 3")
    add("--seed", type=int, default=1, help="of the random poses")
    add("--frames", type=int, default=30)
    bearings = commands.add_parser("bearings", help="print the landmarks in the robot's frames")
    bearings.set_defaults(run=_print_bearings)
    add = bearings.add_argument
    add("--classifier", type=Path, default=Path("out/classifier.npz"))
    add("--start", default="Centre", help="start pose of the robot")
    add("--frames", type=int, default=0, help="0 = until interrupted")
    add("--camera", help="name of the camera, over the stream; the image port's picture")
    add("--stream-port", type=int, default=5005)
    # On each subcommand rather than the parent, so that options may follow the command.
    for command in (training, bearings):
        command.add_argument(
            "--landmarks",
            default="four_legged_2006",
            metavar="CSV",
            help="file, or the name of a bundled one",
        )
        command.add_argument(
            "--robot-class",
            default=ROBOT_CLASS,
            metavar="CLASS",
            help="class to spawn, with a mirror camera (default: %(default)s)",
        )
        command.add_argument("--host", default="127.0.0.1")
        command.add_argument("--control-port", type=int, default=3000)
        command.add_argument("--image-port", type=int, default=5003)
    return parser
