"""What single precision leaves of the law: the floor under every plan.

Trace and the shader of polygons hold directions as float32, each component rounded to a part in
2^24 =: 1 / u. The law's own condition is the image scale: a direction that is off by an angle is
shown off by that angle times at most `max_px_per_rad`. So what is left to know is how many u a
direction is off. Raster also holds places in the atlas, in parts of its width.
"""

from __future__ import annotations

import math

from catoptra_protocol.optics.image_scale import compute_image_scale
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.face_regions import FaceRegion
from catoptra_server.planning.geometric_error import GeometricError, sum_errors
from catoptra_server.planning.texel_footprint import texel_footprint
from catoptra_server.render.render_plan import PerPixel, RendererKind, RenderPlan

_UNIT_ROUNDOFF = 2.0**-24
# Of the largest: rounding errors of a handful of operations rarely agree. Seen in rays: 0.51 u of
# 2.44 u.
_RMS_FRACTION_OF_MAX = 0.2

# Trace computes in float64 and rounds twice: a unit vector (at most 1 u) and its turn into the
# world, three products and two sums of rounded factors, each at most 1 u of a component. All of
# them at their worst and in one direction would be 8.7 u; the worst of 40 million rays in 200 turns
# was 2.4 u.
TRACE_ULPS = 3.0
# A polygon's shader interpolates the direction between corners: about ten operations, all of them
# relatively exact, each at most 1 u.
SHADER_ULPS = 8.0
# A place in the atlas, as a part of its width, is divided by the width, rounded and multiplied
# again by the sampler: each at most 1 u of a width.
_ATLAS_ULPS = 3.0
# Corners of polygons stand on 256ths of the drawn picture's pixels: half a step along both sides.
_CORNER_PX = math.sqrt(2.0) / 512.0


def rounding_error(camera: OmniCamera, plan: RenderPlan) -> GeometricError:
    """Return the displacement by float32 directions and places."""
    if plan.renderer is RendererKind.TRACE:
        return _direction_error(camera, TRACE_ULPS)
    places = _atlas_coordinate_error(camera, plan.face_regions)
    if isinstance(plan.surface, PerPixel):
        return places
    return sum_errors((_direction_error(camera, SHADER_ULPS), places))


def _direction_error(camera: OmniCamera, ulps: float) -> GeometricError:
    scale = compute_image_scale(camera)
    angle_rad = ulps * _UNIT_ROUNDOFF
    return GeometricError(
        max_px=angle_rad * scale.max_px_per_rad,
        rms_px=_RMS_FRACTION_OF_MAX * angle_rad * scale.rms_px_per_rad,
        max_deg=math.degrees(angle_rad),
        rms_deg=_RMS_FRACTION_OF_MAX * math.degrees(angle_rad),
    )


def _atlas_coordinate_error(camera: OmniCamera, regions: tuple[FaceRegion, ...]) -> GeometricError:
    """Return the displacement in an atlas that is as wide as it can be: all parts side by side."""
    moved = _ATLAS_ULPS * _UNIT_ROUNDOFF * sum(max(part.size_texels) for part in regions)
    texels = texel_footprint(camera, regions)
    return GeometricError(
        max_px=moved * texels.max_px,
        rms_px=_RMS_FRACTION_OF_MAX * moved * texels.rms_px,
        max_deg=math.degrees(moved * texels.max_rad),
        rms_deg=_RMS_FRACTION_OF_MAX * math.degrees(moved * texels.rms_rad),
    )


def corner_error(camera: OmniCamera, samples: int) -> GeometricError:
    """Return the displacement by the corners of drawn polygons, with samples^2 a pixel."""
    max_px = _CORNER_PX / samples
    scale = compute_image_scale(camera)
    least_px_per_rad = float(min(scale.radial.min(), scale.tangential.min()))
    max_deg = math.degrees(max_px / least_px_per_rad)
    return GeometricError(
        max_px, _RMS_FRACTION_OF_MAX * max_px, max_deg, _RMS_FRACTION_OF_MAX * max_deg
    )
