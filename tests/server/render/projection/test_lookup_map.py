from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.frames.plan.faces import regions_of_size
from catoptra_server.render.projection.atlas import (
    OUTSIDE_MIRROR,
    Atlas,
    atlas_coordinates,
    compute_lookup_map,
    pack_atlas,
)
from helpers.worlds import make_omni_camera

# Off centre, not square, turned, cut by the image.
OFF_CENTRE = OmniCamera(HyperbolicMirror(11.546, 0.2), 90, 70, (41.3, 36.6), 24.0, 2.0, 0.4)


def pack_camera_atlas(camera: OmniCamera) -> Atlas:
    return pack_atlas(regions_of_size(camera.rim_rad, 128), guard_texels=2, max_texels=4096)


@pytest.mark.parametrize("samples", [1, 2, 3])
@pytest.mark.parametrize(
    "camera", [make_omni_camera(width_px=64), OFF_CENTRE], ids=["centred", "turned"]
)
def test_samples_stand_in_their_pixels_as_trace_has_them(camera: OmniCamera, samples: int) -> None:
    atlas = pack_camera_atlas(camera)
    pixels = pixel_sample_positions(camera, samples)
    directions, seen = direction_from_pixel(camera, pixels)
    expected = atlas.texels_from_direction(directions) / (atlas.width, atlas.height)
    expected[~seen] = OUTSIDE_MIRROR
    shape = (camera.height_px, camera.width_px, samples, samples, 2)
    grid = expected.reshape(shape).swapaxes(1, 2).reshape(shape[0] * samples, -1, 2)
    assert np.array_equal(compute_lookup_map(camera, atlas, samples), grid.astype(np.float32))


def test_only_samples_on_the_mirror_have_coordinates() -> None:
    camera = make_omni_camera(width_px=64)
    positions = compute_lookup_map(camera, pack_camera_atlas(camera), 2)
    _, seen = direction_from_pixel(camera, pixel_sample_positions(camera, 2))
    assert (positions[..., 0] >= 0.0).sum() == seen.sum()
    assert (positions <= 1.0).all()
    assert (positions[positions[..., 0] < 0.0] == OUTSIDE_MIRROR).all()


def test_axis_looks_at_the_centre_of_the_bottom() -> None:
    camera = make_omni_camera(width_px=64)
    atlas = pack_camera_atlas(camera)
    bottom = atlas.texel_transforms()[4, :2] / (atlas.width, atlas.height)
    place = atlas_coordinates(camera, atlas, np.array([camera.centre_px]))
    assert place[0] == pytest.approx(bottom, abs=1e-7)
