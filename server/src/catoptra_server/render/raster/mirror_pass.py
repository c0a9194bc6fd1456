"""The mirror's picture: every sample of every pixel looked up in the atlas, where its place says.

Places never change while a view lives: by the mirror's own law, or by a polygon mirror drawn once.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.projection.lookup_map import compute_lookup_map
from catoptra_server.render.raster.face_pass import FacePass
from catoptra_server.render.raster.passes import ENCODED
from catoptra_server.render.raster.shader_programs import Definitions, ProgramSpec, ShaderPrograms

# Sides of the polygon around the rim circle: it covers 1.3 % more than the disc, a square 27 %;
# more sides cost more in half-empty blocks of fragments than they save on llvmpipe.
_NUM_RIM_SIDES = 16


def rim_polygon(camera: OmniCamera) -> Floats:
    """Return the (n, 2) clip positions of a polygon that holds every pixel that sees the mirror."""
    azimuth = 2.0 * math.pi * np.arange(_NUM_RIM_SIDES) / _NUM_RIM_SIDES
    # A pixel whose middle lies beyond the rim may have samples within it.
    radius = (camera.rim_radius_px + 1.0) / math.cos(math.pi / _NUM_RIM_SIDES)
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
        programs: ShaderPrograms,
        faces: FacePass[Atlas],
        camera: OmniCamera,
        lookup_map: moderngl.Texture,
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
        self._program["lookup_map"] = 1
        self._lookup_map = lookup_map
        self._corners = context.buffer(rim_polygon(camera).astype(np.float32).tobytes())
        self._vertices = context.vertex_array(self._program, [(self._corners, "2f", "position")])

    def draw(self, camera_state: CameraState) -> None:
        """Fill the target."""
        self._faces.texture.use(0)
        self._lookup_map.use(1)
        self._context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._target.clear()
        self._vertices.render(moderngl.TRIANGLE_FAN)

    def close(self) -> None:
        """Free the polygon."""
        self._vertices.release()
        self._corners.release()


def make_lookup_texture(
    context: moderngl.Context, camera: OmniCamera, atlas: Atlas, samples: int
) -> moderngl.Texture:
    """Return the texture of the places that the mirror's law gives."""
    size = lookup_map_size(context, camera, samples)
    texture = context.texture(size, 2, compute_lookup_map(camera, atlas, samples), dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def lookup_map_size(context: moderngl.Context, camera: OmniCamera, samples: int) -> tuple[int, int]:
    """Return width and height of a texture of places. Raises DomainError where none is so large."""
    size = (samples * camera.width_px, samples * camera.height_px)
    limit = context.info["GL_MAX_TEXTURE_SIZE"]
    if max(size) > limit:
        raise DomainError(
            f"{samples}^2 samples of {camera.width_px} x {camera.height_px} px are too many: this "
            f"OpenGL ends at {limit} px a side"
        )
    return size
