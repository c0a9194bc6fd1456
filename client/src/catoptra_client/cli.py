"""Commands: save a `snapshot` or a `calibration`, `train` a classifier, print `bearings`."""

from __future__ import annotations

import argparse
import asyncio
import dataclasses
import math
import secrets
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import TYPE_CHECKING

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
from catoptra_protocol.calibration.calibration_folder import (
    add_calibration_options,
    write_calibration,
)
from catoptra_protocol.command_line import (
    Command,
    CommandParser,
    int_within,
    parse_count,
    parse_float_within,
    parse_integer,
    parse_port,
)
from catoptra_protocol.errors import CatoptraError, RemoteProtocolError
from catoptra_protocol.landmarks import read_landmarks
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.stream.requests import ImageEncoding

if TYPE_CHECKING:
    from catoptra_client.recording.recorder import (
        MessageSource,
        RecordingPlan,
        RecordingProgress,
    )
    from catoptra_client.recording.recording import Recording

_CLASSIFIER = Path("out/classifier.npz")
_STREAM_PORT = 5005
# A day at twelve frames a second.
_MAX_FRAMES = 1_000_000


def _save_snapshot(words: Sequence[str]) -> int:
    """Save one frame of a robot's camera, or its panorama, as an image file."""
    parser = CommandParser(
        "catoptra-client snapshot",
        "Save one frame of a robot's camera as an image file.",
    )
    add = parser.add_argument
    add("--out", metavar="FILE", help="PNG or JPEG file; needed")
    # The word of earlier releases: the file by its place alone.
    add("out", nargs="?", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    add("--robot", metavar="NAME", help="name of the robot (default: the image port's picture)")
    add("--camera", metavar="NAME", help="name of the camera (default: the robot's first one)")
    add("--spawn", metavar="CLASS", help="spawn a robot of a class for the picture")
    add("--start", metavar="TAG", help="start pose of that robot (default: the world's first one)")
    add("--panorama", action="store_true", help="the panorama instead of the camera's image")
    add("--picture", choices=[picture.value for picture in Picture],
        help="hand of the image (default: as the camera has it)")  # fmt: skip
    _add_stream_address(parser)
    parsed = parser.parse_args(words)
    if parsed.out is None:
        parser.error("--out is missing: the name of a PNG or JPEG file")
    with ExitStack() as stack:
        robot = parsed.robot
        if parsed.spawn:
            address = parsed.host, parsed.stream_port
            robot = _spawn_robot(parsed, stack.enter_context(StreamClient.connect(*address)))
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
    write_image(Path(parsed.out), image)
    height, width = image.shape[:2]
    print(f"{parsed.out}: {width} x {height} px, {frame.camera_name or 'image port'}")
    return 0


def _spawn_robot(parsed: argparse.Namespace, client: StreamClient) -> str:
    """Spawn the robot of --spawn and --start for as long as a client is connected; its name."""
    # The stream selects cameras by the robot's name, so that name is chosen here.
    name = f"client_{secrets.token_hex(4)}"
    starts = client.get_start_poses()
    start = parsed.start or (starts[0].name if starts else None)
    location_m = None if start else (0.0, 0.0, 0.0)
    moved_to = client.spawn(parsed.spawn, name=name, location_m=location_m, start_pose=start)
    if moved_to is not None:
        place = ", ".join(f"{value:.2f}" for value in moved_to)
        print(f"the start is not free: the robot stands at {place}", file=sys.stderr)
    return name


def _write_calibration(words: Sequence[str]) -> int:
    """Write a server's camera as calibration files of other programs."""
    parser = CommandParser(
        "catoptra-client calibration",
        "Write a camera of a server as calibration files of other programs.",
    )
    parser.add_argument("--camera", metavar="NAME", help="name of the camera (default: the first)")
    add_calibration_options(parser)
    _add_stream_address(parser)
    parsed = parser.parse_args(words)
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
    return 0


def _train(words: Sequence[str]) -> int:
    """Train a classifier on labelled frames from random poses on the field."""
    parser = CommandParser(
        "catoptra-client train",
        "Train the colour classifier from labelled frames.",
    )
    add = parser.add_argument
    add("--out", type=Path, default=_CLASSIFIER, metavar="FILE", help="classifier to write")
    parser.read_too("--out", "--output")
    add("--theta", type=partial(parse_float_within, name="a threshold"), default=DEFAULT_THETA,
        metavar="VALUE", help="threshold of Eq. 3")  # fmt: skip
    add("--seed", type=parse_integer, default=1, metavar="N", help="seed of the random poses")
    add("--training-frames", type=parse_count, default=30, metavar="N",
        help="frames for the classifier")  # fmt: skip
    parser.read_too("--training-frames", "--frames")
    _add_robot_options(parser)
    parsed = parser.parse_args(words)
    landmarks = read_landmarks(find_landmark_file(parsed.landmarks))
    frame_numbers = count(1)
    frames = capture_training_frames(
        _server_address(parsed),
        landmarks=landmarks,
        num_frames=parsed.training_frames,
        seed=parsed.seed,
        robot_class=parsed.robot,
        on_frame=lambda: _print_progress(next(frame_numbers), parsed.training_frames),
    )
    classifier = train(frames, theta=parsed.theta)
    parsed.out.parent.mkdir(parents=True, exist_ok=True)
    save_classifier(classifier, parsed.out)
    print(f"classifier written to {parsed.out}, threshold {parsed.theta:g}")
    return 0


def _print_progress(number: int, total: int) -> None:
    """Overwrite one line of a terminal; a log needs no progress, and stdout has results alone."""
    if sys.stderr.isatty():
        end = "\n" if number == total else ""
        print(f"\rlabelled frame {number} of {total}", end=end, file=sys.stderr, flush=True)


def _print_bearings(words: Sequence[str]) -> int:
    """Print the landmarks of every frame."""
    parser = CommandParser("catoptra-client bearings", "Print the landmarks in the robot's frames.")
    add = parser.add_argument
    add("--classifier", type=Path, default=_CLASSIFIER, metavar="FILE", help="file of `train`")
    add("--start", default="Centre", metavar="TAG", help="start pose of the robot")
    add("--frames", type=int_within("a number of frames", 0, _MAX_FRAMES), default=0, metavar="N",
        help="number of frames; 0 = until interrupted")  # fmt: skip
    add("--camera", metavar="NAME",
        help="name of the camera, over the stream (default: the image port's picture)")  # fmt: skip
    add(
        "--stream-port", type=parse_port, default=_STREAM_PORT, metavar="PORT", help="ZeroMQ stream"
    )
    _add_robot_options(parser)
    parsed = parser.parse_args(words)
    landmarks = read_landmarks(find_landmark_file(parsed.landmarks))
    classifier = load_classifier(parsed.classifier)
    address = _server_address(parsed)
    # The stream selects cameras by the robot's name, so that name is chosen here.
    name = f"bearings_{secrets.token_hex(4)}" if parsed.camera else None
    with RobotClient.connect(address.host, address.control_port) as robot:
        robot.spawn(parsed.robot, name=name, start_pose=parsed.start)
        # The server's configuration has the exact camera model: nothing to calibrate.
        try:
            camera, height_m = robot.get_camera_and_height(parsed.camera)
        except RemoteProtocolError as error:
            place = f"camera {parsed.camera!r} of {parsed.robot}" if name else "the camera"
            raise CatoptraError(f"{place} is missing or not omnidirectional: {error}") from error
        with _open_bearing_source(parsed, name) as images:
            viewpoint = _find_viewpoint(images, height_m) if name else Viewpoint(height_m)
            detector = make_detector(camera, classifier, landmarks=landmarks, viewpoint=viewpoint)
            # islice has no end for None: --frames 0 runs until interrupted.
            for frame in islice(images.iter_frames(), parsed.frames or None):
                print(f"frame {frame.sequence}")
                for detection in detect(detector, frame.rgb):
                    print("  " + _format_detection(detection))
    return 0


def _open_bearing_source(parsed: argparse.Namespace, robot: str | None) -> FrameSource:
    """Frames of the image port, or of the selected camera over the stream."""
    if robot is None:
        return ImageClient.connect(parsed.host, parsed.image_port)
    url = _stream_url(parsed)
    return open_frame_source(url, robot=robot, camera=parsed.camera, encoding=ImageEncoding.PNG)


def _record(words: Sequence[str]) -> int:
    """Record a robot as an MCAP file, or repair one."""
    parser = CommandParser(
        "catoptra-client record",
        "Record a robot as an MCAP file of ROS 2 messages, until Ctrl-C.",
    )
    add = parser.add_argument
    add("--out", metavar="FILE", help="MCAP file to write, which is not there yet")
    add("out", nargs="?", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    add("--repair", metavar="FILE", help="give the file of a killed recorder its index, and end")
    _add_message_options(parser)
    parsed = parser.parse_args(words)
    # The extra packages of recordings are loaded by its command alone.
    from catoptra_client.recording.mcap_file import repair_recording
    from catoptra_client.recording.recorder import Recorder

    if parsed.repair is not None:
        num_messages, damages = repair_recording(Path(parsed.repair))
        for reason, num_times in damages.items():
            print(f"left out ({num_times} times): {reason}", file=sys.stderr)
        print(f"{parsed.repair}: {num_messages} messages")
        return 0
    if parsed.out is None:
        parser.error("--out is missing: the name of an MCAP file")
    plan = _make_recording_plan(parser, parsed)
    recorder = Recorder(Path(parsed.out), plan, host=parsed.host, stream_port=parsed.stream_port)
    progress = _run_until_interrupt(recorder, partial(recorder.record, parsed.duration))
    print(f"{parsed.out}: {_describe_recording(progress)}")
    return 0


def _publish_topics(words: Sequence[str]) -> int:
    """Publish a robot's messages as topics of ROS 2, and drive it by /cmd_vel."""
    parser = CommandParser(
        "catoptra-client ros2",
        "Publish a robot's messages as topics of ROS 2, and drive it by /cmd_vel, until Ctrl-C; "
        "on this machine alone unless ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise.",
    )
    add = parser.add_argument
    add("--spawn", metavar="CLASS", help="spawn a robot of a class; one of others must be shared")
    add("--start", metavar="TAG", help="start pose of that robot (default: the world's first one)")
    _add_message_options(parser)
    parsed = parser.parse_args(words)
    from catoptra_client.recording.recorder import MessageSource
    from catoptra_client.recording.ros2_node import run_node

    with StreamClient.connect(parsed.host, parsed.stream_port) as driver:
        robot = _spawn_robot(parsed, driver) if parsed.spawn else parsed.robot or ""
        parsed.robot = driver.get_state(robot).robot
        if not parsed.robot:
            raise CatoptraError("there is no such robot: --robot names one, --spawn adds one")
        # In each tick: who drives by these topics does not wait for more of them.
        plan = dataclasses.replace(_make_recording_plan(parser, parsed), state_hz=50.0)
        source = MessageSource(plan, host=parsed.host, stream_port=parsed.stream_port)
        run = partial(run_node, source, driver, parsed.robot, parsed.duration)
        print(_describe_recording(_run_until_interrupt(source, run)))
    return 0


def _add_message_options(parser: CommandParser) -> None:
    """Add the options of `_make_recording_plan`, and --duration."""
    add = parser.add_argument
    add("--robot", metavar="NAME", help="name of the robot (default: the image port's picture)")
    add("--camera", metavar="NAME", help="name of the camera (default: the robot's first one)")
    add("--channels", default="", metavar="NAMES", help="of range, ids: ground truth of each pixel")
    add("--panorama", action="store_true", help="an unrolled picture, too")
    add("--views", default="", metavar="NAMES",
        help="of front, right, back, left: exact pinhole pictures, too")  # fmt: skip
    add("--duration", type=partial(parse_float_within, name="a duration", unit=" s"), metavar="S",
        help="seconds until the end (default: until Ctrl-C)")  # fmt: skip
    add("--hz", type=partial(parse_float_within, name="a rate"), default=30.0, metavar="RATE",
        help="most frames a second")  # fmt: skip
    add("--picture", choices=[picture.value for picture in Picture], default="flipped",
        help="hand of the pictures")  # fmt: skip
    _add_stream_address(parser)


def _make_recording_plan(parser: CommandParser, parsed: argparse.Namespace) -> RecordingPlan:
    from catoptra_client.recording.recorder import CHANNEL_ENCODINGS, VIEWS, RecordingPlan

    names = {}
    for option, known in (("channels", CHANNEL_ENCODINGS), ("views", VIEWS)):
        names[option] = tuple(filter(None, getattr(parsed, option).split(",")))
        if unknown := set(names[option]) - set(known):
            parser.error(f"--{option} {unknown.pop()!r}: known are {', '.join(known)}")
    if not parsed.hz > 0.0:
        parser.error("--hz must be above 0")
    return RecordingPlan(
        robot=parsed.robot or "",
        camera=parsed.camera or "",
        picture=Picture(parsed.picture),
        channels=names["channels"],
        views=(*names["views"], *(("panorama",) if parsed.panorama else ())),
        hz=parsed.hz,
    )


def _run_until_interrupt(
    source: MessageSource,
    run: Callable[[Callable[[RecordingProgress], None]], RecordingProgress],
) -> RecordingProgress:
    def show(progress: RecordingProgress) -> None:
        if sys.stderr.isatty():
            print(f"\r{_describe_recording(progress)}", end="", file=sys.stderr, flush=True)

    # An interrupt in the middle of a message would leave half of it.
    before = signal.signal(signal.SIGINT, lambda *_: source.stop())
    try:
        return run(show)
    finally:
        signal.signal(signal.SIGINT, before)


def _replay(words: Sequence[str]) -> int:
    """Describe a recording, or show it, simulate it or draw it again."""
    parser = CommandParser(
        "catoptra-client replay",
        "Say what a recording holds, serve it, simulate it again, or draw it by another camera.",
    )
    add = parser.add_argument
    add("file", metavar="FILE", help="MCAP file of catoptra-client record")
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument(
        "--serve", action="store_true", help="serve it on a server's ports until Ctrl-C"
    )
    mode.add_argument(
        "--resimulate", action="store_true", help="simulate its commands, and compare each byte"
    )
    mode.add_argument(
        "--rerender", action="store_true", help="draw it by another camera into a new file, --out"
    )
    add("--robot-file", type=Path, metavar="FILE", help="robot with the camera of --rerender")
    add("--camera", default="", metavar="NAME", help="name of that camera (default: the first)")
    add("--max-error-px", type=partial(parse_float_within, name="a tolerance", unit=" px"),
        metavar="PX", help="accuracy target of --rerender (default: the robot file's)")  # fmt: skip
    add("--out", type=Path, metavar="FILE", help="MCAP file of --rerender to write")
    add("--files", type=Path, metavar="DIR",
        help="folder of the recorded robot and world files and of what they refer to (default: "
        "the server's, where they are the same, or the recording's)")  # fmt: skip
    add("--speed", type=partial(parse_float_within, name="a speed", last=100.0),
        default=1.0, metavar="X",
        help="simulated seconds a second while it is served (default: 1)")  # fmt: skip
    add("--host", default="127.0.0.1", help="address to serve on")
    add("--control-port", type=parse_port, default=3000, metavar="PORT", help="control port")
    add("--image-port", type=parse_port, default=5003, metavar="PORT", help="image port")
    add("--stream-port", type=parse_port, default=_STREAM_PORT, metavar="PORT",
        help="ZeroMQ stream; a port 0 is any free one")  # fmt: skip
    parsed = parser.parse_args(words)
    if parsed.rerender and not (parsed.robot_file and parsed.out):
        parser.error("--rerender needs --robot-file and --out")
    if not parsed.speed > 0.0:
        parser.error("--speed must be above 0")
    # The extra packages of recordings are loaded by its commands alone.
    from catoptra_client.recording.recording import Recording

    recording = Recording(Path(parsed.file))
    if parsed.resimulate:
        return _resimulate(recording, parsed.files)
    if parsed.rerender:
        from catoptra_client.recording.rerendering import rerender

        num_frames = rerender(
            recording,
            parsed.out,
            robot_file=parsed.robot_file,
            max_error_px=parsed.max_error_px,
            camera=parsed.camera,
            files=parsed.files,
            on_progress=_show_time,
        )
        print(f"{parsed.out}: {num_frames} frames from the recorded poses")
        return 0
    if not parsed.serve:
        print(recording.describe())
        return 0
    from catoptra_client.recording.replay_server import ReplayServer

    ports = ServerAddress(parsed.host, parsed.control_port, parsed.image_port, parsed.stream_port)
    server = ReplayServer(recording, speed=parsed.speed)
    asyncio.run(server.run(ports, _print_address))
    return 0


def _resimulate(recording: Recording, files: Path | None) -> int:
    """Simulate a recording again; 1 at a difference."""
    from catoptra_client.recording.resimulation import resimulate

    found = resimulate(recording, files=files, on_progress=_show_time)
    if found.difference:
        print(f"first difference: {found.difference}")
        return 1
    print(
        f"{found.span_s:.1f} s simulated again: {found.num_states} states and "
        f"{found.num_frames} frames are the same, byte for byte"
    )
    return 0


def _show_time(time_s: float) -> None:
    if sys.stderr.isatty():
        print(f"\r{time_s:.1f} s", end="\r", file=sys.stderr, flush=True)


def _print_address(address: ServerAddress) -> None:
    """Print where a server listens, in the form of catoptra-server."""
    host = address.host
    print(
        f"listening control={host}:{address.control_port} image={host}:{address.image_port} "
        f"stream={host}:{address.stream_port}",
        flush=True,
    )


def _describe_recording(progress: RecordingProgress) -> str:
    return (
        f"{progress.elapsed_s:.1f} s, {progress.num_messages} messages, "
        f"{progress.num_dropped} dropped"
    )


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


def _add_stream_address(parser: CommandParser) -> None:
    parser.add_argument("--host", default="127.0.0.1", help="host of the server")
    parser.add_argument(
        "--stream-port", type=parse_port, default=_STREAM_PORT, metavar="PORT", help="ZeroMQ stream"
    )


def _add_robot_options(parser: CommandParser) -> None:
    """Options of a command that spawns a robot by the control port."""
    add = parser.add_argument
    add("--landmarks", default="four_legged_2006", metavar="CSV",
        help="file, or the name of a bundled one")  # fmt: skip
    add("--robot", default=ROBOT_CLASS, metavar="CLASS",
        help="class to spawn, with a mirror camera")  # fmt: skip
    parser.read_too("--robot", "--robot-class")
    add("--host", default="127.0.0.1", help="host of the server")
    add("--control-port", type=parse_port, default=3000, metavar="PORT", help="control port")
    add("--image-port", type=parse_port, default=5003, metavar="PORT", help="image port")


COMMANDS: Mapping[str, Command] = {
    "snapshot": _save_snapshot,
    "calibration": _write_calibration,
    "train": _train,
    "bearings": _print_bearings,
    "record": _record,
    "ros2": _publish_topics,
    "replay": _replay,
}
