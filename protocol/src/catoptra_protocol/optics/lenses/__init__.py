"""Lens models by name, as robot files name them.

To add a lens: write `<name>.py` beside the others (frozen parameters, `pixel_from_direction` and
`direction_from_pixel` with masks, domain, source) and add its line to `LENSES`. The raster renderer
needs a projection as well: see `catoptra_server.render.projection.lens_projection`.
"""

from catoptra_protocol.optics.lenses.lens import Lens
from catoptra_protocol.optics.lenses.perspective import PerspectiveCamera

LENSES: dict[str, type[Lens]] = {
    "perspective": PerspectiveCamera,
}

__all__ = ["LENSES", "Lens", "PerspectiveCamera"]
