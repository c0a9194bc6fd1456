"""The paper's mesh of polygons, drawn once: where in the atlas each sample of its picture looks.

The capture camera sees the mesh from where it stays, so what is seen through each facet never
changes either. A frame is then as fast as one by the mirror's law, with any number of polygons.
Drawn without a depth buffer: the capture camera sees the whole of a convex mirror.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.projection.atlas import Atlas
from catoptra_server.render.raster.atlas_lookup import atlas_definitions, set_atlas_uniforms
from catoptra_server.render.projection.lookup_map import OUTSIDE_MIRROR
from catoptra_server.render.raster.mirror_pass import lookup_map_size
from catoptra_server.render.raster.shader_programs import ProgramSpec, ShaderPrograms
from catoptra_server.scene.mirror_mesh import MirrorMesh, Tessellation, build_mirror_mesh


def mirror_mesh_clip_positions(camera: OmniCamera, mesh: MirrorMesh) -> Floats:
    """Return the (n, 3, 4) clip positions of a mesh's corners in the capture camera.

    The pinhole projection of a point of the exact mirror is its pixel by the law. w is the distance
    from the pinhole along the axis, so what is interpolated is so over the facet, not the picture.
    Raises DomainError for an orthographic camera, which trace refuses too.
    """
    if not math.isfinite(camera.mirror.pinhole_distance_m):
        raise DomainError("a polygon mirror needs a capture camera with a pinhole")
    x, y, z = np.moveaxis(mesh.corners, -1, 0)
    w = camera.mirror.pinhole_distance_m - z
    rim_r, rim_z = camera.mirror.surface_point(np.array(camera.rim_t))
    focal_px = camera.rim_radius_px * (camera.mirror.pinhole_distance_m - rim_z) / rim_r
    cos_up, sin_up = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
    # Homogeneous pixels, u w and v w, as in pixel_from_direction.
    u = focal_px * (sin_up * x - cos_up * y) + camera.centre_px[0] * w
    v = focal_px * (-cos_up * x - sin_up * y) + camera.centre_px[1] * w
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
    """Return the texture of the places that a polygon mirror's samples look up; NOWHERE beside it.

    The mesh is drawn once, samples times larger than the picture: its samples then lie where trace
    puts them, which multisampling would leave to the driver.
    """
    places = context.texture(lookup_map_size(context, camera, samples), 2, dtype="f4")
    places.filter = (moderngl.NEAREST, moderngl.NEAREST)
    target = context.framebuffer([places])
    spec = ProgramSpec("mirror_mesh_lookup", "mirror_mesh_lookup", atlas_definitions(atlas))
    program = programs.get(spec)
    set_atlas_uniforms(program, atlas)
    mesh = build_mirror_mesh(camera, tessellation)
    corners = np.concatenate((mirror_mesh_clip_positions(camera, mesh), mesh.directions), axis=-1)
    buffer = context.buffer(corners.astype(np.float32).tobytes())
    vertices = context.vertex_array(program, [(buffer, "4f 3f", "clip_position", "direction_at_corner")])
    context.enable_only(moderngl.NOTHING)
    target.use()
    target.clear(OUTSIDE_MIRROR, OUTSIDE_MIRROR)
    vertices.render()
    for drawn_with in (vertices, buffer, target):
        drawn_with.release()
    return places
