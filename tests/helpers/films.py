"""Films made by hand: a robot at the origin that looks along x, and what the stream says."""

from __future__ import annotations

import math

import numpy as np

from catoptra_client.experiment.degraded.film import Film, Shot
from catoptra_client.experiment.recording import Recording, Step
from catoptra_client.experiment.route import Waypoint
from catoptra_client.landmarks import Detection
from catoptra_client.localization import OdometryPose
from catoptra_client.stream_landmarks import SeenLandmark
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera import camera_with_rim_inscribed
from catoptra_protocol.optics.mirrors import HyperbolicMirror

NEAR = Landmark("near", "beacon", 1.0, 0.0, 0.1, 0.1, 0.2, 0.4, "cyan", "magenta")
ASIDE = Landmark("aside", "beacon", 0.0, 2.0, 0.1, 0.1, 0.2, 0.4, "magenta", "cyan")
FAR = Landmark("far", "beacon", -3.0, 0.0, 0.1, 0.1, 0.2, 0.4, "yellow", "cyan")
FIELD = (NEAR, ASIDE, FAR)
CAMERA = camera_with_rim_inscribed(
    HyperbolicMirror(11.546, 0.2321), width_px=40, height_px=40, rim_rad=math.radians(120.0)
)
_STILL = Step(Waypoint(0.0, 0.0, 0.0), OdometryPose(0.0, 0.0, 0.0), ())


def shot(*visible: Landmark) -> Shot:
    """Return a black frame in which these landmarks, and no others, are visible."""
    seen = (SeenLandmark(m, (m.x_m, m.y_m), m in visible, 0.0) for m in FIELD)
    return Shot(np.zeros((40, 40, 3), np.uint8), tuple(seen))


def film(*shots: Shot) -> Film:
    """Return a drive in which the robot does not move."""
    steps = (_STILL,) * (1 + len(shots))
    return Film(Recording("still", 0, steps), tuple(shots), CAMERA, 0.6)


def sighting(name: str, range_m: float, bearing_deg: float) -> Detection:
    """Return a beacon that a detector says it has found."""
    bearing = math.radians(bearing_deg)
    return Detection(name, "beacon", range_m, bearing, np.eye(2), 9, True)
