"""Displacement by single precision: the floor under the error of every plan and every frame.

Trace and the shader of mirror meshes hold directions as float32, each component rounded to a part
in 2^24 =: 1 / u. The condition of the camera model is the image scale: a direction off by an angle
is displaced by that angle times at most `max_px_per_rad`. So all that remains is the number of u by
which a direction is off. Raster also holds coordinates in the atlas, as fractions of its width.

Coordinates of the scene are float32, too. What that displaces depends on the viewpoint and on what
is near: `bounds/coordinate_rounding` finds the angle for each frame.
"""

from __future__ import annotations

import math
from dataclasses import replace

from catoptra_protocol.optics.camera_rays import max_miss_m
from catoptra_protocol.optics.image_scale import compute_image_scale
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.bounds.coordinate_rounding import UNIT_ROUNDOFF, CoordinateErrors
from catoptra_server.planning.geometric_error import GeometricError, sum_errors
from catoptra_server.planning.texel_footprint import texel_footprint
from catoptra_server.render.render_settings import PerPixel
from catoptra_server.render.renderer import FaceRegion, RenderPlan

# Rounding errors of a handful of operations rarely all have one sign. Measured in rays: an rms of
# 0.51 u where the largest was 2.44 u.
_RMS_FRACTION_OF_MAX = 0.2

# Trace computes in float64 and rounds twice: a unit vector (at most 1 u), and its rotation into the
# world, three products and two sums of rounded factors, each at most 1 u of a component. All at
# their worst and in one direction would be 8.7 u; the largest of 40 million rays in 200 rotations
# was 2.4 u.
TRACE_ULPS = 3.0
# The shader of a mesh interpolates the direction between corners: about ten operations, all of them
# well conditioned, each at most 1 u.
SHADER_ULPS = 8.0
# An atlas coordinate is divided by the width, rounded, and multiplied again by the sampler: each at
# most 1 u of a width.
_ATLAS_ULPS = 3.0
# The rasterizer snaps corners to 256ths of a rendered pixel: half a step along both sides.
_CORNER_PX = math.sqrt(2.0) / 512.0

# Corners and viewpoint are rounded once each, relative to the scene's centre; Embree's arithmetic
# on both adds its own. Rectangles of up to 200 km with an edge 2 cm to 5 m from the viewpoint were
# displaced by 1.0 times their size over distance in the kernel, 2.5 times in the reference,
# rounding of corners included (tests/server/render/test_scene_rounding.py).
_TRACE_COORDINATES = CoordinateErrors(position_ulps=2.0, size_ulps=4.0)
# Positions have 48 bits until the viewpoint is subtracted. What is left are products of that
# difference, and the rasterizer's clipping of triangles that are larger than the view: 14 times
# their size over distance in llvmpipe.
_RASTER_COORDINATES = CoordinateErrors(position_ulps=0.0, size_ulps=32.0)


def coordinate_errors(camera: OmniCamera, plan: RenderPlan) -> CoordinateErrors:
    """Errors of the coordinates of a plan's renderer, and the miss of an approximated viewpoint."""
    if plan.renderer.uses_faces:
        return replace(_RASTER_COORDINATES, miss_m=max_miss_m(camera))
    miss_m = max_miss_m(camera) if camera.is_approximated else 0.0
    return replace(_TRACE_COORDINATES, miss_m=miss_m)


def scene_error(camera: OmniCamera, angle_rad: float) -> GeometricError:
    """Displacement by the scene's coordinates.

    Args:
        angle_rad: As of `bounds/coordinate_rounding`.
    """
    return _angle_error(camera, angle_rad)


def rounding_error(camera: OmniCamera, plan: RenderPlan) -> GeometricError:
    """Displacement by float32 directions and atlas coordinates."""
    if not plan.renderer.uses_faces:
        return _direction_error(camera, TRACE_ULPS)
    lookup = _atlas_coordinate_error(camera, plan.face_regions)
    # The exact mirror's lookup map is computed in float64 and stored: no direction is ever float32.
    if isinstance(plan.surface, PerPixel):
        return lookup
    return sum_errors((_direction_error(camera, SHADER_ULPS), lookup))


def _direction_error(camera: OmniCamera, ulps: float) -> GeometricError:
    return _angle_error(camera, ulps * UNIT_ROUNDOFF)


def _angle_error(camera: OmniCamera, angle_rad: float) -> GeometricError:
    """Displacement of directions that are off by an angle at most."""
    scale = compute_image_scale(camera)
    return GeometricError(
        max_px=angle_rad * scale.max_px_per_rad,
        rms_px=_RMS_FRACTION_OF_MAX * angle_rad * scale.rms_px_per_rad,
        max_deg=math.degrees(angle_rad),
        rms_deg=_RMS_FRACTION_OF_MAX * math.degrees(angle_rad),
    )


def _atlas_coordinate_error(camera: OmniCamera, regions: tuple[FaceRegion, ...]) -> GeometricError:
    """Displacement in the widest atlas that could be packed: all regions side by side."""
    # The packing is the renderer's and not known here; a wider atlas only makes the bound larger.
    displacement_texels = _ATLAS_ULPS * UNIT_ROUNDOFF * sum(max(r.size_texels) for r in regions)
    footprint = texel_footprint(camera, regions)
    return GeometricError(
        max_px=displacement_texels * footprint.max_px,
        rms_px=_RMS_FRACTION_OF_MAX * displacement_texels * footprint.rms_px,
        max_deg=math.degrees(displacement_texels * footprint.max_rad),
        rms_deg=_RMS_FRACTION_OF_MAX * math.degrees(displacement_texels * footprint.rms_rad),
    )


def corner_error(camera: OmniCamera, samples: int) -> GeometricError:
    """Displacement by the snapped corners of a rasterized mesh, with samples^2 a pixel."""
    max_px = _CORNER_PX / samples
    scale = compute_image_scale(camera)
    min_px_per_rad = float(min(scale.radial.min(), scale.tangential.min()))
    max_deg = math.degrees(max_px / min_px_per_rad)
    return GeometricError(
        max_px, _RMS_FRACTION_OF_MAX * max_px, max_deg, _RMS_FRACTION_OF_MAX * max_deg
    )
