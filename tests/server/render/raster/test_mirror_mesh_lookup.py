from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_server.frames.plan.plans import max_incidence_rad
from catoptra_server.render.raster.mirror_pass import mirror_mesh_clip_positions
from catoptra_server.render.render_settings import PerPixel
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation, build_mirror_mesh
from helpers.worlds import make_omni_camera

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
