"""Circle of confusion of a lens without a mirror: the thin-lens formula by range.

A lens of focal length f and aperture f/N, focused at the depth Z_f, spreads a point at depth Z to a
disc of (f / N) f_px |1/Z - 1/Z_f| pixels, with 1/f = 1 / (f_px pitch) + 1/Z_f. The focus is a
plane: Z = D cos(theta) at the range D, and sharp points at the image's border are farther away than
on the axis. A wide-angle lens has a sphere instead: Z = D. A focus distance of 0 is infinity: the
focus whose largest disc of infinity is smallest, as behind a mirror; everything at the hyperfocal
distance, (f / N) f_px metres, or beyond has then a disc of at most 1 px.

Domain: cameras without a mirror; discs up to
MAX_DIAMETER_PX. A wider disc is drawn as one of that diameter, since tables of wider ones grow with
the fourth power; bounds count the disc itself. Source: the thin-lens equation.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects.kernels.circle_of_confusion import Aperture, CircleOfConfusion

MAX_DIAMETER_PX = 16.0
"""Widest disc that is drawn. At F/4 and 90 degrees over 640 px of 7.4 um: of a point 12 mm away."""


def thin_lens_focus_coordinate(aperture: Aperture) -> float:
    """1/Z_f of the lens's focus, 1/m; 0 at infinity."""
    return 1.0 / aperture.focus_distance_m if aperture.focus_distance_m > 0.0 else 0.0


def thin_lens_circle_of_confusion(
    aperture: Aperture, camera: RadialCamera, radius_px: Floats
) -> CircleOfConfusion:
    """Circle of confusion at image radii."""
    focus = thin_lens_focus_coordinate(aperture)
    focal_px = 1.0 / camera.inverse_focal_length
    focal_m = 1.0 / (1.0 / (focal_px * aperture.pixel_pitch_m) + focus)
    px_m = focal_m / aperture.f_number * focal_px
    ones = np.ones_like(np.asarray(radius_px, dtype=np.float64))
    inverse_cosine = ones
    if isinstance(camera, PerspectiveCamera):
        # 1 / cos(theta) turns the inverse range into the inverse depth.
        inverse_cosine = np.hypot(1.0, radius_px * camera.inverse_focal_length)
    return CircleOfConfusion(
        infinity_diameter_px=ones * (-px_m * focus),
        near_px=px_m * inverse_cosine,
        power_per_m=ones,
        offset=0.0 * ones,
    )


def describe_thin_lens(aperture: Aperture) -> str:
    """Describe the lens, for the reason of a bound."""
    distance_m = aperture.focus_distance_m
    focus = f"at {distance_m:.3g} m" if distance_m > 0.0 else "at infinity"
    return f"F/{aperture.f_number:g}, focused {focus}"
