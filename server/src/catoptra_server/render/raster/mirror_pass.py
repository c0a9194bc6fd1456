"""The mirror's image: every sample of every pixel looked up in the atlas through the lookup map.

The lookup map never changes while a view lives, whether it comes from the camera model or from a
mirror mesh that is rendered once.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.projection.lookup_map import compute_lookup_map
from catoptra_server.render.raster.face_pass import FacePass
from catoptra_server.render.raster.passes import ENCODED
from catoptra_server.render.raster.shader_programs import Definitions, ProgramSpec, ShaderPrograms
from catoptra_server.world.camera_state import CameraState

# Sides of the polygon around the rim circle: 1.3 % more area than the disc, a square has 27 % more;
# on llvmpipe more sides cost more in half-empty blocks of fragments than they save.
_NUM_RIM_SIDES = 16


def rim_polygon(camera: OmniCamera) -> Floats:
    """(n, 2) clip positions of a polygon around every pixel that sees the mirror."""
    azimuth = 2.0 * math.pi * np.arange(_NUM_RIM_SIDES) / _NUM_RIM_SIDES
    # A pixel whose centre lies beyond the rim may have samples within the rim.
    radius = (camera.rim_radius_px + 1.0) / math.cos(math.pi / _NUM_RIM_SIDES)
    circle = radius * np.stack((np.cos(azimuth), np.sin(azimuth)), axis=-1)
    size = np.array((camera.width_px, camera.height_px))
    clip: Floats = 2.0 * (circle + camera.centre_px) / size - 1.0
    return clip


class MirrorPass:
    """One draw of the polygon around the rim, over black."""

    name = "mirror"
    # A polygon of 16 corners; the lookup map belongs to the view.
    memory_bytes = 0

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
        """Prepare the polygon and the program.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            faces: Face pass whose texture is looked up.
            camera: Camera model of the image.
            lookup_map: Atlas coordinates of samples x samples a pixel; freed with the view.
            samples: Samples along a pixel's side.
            target: Target of the image.
            encoding: ENCODED or LINEAR.
        """
        self._context = context
        self._faces = faces
        self._target = target
        definitions = (("SAMPLES", samples), *encoding)
        self._program = programs.get(ProgramSpec("mirror", "mirror", definitions))
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
        # Pixels outside the polygon keep the clear colour: black, as rays off the mirror in trace.
        self._target.clear()
        self._vertices.render(moderngl.TRIANGLE_FAN)

    def close(self) -> None:
        """Free the polygon."""
        self._vertices.release()
        self._corners.release()


def make_lookup_texture(
    context: moderngl.Context, camera: OmniCamera, atlas: Atlas, samples: int
) -> moderngl.Texture:
    """Texture of the lookup map of the camera model."""
    size = lookup_map_size(context, camera, samples)
    texture = context.texture(size, 2, compute_lookup_map(camera, atlas, samples), dtype="f4")
    # Interpolating coordinates would mix positions on different faces of the atlas.
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def lookup_map_size(context: moderngl.Context, camera: OmniCamera, samples: int) -> tuple[int, int]:
    """Width and height of a lookup map's texture.

    Raises:
        DomainError: The device has no texture of that size.
    """
    size = (samples * camera.width_px, samples * camera.height_px)
    limit = context.info["GL_MAX_TEXTURE_SIZE"]
    if max(size) > limit:
        raise DomainError(
            f"{samples}^2 samples of {camera.width_px} x {camera.height_px} px are too many: this "
            f"OpenGL allows {limit} px a side"
        )
    return size
