"""A drive as a film: what was true, what odometry said, and every frame as it came over TCP.

Which landmarks a frame shows is asked of the stream. What detectors make of the same film can then
be compared, frame by frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from catoptra_client.experiment.recording import ROBOT_CLASS, Recording, Seen, driven
from catoptra_client.experiment.route import Waypoint
from catoptra_client.experiment.server_process import ServerAddress
from catoptra_client.experiment.setups import LONGEST_RANGE_M, Setup
from catoptra_client.images import ImageStream
from catoptra_client.landmarks import (
    ColourClassifier,
    Detection,
    Detector,
    Viewpoint,
    detect,
    make_detector,
)
from catoptra_client.landmarks.histogram import Bytes
from catoptra_client.robot import Robot
from catoptra_client.stream import StreamClient
from catoptra_client.stream_landmarks import SeenLandmark
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera import OmniCamera

# Two servers and what else the machine does may keep a frame waiting: a study is not lost by that.
_PATIENCE_S = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A (h, w, 3) frame, and what geometry says of the landmarks in it."""

    frame: Bytes
    landmarks: tuple[SeenLandmark, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Film:
    """A drive whose steps have seen nothing yet, and a shot for each step after the start."""

    drive: Recording
    shots: tuple[Shot, ...]
    camera: OmniCamera
    height_m: float


def filmed(setup: Setup, seed: int, address: ServerAddress, *, on_step: Callable[[], None]) -> Film:
    """Drive a set-up's route on a lockstep server and keep every frame."""
    if address.stream_port is None:
        raise CatoptraError("a film needs the server's stream: it says what can be seen")
    start, name, shots = setup.route[0], f"Run{seed}", list[Shot]()
    with (
        Robot.connect(address.host, address.control_port, _PATIENCE_S) as robot,
        ImageStream.connect(address.host, address.image_port, _PATIENCE_S) as images,
        StreamClient.connect(address.host, address.stream_port, _PATIENCE_S) as stream,
    ):
        robot.spawn(
            ROBOT_CLASS,
            name=name,
            location_m=(start.x_m, start.y_m, 0.0),
            rotation_rad=(0.0, 0.0, start.yaw_rad),
        )
        camera, height_m = robot.camera_and_height()

        def look(truth: Waypoint) -> tuple[Seen, ...]:
            shots.append(Shot(images.frame().rgb, stream.landmarks_seen(name)))
            return ()

        steps = driven(setup, robot, look, on_step)
    return Film(Recording(setup.name, seed, steps), tuple(shots), camera, height_m)


def detector_for(
    film: Film, classifier: ColourClassifier, landmarks: Sequence[Landmark]
) -> Detector:
    """Return the detector for a film's camera."""
    viewpoint = Viewpoint(film.height_m)
    return make_detector(film.camera, classifier, landmarks=landmarks, viewpoint=viewpoint)


def sightings(film: Film, detector: Detector) -> tuple[tuple[Detection, ...], ...]:
    """Return the beacons that a detector finds, with their range, in each shot."""
    return tuple(
        tuple(d for d in detect(detector, shot.frame) if d.kind == "beacon" and d.has_range)
        for shot in film.shots
    )


def with_sightings(film: Film, found: Sequence[Sequence[Detection]]) -> Recording:
    """Return the drive as a filter gets it: with what was measured to be near enough."""
    start, *rest = film.drive.steps
    looked = (replace(step, seen=_near(seen)) for step, seen in zip(rest, found, strict=True))
    return replace(film.drive, steps=(start, *looked))


def _near(found: Sequence[Detection]) -> tuple[Seen, ...]:
    return tuple(
        Seen(d.name, d.range_m, d.bearing_rad) for d in found if d.range_m <= LONGEST_RANGE_M
    )
