"""Landmark measurements of one step: from detections in a frame, or by hand with their noise.

The real set-up of the paper measured by hand in recorded frames. Here these measurements are the
truth with noise, since the robot is simulated.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks import Detection
from catoptra_client.landmarks.candidates import range_from_half_angle
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M, ExperimentSetup
from catoptra_studies.experiment.route import Waypoint


@dataclass(frozen=True, slots=True)
class LandmarkMeasurement:
    """Measurement of one landmark in one step."""

    name: str
    range_m: float

    bearing_rad: float
    """Clockwise from the robot's forward direction."""


# Measure landmarks after a step, from the true pose.
MeasurementFunction = Callable[[Waypoint], tuple[LandmarkMeasurement, ...]]


def measurements_in_range(detections: Sequence[Detection]) -> tuple[LandmarkMeasurement, ...]:
    """Measurements for a filter: detections with a range, of near landmarks."""
    return tuple(
        LandmarkMeasurement(detection.name, detection.range_m, detection.bearing_rad)
        for detection in detections
        if detection.has_range and detection.range_m <= MAX_RANGE_M
    )


def manual_noise_sources(
    seed: int, robot_name: str, landmarks: Iterable[Landmark]
) -> dict[str, np.random.Generator]:
    """Independent random numbers for the measurements of each landmark, by its name.

    Args:
        seed: Seed of the experiment.
        robot_name: Name of the robot, which numbers the run.
        landmarks: Landmarks that are measured.
    """
    return {
        landmark.name: _named_generator(str(seed), robot_name, landmark.name)
        for landmark in landmarks
    }


def _named_generator(*names: str) -> np.random.Generator:
    """Philox keyed by names, as the server keys the noise of robots."""
    # SHA-256 and not hash(), which Python salts in each process. NUL separates: no name has it.
    digest = hashlib.sha256("\0".join(names).encode()).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest[:16], "little")))


def manual_measurement(
    setup: ExperimentSetup,
    camera: OmniCamera,
    height_m: float,
    landmarks: tuple[Landmark, ...],
    noise: Mapping[str, np.random.Generator],
) -> MeasurementFunction:
    """Measurement of the true landmarks with noise, as by hand in recorded frames.

    Args:
        setup: Noise of the measurements.
        camera: Camera in whose image the noise applies.
        height_m: Height of the viewpoint above the floor.
        landmarks: Landmarks of the field.
        noise: Source of the noise of each landmark, by its name.
    """

    def measure(truth: Waypoint) -> tuple[LandmarkMeasurement, ...]:
        measurements = (
            _measure_manually(setup, camera, height_m, truth, landmark, noise[landmark.name])
            for landmark in landmarks
        )
        return tuple(m for m in measurements if m is not None)

    return measure


def _measure_manually(
    setup: ExperimentSetup,
    camera: OmniCamera,
    height_m: float,
    truth: Waypoint,
    landmark: Landmark,
    generator: np.random.Generator,
) -> LandmarkMeasurement | None:
    """Measure a landmark's foot with noise on image radius and bearing.

    None where the landmark is too far, or where the noise leaves no range.
    """
    # Drawn in every step, in range or not: the noise of a step is then that of its number.
    radial, angular = generator.standard_normal(2)
    # The foot on the floor: its distance follows from the image radius alone.
    dx, dy = landmark.x_m - truth.x_m, landmark.y_m - truth.y_m
    range_m = math.hypot(dx, dy)
    if range_m > MAX_RANGE_M:
        return None
    ratio = _floor_radius_ratio(camera, range_m, height_m)
    ratio += float(radial) * setup.manual_sigma_px / camera.scale_px
    bearing_rad = wrap_angle(math.atan2(dy, dx) - truth.yaw_rad)
    bearing_rad = wrap_angle(bearing_rad + float(angular) * setup.manual_sigma_rad)
    # Noise may push a near foot across the image's centre, where no radius is.
    if ratio < 0.0:
        return None
    t = float(camera.projection.t_from_radius_ratio(np.array(ratio)))
    measured_m, is_below_horizon = range_from_half_angle(t, drop_m=height_m)
    if not is_below_horizon:
        return None
    return LandmarkMeasurement(landmark.name, measured_m, bearing_rad)


def _floor_radius_ratio(camera: OmniCamera, range_m: float, height_m: float) -> float:
    """r_i / h of a point on the floor, by the camera model where the paper has Eq. 2."""
    # tan(theta/2) = sin / (1 + cos), with sin = range / distance and cos = height / distance.
    t = np.array(range_m / (math.hypot(range_m, height_m) + height_m))
    return float(camera.projection.radius_ratio_from_t(t))
