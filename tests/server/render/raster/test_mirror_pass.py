"""The polygon around the rim, and the lookup maps of camera model and mirror mesh."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_server.frames.plan.plans import max_incidence_rad
from catoptra_server.render.projection.atlas import pack_atlas
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.raster.mirror_pass import mirror_mesh_clip_positions, rim_polygon
from catoptra_server.render.renderer import PerPixel
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation, build_mirror_mesh
from catoptra_server.world.world_description import World
from helpers.opengl import make_raster
from helpers.worlds import make_omni_camera, make_plan, regions_of_size

# Off centre, not square, cut by the image: no part of the mirror may be left out.
OFF_CENTRE = OmniCamera(HyperbolicMirror(11.546, 0.2), 160, 120, (70.0, 66.0), 40.0, 2.0, 0.4)


@pytest.mark.parametrize("camera", [make_omni_camera(), OFF_CENTRE], ids=["centred", "off centre"])
def test_polygon_contains_every_sample_that_sees_the_mirror(camera: OmniCamera) -> None:
    size = np.array((camera.width_px, camera.height_px))
    corners = 0.5 * (rim_polygon(camera) + 1.0) * size
    along = np.roll(corners, -1, axis=0) - corners
    outwards = np.stack((along[:, 1], -along[:, 0]), axis=-1)
    # A pixel is rendered where its centre is inside, and then with all its samples.
    _, seen = direction_from_pixel(camera, pixel_sample_positions(camera, 4))
    centres = pixel_sample_positions(camera)[:, :, 0][seen.any(axis=-1)]
    beyond = np.einsum("pci,ci->pc", centres[:, None] - corners, outwards)
    assert (beyond <= 0.0).all()


def test_more_samples_than_a_texture_contains_are_rejected(device: GlDevice) -> None:
    camera = make_omni_camera(width_px=1100)
    renderer = make_raster(device, World("empty", ()))
    with pytest.raises(DomainError, match=r"16\^2 samples of 1100 x 1100 px are too many"):
        renderer.prepare(camera, make_plan(camera, samples=16, face_size_px=32))


def test_polygon_follows_the_image_centre() -> None:
    camera = make_omni_camera()
    aside = replace(camera, centre_px=(camera.centre_px[0] + 10.0, camera.centre_px[1]))
    shift = rim_polygon(aside) - rim_polygon(camera)
    assert shift == pytest.approx(np.broadcast_to((2.0 * 10.0 / camera.width_px, 0.0), (16, 2)))


@pytest.mark.parametrize(("limit_deg", "compared"), [(125.0, 5), (126.0, 6)])
def test_upward_face_is_compared_only_where_it_is_rendered(limit_deg: float, compared: int) -> None:
    parts = regions_of_size(math.radians(limit_deg), 32)
    atlas = pack_atlas(parts, guard_texels=2, max_texels=1024)
    assert atlas.num_faces == compared


TURNED = replace(
    make_omni_camera(), centre_px=(90.3, 120.8), width_px=220, image_up_azimuth_rad=0.6
)


@pytest.mark.parametrize("camera", [make_omni_camera(), TURNED], ids=["plain", "turned"])
def test_corners_project_to_the_pixels_of_the_camera_model(camera: OmniCamera) -> None:
    mesh = build_mirror_mesh(camera, Tessellation(12, 5))
    x, y, _, w = np.moveaxis(mirror_mesh_clip_positions(camera, mesh), -1, 0)
    u, v = 0.5 * (x / w + 1.0) * camera.width_px, 0.5 * (y / w + 1.0) * camera.height_px
    expected, _ = pixel_from_direction(replace(camera, rim_rad=camera.rim_rad + 0.01), mesh.corners)
    assert np.stack((u, v), axis=-1) == pytest.approx(expected, abs=1e-9)
    assert w == pytest.approx(camera.mirror.pinhole_distance_m - mesh.corners[..., 2])


def test_orthographic_camera_has_no_mirror_mesh() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03))
    mesh = build_mirror_mesh(camera, Tessellation(8, 8))
    with pytest.raises(DomainError, match="pinhole"):
        mirror_mesh_clip_positions(camera, mesh)


@pytest.mark.parametrize("interpolation", list(Interpolation))
@pytest.mark.parametrize("sectors", [3, 4, 5, 8, 16])
@pytest.mark.parametrize("rim_deg", [80.0, 100.0, 120.0, 140.0])
def test_no_point_on_a_polygon_looks_higher_than_the_bound(
    interpolation: Interpolation, sectors: int, rim_deg: float
) -> None:
    camera = make_omni_camera(rim_deg=rim_deg)
    tessellation = Tessellation(sectors, 3, interpolation)
    directions = build_mirror_mesh(camera, tessellation).directions
    weights = np.random.default_rng(0).dirichlet((0.4, 0.4, 0.4), 400)
    positions = np.einsum("wc,nci->nwi", weights, directions)
    incidence = np.arccos(positions[..., 2] / np.linalg.norm(positions, axis=-1))
    assert incidence.max() <= max_incidence_rad(camera, tessellation) + 1e-9


def test_camera_model_looks_up_to_the_rim() -> None:
    assert max_incidence_rad(make_omni_camera(rim_deg=120.0), PerPixel()) == math.radians(120.0)
