"""Hard cases of ranges from angles: the horizon from both sides, straight down, tiny heights."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from catoptra_client.landmarks import candidates
from catoptra_client.landmarks.blobs import Viewpoint
from catoptra_client.landmarks.detector import DEFAULT_CYLINDER
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from stability.catalogue import Invalid, Subject
from stability.references.ranging import HORIZON_PX, K

CAMERA = OmniCamera(
    HyperbolicMirror(k=K, c_m=0.2321), 360, 360, (180.0, 180.0), HORIZON_PX, math.radians(120.0)
)


def _valid(answer: tuple[float, bool]) -> float:
    value, valid = answer
    if not valid:
        raise Invalid
    return value


def _sigma(name: str, range_: float, drop: float, sigma: float) -> Any:
    view = candidates.CylinderView(CAMERA, DEFAULT_CYLINDER, Viewpoint())
    down, azimuth, _, valid = view.angle_sigmas(0.3, range_m=range_, drop_m=drop, sigma_px=sigma)
    if name == "range_sigma":
        place = {"drop_m": drop, "range_m": range_, "sigma_rad": down}
        along, has_range = candidates.range_sigma_from_angle(**place)
        return _valid((along, has_range and valid))
    return _valid((azimuth if name == "azimuth_sigma" else down, valid))


SUBJECTS: dict[str, Subject] = {
    "range_from_half_angle": lambda t, drop: _valid(
        candidates.range_from_half_angle(t, drop_m=drop)
    ),
    **{n: partial(_sigma, n) for n in ("incidence_angle_sigma", "range_sigma", "azimuth_sigma")},
}
