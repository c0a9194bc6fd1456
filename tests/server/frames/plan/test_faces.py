""""""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import (
    MIRROR_FROM_FACE_ROTATIONS,
    Face,
    face_coordinates,
    face_from_direction,
)
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_server.frames.plan.faces import face_regions, max_face_size_px, texel_footprint
from catoptra_server.render.renderer import FaceRegion, FaceWindow
from helpers.worlds import make_omni_camera, regions_of_size

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
    texels = texel_footprint(
        CAMERA, face_regions(CAMERA, CAMERA.rim_rad, size_px=0, texels_per_px=1.0)
    )
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


RIMS_DEG = (40.0, 60.0, 90.0, 91.0, 105.0, 120.0, 125.2, 130.0, 140.0, 150.0)


def directions_within(limit_deg: float) -> Floats:
    theta = np.radians(np.linspace(0.0, limit_deg, 181))
    gamma = np.radians(np.linspace(-180.0, 180.0, 361))
    theta, gamma = np.meshgrid(theta, gamma, indexing="ij")
    ring = np.sin(theta)
    grid = np.stack((ring * np.cos(gamma), ring * np.sin(gamma), np.cos(theta)), axis=-1)
    return grid.reshape(-1, 3)


def regions_of(camera: OmniCamera, texels_per_px: float = 1.0) -> tuple[FaceRegion, ...]:
    return face_regions(camera, camera.rim_rad, size_px=0, texels_per_px=texels_per_px)


def visible_windows(limit_deg: float) -> dict[Face, FaceWindow]:
    return {part.face: part.window for part in regions_of_size(math.radians(limit_deg), 2)}


@pytest.mark.parametrize("limit_deg", [30.0, 44.9, 45.1, 60.0, 89.0, 90.0, 91.0, 120.0, 125.2])
def test_windows_hold_every_direction_up_to_the_limit(limit_deg: float) -> None:
    directions = directions_within(limit_deg)
    face = face_from_direction(directions)
    st = face_coordinates(directions, face)
    windows = visible_windows(limit_deg)
    for index in np.unique(face):
        window = windows[Face(index)]
        s, t = st[face == index].T
        assert window.left - 1e-9 <= s.min()
        assert s.max() <= window.right + 1e-9
        assert window.top - 1e-9 <= t.min()
        assert t.max() <= window.bottom + 1e-9


@pytest.mark.parametrize("limit_deg", [30.0, 60.0, 100.0, 120.0, 125.2])
def test_windows_are_no_larger_than_the_visible_part(limit_deg: float) -> None:
    directions = directions_within(limit_deg)
    face = face_from_direction(directions)
    top = face_coordinates(directions, face)[face == Face.N][:, 1] if limit_deg > 45 else None
    window = visible_windows(limit_deg)[Face.N if top is not None else Face.C]
    expected = top.min() if top is not None else -math.tan(math.radians(limit_deg))
    assert window.top == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(
    ("rim_deg", "faces"), [(40, "C"), (46, "NESWC"), (125.26, "NESWC"), (125.27, "NESWCU")]
)
def test_only_visible_faces_have_a_region(rim_deg: float, faces: str) -> None:
    assert (
        "".join(part.face.name for part in regions_of(make_omni_camera(rim_deg=rim_deg))) == faces
    )


def texel_sides_px(camera: OmniCamera, region: FaceRegion) -> Floats:
    """Lengths in px of texels' sides, on a grid over the visible part of a region."""
    window = region.window
    grid = np.meshgrid(
        np.linspace(window.left, window.right, 97), np.linspace(window.top, window.bottom, 97)
    )
    points = np.stack(grid, axis=-1).reshape(-1, 2)
    lengths = []
    for step in ((0.5e-4, 0.0), (0.0, 0.5e-4)):
        pixels, seen = [], np.ones(len(points), dtype=bool)
        for side in (-1.0, 1.0):
            moved = np.column_stack((np.ones(len(points)), points + side * np.array(step)))
            pixel, inside = pixel_from_direction(
                camera, moved @ MIRROR_FROM_FACE_ROTATIONS[region.face].T
            )
            pixels.append(pixel)
            seen &= inside
        per_unit = np.linalg.norm(pixels[1] - pixels[0], axis=-1)[seen] / 1e-4
        density = region.columns_per_unit if step[0] else region.rows_per_unit
        lengths.append(float(per_unit.max()) / density)
    return np.array(lengths)


MIRRORS: list[tuple[Mirror, float]] = [
    *((PAPER_MIRROR, rim_deg) for rim_deg in RIMS_DEG),
    (HyperbolicMirror(3.0, 0.2), 105.0),
    (ParabolicMirror(0.03), 110.0),
]


@pytest.mark.parametrize(("mirror", "rim_deg"), MIRRORS)
@pytest.mark.parametrize("texels_per_px", [1.0, 1.7])
def test_no_texel_is_longer_than_its_fraction_of_a_pixel(
    mirror: Mirror, rim_deg: float, texels_per_px: float
) -> None:
    camera = make_omni_camera(mirror=mirror, width_px=640, rim_deg=rim_deg)
    for part in regions_of(camera, texels_per_px):
        longest = texels_per_px * texel_sides_px(camera, part)
        assert longest.max() <= 1.001
        # And no finer than it must be, but for whole texels a face.
        assert longest.min() > 0.97


def test_bottom_face_is_coarser_than_the_side_faces() -> None:
    camera = make_omni_camera(width_px=640)
    size = {part.face: 2.0 * part.columns_per_unit for part in regions_of(camera)}
    # At the centre a pixel is 2 / h radians, and a texel of the bottom 2 / n: n = h.
    assert size[Face.C] == pytest.approx(camera.horizon_radius_px, abs=1.0)
    assert size[Face.N] == pytest.approx(3.48 * size[Face.C], rel=0.01)
    assert {size[face] for face in (Face.E, Face.S, Face.W)} == {size[Face.N]}


def test_requested_size_applies_to_every_face() -> None:
    camera = make_omni_camera(rim_deg=130.0)
    parts = face_regions(camera, camera.rim_rad, size_px=500, texels_per_px=1.0)
    assert len(parts) == 6
    assert {(part.columns_per_unit, part.rows_per_unit) for part in parts} == {(250.0, 250.0)}
    assert max_face_size_px(parts) == 500


def test_regions_of_an_extreme_mirror_stay_within_limits() -> None:
    camera = make_omni_camera(mirror=HyperbolicMirror(2.001, 0.2), width_px=4096, rim_deg=85.0)
    parts = regions_of(camera)
    assert sum(part.num_texels for part in parts) <= 1.001 * 2**26
    assert max(max(part.size_texels) for part in parts) <= 1.001 * 2**13


def test_points_beyond_the_rim_have_the_density_of_the_rim() -> None:
    camera = make_omni_camera(mirror=HyperbolicMirror(2.1, 0.2), rim_deg=100.0)
    parts = face_regions(camera, math.radians(110.0), size_px=0, texels_per_px=1.0)
    assert all(math.isfinite(part.num_texels) for part in parts)
    assert regions_of_size(math.radians(110.0), 2)[0].window == parts[0].window
