"""Displacement by the texels of the cube's faces.

A texel holds the mean of its samples, and the image holds a bilinear mix of four texels. A straight
edge appears where that interpolation passes one half.

With one sample a texel the edge is displaced by at most half a texel, in any direction. Let L be
the signed distance from the edge at the texel centres, and w the bilinear weights at a point with
L(point) = sum w L and half of the weight on centres with L > 0. The largest such L(point) within a
square of centres is 1/2, for an edge along the texels. Texels need not be square for that: the
bound is in their own unit. With more samples a texel holds steps of its coverage, and the
displacement depends on the sample pattern.

An object smaller than a texel may be missed altogether, and corners are rounded off (the tip of a
right angle by 0.7 texels). That displaces nothing of the remainder and is not counted: the bound is
for edges with a radius of curvature of at least two texels, so for objects from four texels on.
"""

from __future__ import annotations

import math

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.geometric_error import GeometricError
from catoptra_server.planning.texel_footprint import texel_footprint
from catoptra_server.render.renderer import FaceRegion

# Largest displacement in texels by samples a texel. 1: one half, and 1 / (8 * 2) by which an arc of
# radius two departs from a chord of one texel. More: the worst of arcs from radius two to straight,
# in the standard sample patterns of drivers, and a twentieth in reserve; searched in
# tests/server/planning/test_face_lookup_error.py.
MAX_EDGE_DISPLACEMENT_TEXELS = {1: 0.5 + 1.0 / 16.0, 2: 0.50, 4: 0.38, 8: 0.32, 16: 0.29}
# Hardware holds triangle corners and texture coordinates in 256ths, rounded by half a step along
# both sides: twice sqrt(2) / 512.
_FIXED_POINT_TEXELS = math.sqrt(2.0) / 256.0


def max_edge_displacement_texels(face_samples: int) -> float:
    """Largest displacement of an edge by texels; drivers take at least the requested samples."""
    tabulated = max(samples for samples in MAX_EDGE_DISPLACEMENT_TEXELS if samples <= face_samples)
    return MAX_EDGE_DISPLACEMENT_TEXELS[tabulated] + _FIXED_POINT_TEXELS


def face_lookup_error(
    camera: OmniCamera, regions: tuple[FaceRegion, ...], *, face_samples: int
) -> GeometricError:
    """Displacement by the texels of face regions.

    The rms is that of edges uniformly distributed between two texels: 1 / sqrt 3 of the maximum.
    """
    footprint = texel_footprint(camera, regions)
    displacement = max_edge_displacement_texels(face_samples)
    rms = displacement / math.sqrt(3.0)
    return GeometricError(
        max_px=displacement * footprint.max_px,
        rms_px=rms * footprint.rms_px,
        max_deg=math.degrees(displacement * footprint.max_rad),
        rms_deg=math.degrees(rms * footprint.rms_rad),
    )
