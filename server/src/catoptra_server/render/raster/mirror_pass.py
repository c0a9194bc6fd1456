"""The mirror's picture: every sample of every pixel looked up in the atlas, where its place says.

Places never change while a view lives: by the mirror's own law, or by a polygon mirror drawn once.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.raster.atlas import Atlas
from catoptra_server.render.raster.faces import FacePass
from catoptra_server.render.raster.mirror_places import mirror_places
from catoptra_server.render.raster.passes import ENCODED
from catoptra_server.render.raster.programs import Definitions, Programs, ProgramSpec
from catoptra_server.render.renderer import Exposure

# Sides of the polygon around the rim circle: it covers 1.3 % more than the disc, a square 27 %;
# more sides cost more in half-empty blocks of fragments than they save on llvmpipe.
_RIM_SIDES = 16


def polygon_around_rim(camera: OmniCamera) -> Floats:
    """Return the (n, 2) clip positions of a polygon that holds every pixel that sees the mirror."""
    azimuth = 2.0 * math.pi * np.arange(_RIM_SIDES) / _RIM_SIDES
    # A pixel whose middle lies beyond the rim may have samples within it.
    radius = (camera.rim_radius_px + 1.0) / math.cos(math.pi / _RIM_SIDES)
    circle = radius * np.stack((np.cos(azimuth), np.sin(azimuth)), axis=-1)
    size = np.array((camera.width_px, camera.height_px))
    clip: Floats = 2.0 * (circle + camera.centre_px) / size - 1.0
    return clip


class MirrorPass:
    """One draw of the polygon around the rim, over black. encoding: ENCODED or LINEAR.

    places: of samples x samples a pixel; its view frees them.
    """

    name = "mirror"

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        faces: FacePass[Atlas],
        camera: OmniCamera,
        places: moderngl.Texture,
        samples: int,
        target: moderngl.Framebuffer,
        *,
        encoding: Definitions = ENCODED,
    ) -> None:
        self._context = context
        self._faces = faces
        self._target = target
        define = (("SAMPLES", samples), *encoding)
        self._program = programs.get(ProgramSpec("mirror", "mirror", define))
        self._program["places"] = 1
        self._places = places
        self._corners = context.buffer(polygon_around_rim(camera).astype(np.float32).tobytes())
        self._vertices = context.vertex_array(self._program, [(self._corners, "2f", "position")])

    def draw(self, exposure: Exposure) -> None:
        """Fill the target."""
        self._faces.texture.use(0)
        self._places.use(1)
        self._context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._target.clear()
        self._vertices.render(moderngl.TRIANGLE_FAN)

    def close(self) -> None:
        """Free the polygon."""
        self._vertices.release()
        self._corners.release()


def law_places(
    context: moderngl.Context, camera: OmniCamera, atlas: Atlas, samples: int
) -> moderngl.Texture:
    """Return the texture of the places that the mirror's law gives."""
    size = places_size(context, camera, samples)
    texture = context.texture(size, 2, mirror_places(camera, atlas, samples), dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def places_size(context: moderngl.Context, camera: OmniCamera, samples: int) -> tuple[int, int]:
    """Return width and height of a texture of places. Raises DomainError where none is so large."""
    size = (samples * camera.width_px, samples * camera.height_px)
    limit = context.info["GL_MAX_TEXTURE_SIZE"]
    if max(size) > limit:
        raise DomainError(
            f"{samples}^2 samples of {camera.width_px} x {camera.height_px} px are too many: this "
            f"OpenGL ends at {limit} px a side"
        )
    return size
