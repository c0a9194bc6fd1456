from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.effects.mirror.mirror_holder import MirrorHolder, strut_coverage, tube_maps
from catoptra_server.render.image_changer import ExposedImage
from catoptra_server.render.trace.kernel.image import KernelImageChanger
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    assert_criterion,
    assert_effect_not_negligible,
    make_test_pattern,
)
from helpers.worlds import make_omni_camera

APERTURE = Aperture(4.0, 7.4e-6, 0.0)
TUBE = MirrorHolder(0, 0.05, 1.49, 0.004, 0.0, 0.1, APERTURE)
STRUTS = replace(TUBE, num_struts=3, azimuth_rad=0.4)
DIRECTIONS, ON_MIRROR = CAMERA.direction_from_pixel(pixel_sample_positions(CAMERA)[:, :, 0])


def trace_ghost(direction: Floats, radius_m: float) -> tuple[Floats, Floats, Floats]:
    """A camera's ray, backwards: where it meets a tube, how it goes on, and where it leaves."""
    first = direction * (radius_m / np.hypot(direction[0], direction[1]))
    normal = np.array((first[0], first[1], 0.0)) / radius_m
    reflected = direction - 2.0 * (direction @ normal) * normal
    # |first + s reflected| = radius about the axis, beside s = 0.
    a = reflected[:2] @ reflected[:2]
    s = -2.0 * (first[:2] @ reflected[:2]) / a
    return first, reflected, first + s * reflected


def meets_mirror(start: Floats, end: Floats) -> bool:
    """Whether a line comes below the mirror's surface, by steps."""
    t = np.linspace(0.0, CAMERA.rim_t, 2000)
    mirror_r, mirror_z = CAMERA.mirror.surface_point(t)
    points = start + np.linspace(0.0, 1.0, 3001)[:, None] * (end - start)
    r = np.hypot(points[:, 0], points[:, 1])
    within = r <= mirror_r[-1]
    heights = np.interp(r, mirror_r, mirror_z)
    return bool((points[within, 2] < heights[within]).any())


def test_acrylic_at_normal_incidence_reflects_as_two_surfaces() -> None:
    # (0.49 / 2.49)^2 = 3.8725 % by each; 2 r / (1 + r) by both.
    direct, ghost = TUBE._slab(np.array(1.0))
    assert float(direct) == pytest.approx(1.0 - 0.074563, abs=1e-6)
    assert float(ghost) == pytest.approx(0.074563 * (1.0 - 0.074563), abs=1e-6)


def test_slab_at_brewsters_angle_reflects_one_polarization_alone() -> None:
    cosine = math.cos(math.atan(1.49))
    single = ((1.49**2 - 1.0) / (1.49**2 + 1.0)) ** 2
    reflected = 2.0 * single / (1.0 + single)
    assert float(TUBE._slab(np.array(cosine))[0]) == pytest.approx(1.0 - 0.5 * reflected)


def test_no_light_is_gained_at_any_incidence() -> None:
    direct, ghost = TUBE._slab(np.linspace(0.0, 1.0, 500))
    assert (direct + ghost <= 1.0).all()
    assert float(direct[0]) == pytest.approx(0.0, abs=1e-12)


def test_ghost_is_where_traced_rays_pass_tube_and_mirror() -> None:
    direct, ghost = tube_maps(TUBE, CAMERA)
    height_m = CAMERA.mirror.pinhole_distance_m
    seen = 0
    for column in range(50, 96):
        direction = DIRECTIONS[48, column]
        if not ON_MIRROR[48, column]:
            assert ghost[48, column] == 0.0
            continue
        first, reflected, last = trace_ghost(direction, 0.05)
        np.testing.assert_allclose(reflected, direction * (-1.0, -1.0, 1.0), atol=1e-12)
        is_free = last[2] < height_m and not meets_mirror(first, last)
        assert (ghost[48, column] > 0.0) == is_free, column
        assert (direct[48, column] != 1.0) == (first[2] < height_m), column
        seen += is_free
    assert 5 < seen < 40, "the ghost has an inner and an outer end"


def test_bright_pixel_has_its_ghost_opposite() -> None:
    ghost = tube_maps(TUBE, CAMERA)[1]
    row, column = (int(one) for one in np.argwhere(ghost > 0.0)[17])
    image = np.zeros((96, 96, 3))
    image[95 - row, 95 - column] = (2.0, 1.0, 0.5)
    changed = TUBE.apply(image, CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_allclose(changed[row, column], ghost[row, column] * np.array((2, 1, 0.5)))
    changed[row, column] = changed[95 - row, 95 - column] = 0.0
    assert not changed.any()


def test_telescope_s_tube_has_no_end() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=100.0, width_px=97)
    direct, ghost = tube_maps(TUBE, camera)
    # Rays along the axis never meet the wall: the darkest light is the nearest to the axis.
    assert direct[48, 49] < 0.2
    assert ghost.max() > 0.05


def test_struts_cover_their_part_of_each_circle() -> None:
    camera = make_omni_camera(width_px=640)
    coverage = strut_coverage(STRUTS, camera)
    v, u = np.mgrid[:640, :640] + 0.5 - 320.0
    on_ring = (np.hypot(u, v) > 150.0) & (np.hypot(u, v) < 250.0)
    part = 3 * 2.0 * math.asin(0.002 / 0.05) / (2.0 * math.pi)
    assert coverage[on_ring].mean() == pytest.approx(part, rel=0.02)
    # Their azimuths in the mirror's frame.
    directions = camera.direction_from_pixel(pixel_sample_positions(camera)[:, :, 0])[0]
    azimuths = np.arctan2(directions[..., 1], directions[..., 0])[on_ring]
    mean = (coverage[on_ring] * np.exp(3j * azimuths)).sum()
    assert np.angle(mean) == pytest.approx(3 * 0.4 - 2.0 * math.pi * 0.0, abs=0.01)


def test_struts_end_at_the_camera() -> None:
    camera = make_omni_camera(width_px=640)
    end_rad = math.atan2(0.05, camera.mirror.pinhole_distance_m)
    directions = camera.direction_from_pixel(pixel_sample_positions(camera)[:, :, 0])[0]
    covered = strut_coverage(STRUTS, camera) > 0.05
    assert np.arccos(directions[covered][:, 2]).min() > end_rad - 0.05


def test_criterion_enables_what_shows() -> None:
    assert_criterion(
        off=[(replace(TUBE, refractive_index=1.0005), 1.0), (TUBE, 1e-4), (STRUTS, 1e-5)],
        on=[(TUBE, 1.0), (TUBE, 0.3), (STRUTS, 1.0)],
    )
    # Glass of a low index: the ghost is the smaller change.
    assert_effect_not_negligible(replace(TUBE, refractive_index=1.2))


@pytest.mark.parametrize("holder", [TUBE, STRUTS, replace(STRUTS, num_struts=1, albedo=0.9)])
def test_native_stage_agrees_with_the_formula(holder: MirrorHolder) -> None:
    changer = KernelImageChanger.open(2)
    image = make_test_pattern(2.0).astype(np.float32)
    native = changer.change(ExposedImage(image, CAMERA, CAPTURE_CONTEXT), (holder,), {}).image
    changer.close()
    expected = holder.apply(image.astype(np.float64), CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_allclose(native, expected, rtol=3e-6, atol=3e-6)
