"""The command line of the client: `train` a colour classifier, watch `bearings`.

Only this module prints.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from itertools import count, islice
from pathlib import Path

from catoptra_client.bundled_landmarks import find_landmark_file
from catoptra_client.frame_sources.image_client import ImageClient
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
from catoptra_client.server_address import ServerAddress
from catoptra_client.training_frames import ROBOT_CLASS, capture_training_frames
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import read_landmarks


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return 0, or 1 after saying what went wrong."""
    parsed = _make_parser().parse_args(arguments)
    try:
        parsed.run(parsed)
    except (CatoptraError, OSError) as error:
        print(f"catoptra-client: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    return 0


def _train(parsed: argparse.Namespace) -> None:
    """Train from labelled frames: the robot is put at random places of the field."""
    landmarks = read_landmarks(find_landmark_file(parsed.landmarks))
    numbers = count(1)
    frames = capture_training_frames(
        _server_address(parsed),
        landmarks=landmarks,
        num_frames=parsed.frames,
        seed=parsed.seed,
        on_frame=lambda: _print_progress(next(numbers), parsed.frames),
    )
    classifier = train(frames, theta=parsed.theta)
    parsed.output.parent.mkdir(parents=True, exist_ok=True)
    save_classifier(classifier, parsed.output)
    print(f"classifier written to {parsed.output}, threshold {parsed.theta:g}")


def _print_progress(number: int, total: int) -> None:
    """Overwrite one line of stderr, so that stdout holds results alone."""
    print(f"\rlabelled frame {number} of {total}", end="", file=sys.stderr, flush=True)
    if number == total:
        print(file=sys.stderr)


def _print_bearings(parsed: argparse.Namespace) -> None:
    """Print the landmarks of every frame."""
    landmarks = read_landmarks(find_landmark_file(parsed.landmarks))
    classifier = load_classifier(parsed.classifier)
    address = _server_address(parsed)
    with (
        RobotClient.connect(address.host, address.control_port) as robot,
        ImageClient.connect(address.host, address.image_port) as images,
    ):
        robot.spawn(ROBOT_CLASS, start_pose=parsed.start)
        camera, height_m = robot.get_camera_and_height()
        detector = make_detector(
            camera, classifier, landmarks=landmarks, viewpoint=Viewpoint(height_m)
        )
        for frame in islice(images.iter_frames(), parsed.frames or None):
            print(f"frame {frame.sequence}")
            for detection in detect(detector, frame.rgb):
                print("  " + _format_detection(detection))


def _format_detection(detection: Detection) -> str:
    bearing = f"{math.degrees(detection.bearing_rad):+7.2f} deg"
    range_ = f"{detection.range_m:6.3f} m" if detection.has_range else "   ?    "
    return f"{detection.name:22} {bearing}  {range_}"


def _server_address(parsed: argparse.Namespace) -> ServerAddress:
    return ServerAddress(parsed.host, parsed.control_port, parsed.image_port)


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="catoptra-client", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    trainer = commands.add_parser("train", help="train the colour classifier from labelled frames")
    trainer.set_defaults(run=_train)
    trainer.add_argument("--output", type=Path, default=Path("out/classifier.npz"))
    trainer.add_argument("--theta", type=float, default=DEFAULT_THETA, help="of Eq. 3")
    trainer.add_argument("--seed", type=int, default=1, help="of the places")
    trainer.add_argument("--frames", type=int, default=30)
    watcher = commands.add_parser("bearings", help="print the landmarks in the robot's frames")
    watcher.set_defaults(run=_print_bearings)
    watcher.add_argument("--classifier", type=Path, default=Path("out/classifier.npz"))
    watcher.add_argument("--start", default="Centre", help="start place of the robot")
    watcher.add_argument("--frames", type=int, default=0, help="0 = until interrupted")
    for command in (trainer, watcher):
        command.add_argument(
            "--landmarks", default="four_legged_2006", metavar="CSV", help="file, or a shipped one"
        )
        command.add_argument("--host", default="127.0.0.1")
        command.add_argument("--control-port", type=int, default=3000)
        command.add_argument("--image-port", type=int, default=5003)
    return parser


if __name__ == "__main__":
    sys.exit(main())
