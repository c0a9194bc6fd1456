from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face, face_coordinates, face_from_direction
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.frames.plan.faces import regions_by_density, regions_of_size, texel_footprint
from catoptra_server.render.renderer import FaceRegion
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)
MIRROR_CAMERAS = [
    CAMERA,
    make_omni_camera(mirror=HyperbolicMirror(2.3, 0.1), width_px=200, rim_deg=100.0),
    make_omni_camera(mirror=ParabolicMirror(0.03), width_px=300, rim_deg=140.0),
]


def equal_size_regions(camera: OmniCamera, size_px: int) -> tuple[FaceRegion, ...]:
    return regions_of_size(camera.rim_rad, size_px)


def numeric_texels_per_px(camera: OmniCamera, size_px: int) -> tuple[Floats, Floats]:
    """Fewest and largest texels a pixel at scattered pixels, by finite differences."""
    rng = np.random.default_rng(2)
    radius = 0.999 * camera.rim_radius_px * np.sqrt(rng.uniform(0.0, 1.0, 20_000))
    turn = rng.uniform(-math.pi, math.pi, 20_000)
    pixels = camera.centre_px + radius[:, None] * np.stack((np.cos(turn), np.sin(turn)), axis=-1)
    step = 1e-5
    offsets = np.array([(0.0, 0.0), (step, 0.0), (0.0, step)])
    directions, _ = direction_from_pixel(camera, pixels[:, None] + offsets)
    face = np.broadcast_to(face_from_direction(directions[:, :1]), directions.shape[:2])
    texels = face_coordinates(directions, face) * 0.5 * size_px
    derivatives = (texels[:, 1:] - texels[:, :1]) / step
    values = np.linalg.svd(derivatives, compute_uv=False)
    return values[:, 1], values[:, 0]


@pytest.mark.parametrize("camera", MIRROR_CAMERAS, ids=["the paper's", "strong", "parabolic"])
def test_densities_equal_finite_differences_of_the_camera_model(camera: OmniCamera) -> None:
    fewest, largest = numeric_texels_per_px(camera, 300)
    texels = texel_footprint(camera, equal_size_regions(camera, 300))
    assert texels.min_texels_per_px == pytest.approx(fewest.min(), rel=0.01)
    assert texels.max_texels_per_px == pytest.approx(largest.max(), rel=0.02)
    assert texels.median_texels_per_px == pytest.approx(
        np.median(np.sqrt(fewest * largest)), rel=0.02
    )
    assert texels.max_px >= 0.999 * (1.0 / fewest).max()
    assert texels.rms_px == pytest.approx(math.sqrt(np.square(1.0 / fewest).mean()), rel=0.02)


def test_texels_of_the_papers_mirror_are_those_of_the_reference() -> None:
    # Derived: about 365 for a 360 px image have one texel a pixel, and the middle of the
    # image has n / h; in the middle of a face a texel is 2 / n radians.
    texels = texel_footprint(CAMERA, equal_size_regions(CAMERA, 365))
    assert texels.min_texels_per_px == pytest.approx(1.0, rel=0.02)
    assert texels.max_texels_per_px > 365 / CAMERA.horizon_radius_px
    assert texels.max_rad == pytest.approx(2.0 / 365)


def test_twice_the_face_has_texels_of_half_the_size() -> None:
    one, two = (texel_footprint(CAMERA, equal_size_regions(CAMERA, size)) for size in (200, 400))
    assert two.max_px == pytest.approx(0.5 * one.max_px)
    assert two.median_texels_per_px == pytest.approx(2.0 * one.median_texels_per_px)


def test_regions_by_density_have_at_least_about_a_texel_a_pixel() -> None:
    texels = texel_footprint(CAMERA, regions_by_density(CAMERA, CAMERA.rim_rad, texels_per_px=1.0))
    # Along the columns and along the rows; aslant a little less.
    assert 0.7 < texels.min_texels_per_px <= 1.02


def test_coarse_regions_count_only_where_visible() -> None:
    # The upper half of each side face has a quarter of the rows.
    parts = equal_size_regions(CAMERA, 400)
    cut = tuple(
        piece
        for part in parts
        for piece in (
            (part,)
            if part.face is Face.C
            else (
                replace(part, window=replace(part.window, bottom=0.0), rows_per_unit=50.0),
                replace(part, window=replace(part.window, top=0.0)),
            )
        )
    )
    below = make_omni_camera(width_px=360, rim_deg=80.0)
    assert texel_footprint(below, cut) == texel_footprint(below, parts)
    assert texel_footprint(CAMERA, cut).max_px > 2.0 * texel_footprint(CAMERA, parts).max_px
