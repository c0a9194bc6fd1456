"""Hard cases of the detector: a beacon whose lower band nears the horizon from either side."""

from __future__ import annotations

import math
from functools import cache

from catoptra_client.landmarks import detector
from catoptra_client.landmarks.blobs import Blob, Viewpoint
from catoptra_client.landmarks.candidates import Candidate, CylinderView
from catoptra_client.unwarp import CylinderGeometry
from catoptra_protocol.landmarks import Landmark
from client.landmarks.ideal_blobs import make_blob
from stability.catalogue import Invalid, Subject
from stability.subjects.ranging import CAMERA

BEACON = Landmark("b", "beacon", 0.0, 0.0, 0.1, 0.1, 0.2, 0.4, "cyan", "magenta")
# The middle of the lower band.
BAND_M = 0.25


@cache
def _cylinder() -> CylinderGeometry:
    # Its rows reach the horizon exactly: slope 0 is row 64.
    return CylinderGeometry(columns=720, rows=192, top_slope=-0.5, bottom_slope=1.0)


def _bands(range_m: float, drop_m: float) -> tuple[Blob, Blob]:
    place = {"range_m": range_m, "width_m": 0.1, "viewpoint_height_m": BAND_M + drop_m}
    lower = make_blob(_cylinder(), "cyan", heights_m=(0.2, 0.3), **place)
    return lower, make_blob(_cylinder(), "magenta", heights_m=(0.3, 0.4), **place)


def _find_candidate(range_m: float, drop_m: float) -> Candidate:
    view = CylinderView(CAMERA, _cylinder(), Viewpoint(BAND_M + drop_m))
    found = detector.find_beacon_candidates(view, BEACON, _bands(range_m, drop_m))
    if not found:
        raise Invalid("no beacon")
    (candidate,) = found
    numbers = candidate.measurement
    assert all(
        map(
            math.isfinite,
            (
                numbers.range_m,
                numbers.azimuth_rad,
                numbers.range_sigma_m,
                numbers.azimuth_sigma_rad,
            ),
        )
    )
    return candidate


SUBJECTS: dict[str, Subject] = {
    "has_range": lambda range_, drop: _find_candidate(range_, drop).has_range
}
