"""Lens models by name, as robot files name them.

To add a lens: write `<name>.py` beside the others (frozen parameters, image radius and its inverse
in the half-angle tangent, slope, limit, first fold, source), add its line to `LENSES`, and its
parameters to `catoptra_protocol.camera_conf.LENS_PARAMETERS`. No renderer needs to know it.
"""

from catoptra_protocol.optics.lenses.equidistant import EquidistantLens
from catoptra_protocol.optics.radial_projection import RadialProjection

LENSES: dict[str, type[RadialProjection]] = {
    "equidistant": EquidistantLens,
}

__all__ = ["LENSES", "EquidistantLens"]
