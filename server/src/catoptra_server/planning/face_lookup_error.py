"""How far the texels of the cube's faces move what is seen in them. Raster only.

A texel knows what its samples hit, the picture what lies between four texels. A straight edge is
shown where that bilinear interpolation passes one half.

With one sample a texel it stands at most half a texel from its place, whatever its direction: let
L be the signed distance from the edge at the texels' middles, w their bilinear weights at a place
with L(place) = sum w L, and one half of the weight on middles with L > 0. The largest such L(place)
within a square of middles is 1/2, for an edge along the texels. Texels need not be square for that:
it is said in their own unit. With more samples a texel holds steps of its coverage, and how far
that moves an edge depends on where the samples lie.

Things smaller than a texel may be missed altogether, and corners are rounded off (the tip of a
right angle by 0.7 texels). That is no displacement of what is left and is not counted: the numbers
here are for edges that bend with a radius of two texels at least, so for things from four texels
on.
"""

from __future__ import annotations

import math

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.geometric_error import GeometricError
from catoptra_server.planning.texel_footprint import texel_footprint
from catoptra_server.render.face_region import FaceRegion

# Largest displacement in texels by samples a texel. 1: one half, and 1 / (8 * 2) by which an arc of
# radius two departs from its chord of one texel. More: the worst of arcs from radius two to
# straight, in the standard patterns of samples that drivers use, and a twentieth of it more;
# searched in tests/server/planning/test_face_lookup_error.py.
MAX_EDGE_DISPLACEMENT_TEXELS = {1: 0.5 + 1.0 / 16.0, 2: 0.50, 4: 0.38, 8: 0.32, 16: 0.29}
# Corners of triangles and places between texels are held in 256ths by the hardware, to half a step
# along both sides: twice sqrt(2) / 512.
_FIXED_POINT_TEXELS = math.sqrt(2.0) / 256.0


def max_edge_displacement_texels(face_samples: int) -> float:
    """Return how many texels an edge may be displaced; drivers take no fewer samples than asked."""
    known = max(samples for samples in MAX_EDGE_DISPLACEMENT_TEXELS if samples <= face_samples)
    return MAX_EDGE_DISPLACEMENT_TEXELS[known] + _FIXED_POINT_TEXELS


def face_lookup_error(
    camera: OmniCamera, regions: tuple[FaceRegion, ...], *, face_samples: int
) -> GeometricError:
    """Return the displacement by the texels of parts of faces.

    The rms is that of edges anywhere between two texels, each place alike: 1 / sqrt 3 of the most.
    """
    texels = texel_footprint(camera, regions)
    moved = max_edge_displacement_texels(face_samples)
    anywhere = moved / math.sqrt(3.0)
    return GeometricError(
        max_px=moved * texels.max_px,
        rms_px=anywhere * texels.rms_px,
        max_deg=math.degrees(moved * texels.max_rad),
        rms_deg=math.degrees(anywhere * texels.rms_rad),
    )
