"""How far the texels of the cube's faces move what is seen in them. Raster only.

A texel knows what its samples hit, the picture what lies between four texels. A straight edge is
shown where that bilinear interpolation passes one half.

With one sample a texel it stands at most half a texel from its place, whatever its direction: let
L be the signed distance from the edge at the texels' middles, w their bilinear weights at a place
with L(place) = sum w L, and one half of the weight on middles with L > 0. The largest such L(place)
within a square of middles is 1/2, for an edge along the texels. With more samples a texel holds
steps of its coverage, and how far that moves an edge depends on where the samples lie.

A texel also ends a thing that is smaller than itself: it may be missed. That is no displacement and
is not counted; the numbers here are for edges that bend with a radius of two texels at least, so
for things from four texels on.
"""

from __future__ import annotations

import math

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.plan.face_texels import face_scale
from catoptra_server.plan.geometric_error import GeometricError

# Largest displacement of a straight edge in texels by samples a texel, for the standard patterns of
# samples that drivers use: tests/server/plan/test_face_lookup_error.py searches it.
EDGE_TEXELS = {1: 0.5, 2: 0.4, 4: 0.31, 8: 0.25, 16: 0.22}
# An arc of radius two departs from its chord of one texel by 1 / (8 * 2).
_BEND_TEXELS = 1.0 / 16.0
# Corners of triangles and places between texels are held in 256ths by the hardware, to half a step
# along both sides: twice sqrt(2) / 512.
_FIXED_POINT_TEXELS = math.sqrt(2.0) / 256.0


def edge_texels(face_samples: int) -> float:
    """Return how many texels an edge may be displaced; drivers take no fewer samples than asked."""
    known = max(samples for samples in EDGE_TEXELS if samples <= face_samples)
    return EDGE_TEXELS[known] + _BEND_TEXELS + _FIXED_POINT_TEXELS


def face_lookup_error(
    camera: OmniCamera, *, face_size_px: int, face_samples: int
) -> GeometricError:
    """Return the displacement by faces of so many texels a side.

    The rms is that of edges anywhere between two texels, each place alike: 1 / sqrt 3 of the most.
    """
    scale = face_scale(camera)
    units = edge_texels(face_samples) * 2.0 / face_size_px
    anywhere = units / math.sqrt(3.0)
    return GeometricError(
        max_px=units * scale.max_px_per_unit,
        rms_px=anywhere * scale.rms_px_per_unit,
        max_deg=math.degrees(units * scale.max_rad_per_unit),
        rms_deg=math.degrees(anywhere * scale.rms_rad_per_unit),
    )
