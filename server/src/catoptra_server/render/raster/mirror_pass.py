"""The mirror's image: every sample of every pixel looked up in the atlas through the lookup map.

The lookup map comes from the camera model (`projection/atlas.py`) or from the paper's mirror mesh.
Either is made once for a view. The capture camera never moves relative to the mesh, so the view
through each facet never changes: drawn in every frame, 4096 polygons took llvmpipe 39 % longer than
16; now any number costs as much as the exact model (`tests/measurements/polygon_counts.py`). The
mesh needs no depth buffer: the capture camera sees the whole of a convex mirror.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.projection.atlas import OUTSIDE_MIRROR, Atlas, compute_lookup_map
from catoptra_server.render.raster.device import (
    Definitions,
    ProgramSpec,
    ShaderPrograms,
    set_uniform,
)
from catoptra_server.render.raster.face_pass import FacePass
from catoptra_server.render.raster.passes import ENCODED
from catoptra_server.render.renderer import MirrorSurface, PerPixel
from catoptra_server.world.mirror_mesh import MirrorMesh, Tessellation, build_mirror_mesh
from catoptra_server.world.objects import CameraState

# Sides of the polygon around the rim circle: 1.3 % more area than the disc, a square has 27 % more;
# on llvmpipe more sides cost more in half-empty blocks of fragments than is saved.
_NUM_RIM_SIDES = 16


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


def rim_polygon(camera: OmniCamera) -> Floats:
    """(n, 2) clip positions of a polygon around every pixel that sees the mirror."""
    azimuth = 2.0 * math.pi * np.arange(_NUM_RIM_SIDES) / _NUM_RIM_SIDES
    # A pixel whose centre lies beyond the rim may have samples within the rim.
    radius = (camera.rim_radius_px + 1.0) / math.cos(math.pi / _NUM_RIM_SIDES)
    circle = radius * np.stack((np.cos(azimuth), np.sin(azimuth)), axis=-1)
    size = np.array((camera.width_px, camera.height_px))
    clip: Floats = 2.0 * (circle + camera.centre_px) / size - 1.0
    return clip


def make_lookup_map(
    context: moderngl.Context,
    programs: ShaderPrograms,
    camera: OmniCamera,
    surface: MirrorSurface,
    atlas: Atlas,
    samples: int,
) -> moderngl.Texture:
    """Texture of the lookup map of the camera model or of a mirror mesh.

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
    is_exact = isinstance(surface, PerPixel)
    data = compute_lookup_map(camera, atlas, samples) if is_exact else None
    lookup_map = context.texture(size, 2, data, dtype="f4")
    # Interpolating coordinates would mix positions on different faces of the atlas.
    lookup_map.filter = (moderngl.NEAREST, moderngl.NEAREST)
    if isinstance(surface, Tessellation):
        _render_mesh(
            context, programs, build_mirror_mesh(camera, surface), camera, atlas, lookup_map
        )
    return lookup_map


def _render_mesh(
    context: moderngl.Context,
    programs: ShaderPrograms,
    mesh: MirrorMesh,
    camera: OmniCamera,
    atlas: Atlas,
    lookup_map: moderngl.Texture,
) -> None:
    """Fill the lookup map of a mirror mesh, OUTSIDE_MIRROR for samples beside the mesh.

    The mesh is rendered once, `samples` times larger than the image: the samples then coincide with
    trace's, which multisampling would leave to the driver.
    """
    target = context.framebuffer([lookup_map])
    # A definition instead of a uniform: without face U the shader has no comparison with U.
    definitions = (("NUM_FACES", atlas.num_faces),)
    program = programs.get(ProgramSpec("mirror_mesh_lookup", "mirror_mesh_lookup", definitions))
    set_uniform(program, "face_texel_transform", atlas.texel_transforms())
    set_uniform(program, "atlas_texel", (1.0 / atlas.width, 1.0 / atlas.height))
    # Clip positions and directions in one buffer: freed after a single draw call.
    corners = np.concatenate((mirror_mesh_clip_positions(camera, mesh), mesh.directions), axis=-1)
    buffer = context.buffer(corners.astype(np.float32).tobytes())
    vertices = context.vertex_array(
        program, [(buffer, "4f 3f", "clip_position", "direction_at_corner")]
    )
    context.enable_only(moderngl.NOTHING)
    target.use()
    target.clear(OUTSIDE_MIRROR, OUTSIDE_MIRROR)
    vertices.render()
    for resource in (vertices, buffer, target):
        resource.release()


def mirror_mesh_clip_positions(camera: OmniCamera, mesh: MirrorMesh) -> Floats:
    """(n, 3, 4) clip positions of a mesh's corners in the capture camera.

    The pinhole projection of a point of the exact mirror is the point's pixel by the camera model.
    w is the distance from the pinhole along the axis, so OpenGL interpolates over the facet, not
    the image.

    Raises:
        DomainError: The capture camera is orthographic, which trace rejects too.
    """
    if not math.isfinite(camera.mirror.pinhole_distance_m):
        raise DomainError("a mirror mesh needs a capture camera with a pinhole")
    x, y, z = np.moveaxis(mesh.corners, -1, 0)
    w = camera.mirror.pinhole_distance_m - z
    rim_r, rim_z = camera.mirror.surface_point(np.array(camera.rim_t))
    # The focal length that projects the exact mirror's rim onto the camera model's rim circle.
    focal_px = camera.rim_radius_px * (camera.mirror.pinhole_distance_m - rim_z) / rim_r
    cos_azimuth, sin_azimuth = (
        math.cos(camera.image_up_azimuth_rad),
        math.sin(camera.image_up_azimuth_rad),
    )
    # Homogeneous pixels, u w and v w, as in pixel_from_direction.
    u = focal_px * (sin_azimuth * x - cos_azimuth * y) + camera.centre_px[0] * w
    v = focal_px * (-cos_azimuth * x - sin_azimuth * y) + camera.centre_px[1] * w
    clip_x = 2.0 * u / camera.width_px - w
    clip_y = 2.0 * v / camera.height_px - w
    return np.stack((clip_x, clip_y, np.zeros_like(w), w), axis=-1)
