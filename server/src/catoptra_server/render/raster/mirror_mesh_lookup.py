"""The lookup map of the paper's mirror mesh, rendered once.

The capture camera never moves relative to the mesh, so the view through each facet never changes
either. A frame is then as fast as one by the camera model, with any number of polygons. No depth
buffer is needed: the capture camera sees the whole of a convex mirror.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.projection.lookup_map import OUTSIDE_MIRROR
from catoptra_server.render.raster.atlas_lookup import atlas_definitions, set_atlas_uniforms
from catoptra_server.render.raster.mirror_pass import lookup_map_size
from catoptra_server.render.raster.shader_programs import ProgramSpec, ShaderPrograms
from catoptra_server.world.mirror_mesh import MirrorMesh, Tessellation, build_mirror_mesh


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


def render_lookup_texture(
    context: moderngl.Context,
    programs: ShaderPrograms,
    camera: OmniCamera,
    tessellation: Tessellation,
    samples: int,
    atlas: Atlas,
) -> moderngl.Texture:
    """Lookup map of a mirror mesh, OUTSIDE_MIRROR for samples beside the mesh.

    The mesh is rendered once, `samples` times larger than the image: its samples then coincide with
    those of trace, which multisampling would leave to the driver.
    """
    lookup_map = context.texture(lookup_map_size(context, camera, samples), 2, dtype="f4")
    lookup_map.filter = (moderngl.NEAREST, moderngl.NEAREST)
    target = context.framebuffer([lookup_map])
    spec = ProgramSpec("mirror_mesh_lookup", "mirror_mesh_lookup", atlas_definitions(atlas))
    program = programs.get(spec)
    set_atlas_uniforms(program, atlas)
    mesh = build_mirror_mesh(camera, tessellation)
    # Clip positions and directions in one buffer: used for a single draw call and freed after it.
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
    return lookup_map
