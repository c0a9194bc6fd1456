"""The mirror's picture by the paper's mesh of polygons, as the capture camera sees it.

With more than one sample a pixel the picture is drawn that many times larger, in linear light, and
averaged by a pass of its own: its samples then lie where trace puts them, which multisampling would
leave to the driver. Without a depth buffer: the capture camera sees the whole of a convex mirror.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.raster.atlas import Atlas
from catoptra_server.render.raster.atlas_lookup import atlas_definitions, use_atlas
from catoptra_server.render.raster.faces import FacePass
from catoptra_server.render.raster.passes import ENCODED, LINEAR, LINEAR_STORAGE
from catoptra_server.render.raster.programs import Definitions, Programs, ProgramSpec
from catoptra_server.render.renderer import Exposure
from catoptra_server.scene.mirror_mesh import MirrorMesh, PolygonSplit, mirror_mesh


def polygon_clip_positions(camera: OmniCamera, mesh: MirrorMesh) -> Floats:
    """Return the (n, 3, 4) clip positions of a mesh's corners in the capture camera.

    The pinhole projection of a point of the exact mirror is its pixel by the law. w is the distance
    from the pinhole along the axis, so what is interpolated is so over the facet, not the picture.
    Raises DomainError for an orthographic camera, which trace refuses too.
    """
    if not math.isfinite(camera.mirror.pinhole_m):
        raise DomainError("a polygon mirror needs a capture camera with a pinhole")
    x, y, z = np.moveaxis(mesh.corners, -1, 0)
    w = camera.mirror.pinhole_m - z
    rim_r, rim_z = camera.mirror.surface(np.array(camera.rim_t))
    focal_px = camera.rim_radius_px * (camera.mirror.pinhole_m - rim_z) / rim_r
    cos_up, sin_up = math.cos(camera.up_azimuth_rad), math.sin(camera.up_azimuth_rad)
    # Homogeneous pixels, u w and v w, as in pixel_from_direction.
    u = focal_px * (sin_up * x - cos_up * y) + camera.centre_px[0] * w
    v = focal_px * (-cos_up * x - sin_up * y) + camera.centre_px[1] * w
    clip_x = 2.0 * u / camera.width_px - w
    clip_y = 2.0 * v / camera.height_px - w
    return np.stack((clip_x, clip_y, np.zeros_like(w), w), axis=-1)


class PolygonMirror:
    """The pass: one draw of all polygons, over black.

    With one sample it fills `target`, with sRGB or with linear light as `encoding` says, else
    `picture` with linear light at samples times the size. `picture` is None where it is not needed.
    """

    name = "mirror"

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        faces: FacePass[Atlas],
        camera: OmniCamera,
        split: PolygonSplit,
        samples: int,
        target: moderngl.Framebuffer,
        *,
        encoding: Definitions = ENCODED,
    ) -> None:
        self._context = context
        self._faces = faces
        self.picture = _picture(context, camera, samples) if samples > 1 else None
        self._target = context.framebuffer([self.picture]) if self.picture else target
        is_linear = self.picture or encoding == LINEAR
        encoded = () if is_linear else (("ENCODED", 1),)
        define = (*encoded, *atlas_definitions(faces.atlas))
        self._program = programs.get(ProgramSpec("mirror_polygons", "mirror_polygons", define))
        mesh = mirror_mesh(camera, split)
        corners = np.concatenate((polygon_clip_positions(camera, mesh), mesh.directions), axis=-1)
        self._corners = context.buffer(corners.astype(np.float32).tobytes())
        self._vertices = context.vertex_array(
            self._program, [(self._corners, "4f 3f", "clip_position", "looked_up")]
        )

    def draw(self, exposure: Exposure) -> None:
        """Fill the target."""
        use_atlas(self._program, self._faces.atlas, self._faces.texture)
        self._context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._target.clear()
        self._vertices.render()

    def close(self) -> None:
        """Free the mesh, and the large picture if there is one."""
        self._vertices.release()
        self._corners.release()
        if self.picture is not None:
            self._target.release()
            self.picture.release()


def _picture(context: moderngl.Context, camera: OmniCamera, samples: int) -> moderngl.Texture:
    size = (samples * camera.width_px, samples * camera.height_px)
    limit = context.info["GL_MAX_TEXTURE_SIZE"]
    if max(size) > limit:
        raise DomainError(
            f"{samples}^2 samples of {camera.width_px} x {camera.height_px} polygon pixels are too "
            f"many: this OpenGL ends at {limit} px a side"
        )
    return context.texture(size, 4, dtype=LINEAR_STORAGE)
