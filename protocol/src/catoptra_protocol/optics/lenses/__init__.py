"""All lenses that Catoptra knows, in one visible table.

To add one: write `<name>.py` beside the others (frozen parameters, `pixel_from_direction` and its
inverse with validity, domain, source), then add its line here; what raster needs beside the law is
said in `catoptra_server.render.projection.lens_projection`.
"""

from catoptra_protocol.optics.lenses.lens import Lens
from catoptra_protocol.optics.lenses.perspective import PerspectiveCamera

LENSES: dict[str, type[Lens]] = {
    "perspective": PerspectiveCamera,
}

__all__ = ["LENSES", "Lens", "PerspectiveCamera"]
