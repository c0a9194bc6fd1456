"""Atlas positions in the mirror's shader against the float64 camera model."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_server.frames.plan.faces import face_regions
from catoptra_server.render.projection.atlas import (
    GUARD_TEXELS,
    Atlas,
    atlas_coordinates,
    pack_atlas,
)
from helpers.shaders import evaluate_shader
from helpers.worlds import make_omni_camera, regions_of_size

TOLERANCE_PX = 1e-3
MAX_TEXELS = 16384

# name, mirror, rim: below the asymptote, which is at 91.3 degrees for k = 2.001 and 102.6 for 2.1.
MIRRORS: list[tuple[str, Mirror, float]] = [
    ("a plane, nearly", HyperbolicMirror(2.001, 0.2), 80.0),
    ("strongly curved", HyperbolicMirror(2.1, 0.2), 100.0),
    ("curved", HyperbolicMirror(4.0, 0.2), 120.0),
    ("the paper's", PAPER_MIRROR, 120.0),
    ("the paper's, high rim", PAPER_MIRROR, 150.0),
    ("nearly parabolic", HyperbolicMirror(1e3, 0.2), 120.0),
    ("hardly hyperbolic", HyperbolicMirror(1e6, 0.2), 120.0),
    ("parabolic", ParabolicMirror(0.03), 135.0),
]
CASES = [pytest.param(mirror, rim, id=name) for name, mirror, rim in MIRRORS]


def atlas_by_density(camera: OmniCamera) -> Atlas:
    parts = face_regions(camera, camera.rim_rad, size_px=0, texels_per_px=1.0)
    return pack_atlas(parts, guard_texels=GUARD_TEXELS, max_texels=MAX_TEXELS)


def sample_directions(
    context: moderngl.Context, camera: OmniCamera, atlas: Atlas, pixels: Floats
) -> tuple[Floats, Bools]:
    """Directions (n, 3) of the positions that a shader samples, and a mask of those on the mirror.

    The rounding of a position by the sampler depends on the device: llvmpipe multiplies by the
    atlas size in float32, graphics cards resolve 256 steps per texel.
    """
    out = evaluate_shader(
        context,
        "lookup_map.frag",
        include=None,
        inputs=(atlas_coordinates(camera, atlas, pixels).astype(np.float64),),
    )
    return directions_of(atlas, out[:, :2] * (atlas.width, atlas.height)), out[:, 3] > 0.5


def directions_of(atlas: Atlas, texels: Floats) -> Floats:
    """(n, 3) directions, not unit, of (n, 2) texel positions; zero outside of cells."""
    directions = np.zeros((len(texels), 3))
    for cell in atlas.cells:
        low = np.array((cell.x, cell.y))
        inside = ((texels >= low) & (texels < low + np.array((cell.width, cell.height)))).all(
            axis=-1
        )
        place = np.array(cell.texel_transform)
        st = (texels[inside] - place[:2]) / place[2:]
        local = np.column_stack((np.ones(len(st)), st))
        directions[inside] = local @ MIRROR_FROM_FACE_ROTATIONS[cell.region.face].T
    return directions


def grid(camera: OmniCamera) -> Floats:
    """Some 60 000 pixel centres over the whole image, and the exact image centre."""
    step = max(1, camera.width_px // 240)
    along = np.arange(0, camera.width_px, step) + 0.5
    pixels = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    return np.concatenate((pixels, [camera.centre_px]))


def largest_error_px(context: moderngl.Context, camera: OmniCamera, atlas: Atlas) -> float:
    pixels = grid(camera)
    direction, valid = sample_directions(context, camera, atlas, pixels)
    back, inside = pixel_from_direction(camera, direction)
    both = valid & inside
    assert both.mean() > 0.7, "a disc fills more of its square"
    return float(np.linalg.norm(back - pixels, axis=-1)[both].max())


@pytest.mark.parametrize(("mirror", "rim_deg"), CASES)
@pytest.mark.parametrize("width_px", [360, 1024, 4096])
def test_lookup_over_the_image_returns_to_its_pixel(
    context: moderngl.Context, mirror: Mirror, rim_deg: float, width_px: int
) -> None:
    camera = make_omni_camera(mirror=mirror, width_px=width_px, rim_deg=rim_deg)
    assert largest_error_px(context, camera, atlas_by_density(camera)) < TOLERANCE_PX


def test_lookup_next_to_the_asymptote_of_nearly_a_plane_is_coarser(
    context: moderngl.Context,
) -> None:
    # A radian is 45 000 px there, and so is a face: more than float32 resolves to 1e-3.
    camera = make_omni_camera(mirror=HyperbolicMirror(2.001, 0.2), width_px=4096, rim_deg=90.0)
    assert largest_error_px(context, camera, atlas_by_density(camera)) < 2e-3


@pytest.mark.parametrize("face_size_px", [64, 512, 2048])
def test_lookup_on_faces_of_an_explicit_size_returns_to_its_pixel(
    context: moderngl.Context, face_size_px: int
) -> None:
    camera = make_omni_camera(width_px=1024)
    parts = regions_of_size(camera.rim_rad, face_size_px)
    atlas = pack_atlas(parts, guard_texels=GUARD_TEXELS, max_texels=MAX_TEXELS)
    assert largest_error_px(context, camera, atlas) < TOLERANCE_PX


@pytest.mark.parametrize(("mirror", "rim_deg"), CASES)
def test_samples_have_coordinates_exactly_where_the_camera_model_sees_the_mirror(
    context: moderngl.Context, mirror: Mirror, rim_deg: float
) -> None:
    camera = make_omni_camera(mirror=mirror, width_px=360, rim_deg=rim_deg)
    _, valid = sample_directions(context, camera, atlas_by_density(camera), grid(camera))
    _, expected = direction_from_pixel(camera, grid(camera))
    assert np.array_equal(valid, expected)


def test_direction_follows_the_azimuth_that_points_up(context: moderngl.Context) -> None:
    camera = OmniCamera(HyperbolicMirror(11.546, 0.2), 320, 200, (140.25, 96.5), 60.0, 1.9, 0.7)
    pixels = np.random.default_rng(2).uniform((0.0, 0.0), (320.0, 200.0), (5000, 2))
    direction, valid = sample_directions(context, camera, atlas_by_density(camera), pixels)
    expected, _ = direction_from_pixel(camera, pixels)
    unit = direction[valid] / np.linalg.norm(direction[valid], axis=-1, keepdims=True)
    # 2^-24 of an atlas of 700 texels, of 1 / 60 radians each where the image is coarsest.
    assert np.abs(unit - expected[valid]).max() < 2e-6
