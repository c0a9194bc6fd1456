from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.frames.plan.error_bound import (
    PIXEL_CENTROID_ERROR_PX,
    SamplingError,
    sampling_error,
)
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.render_settings import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)


def make_sampling_error(
    kind: RendererKind, *, samples: int, face_size_px: int = 0
) -> SamplingError:
    settings = RenderSettings(PerPixel(), samples, face_size_px)
    return sampling_error(CAMERA, plan_from_settings(settings, CAMERA, kind=kind, reason="test"))


@pytest.mark.parametrize("samples", [1, 2, 4])
def test_edge_error_is_half_the_diagonal_of_a_sample(samples: int) -> None:
    assert make_sampling_error(RendererKind.TRACE, samples=samples).edge_error_px == pytest.approx(
        math.sqrt(0.5) / samples
    )


def test_trace_has_no_texel_footprint() -> None:
    error = make_sampling_error(RendererKind.TRACE, samples=1)
    assert error.texel_footprint is None
    assert error.minification == 0.0
    assert not error.is_undersampled


def test_coarse_samples_skip_texels_where_the_image_minifies() -> None:
    # Derived: n / h times at the centre, five times at n = 512.
    coarse = make_sampling_error(RendererKind.RASTER, samples=1, face_size_px=512)
    assert coarse.minification > 512 / CAMERA.horizon_radius_px > 4.9
    assert coarse.is_undersampled


def test_enough_samples_reach_every_texel() -> None:
    many = make_sampling_error(RendererKind.RASTER, samples=16, face_size_px=512)
    assert many.minification < 1.0
    assert not many.is_undersampled


def max_centroid_error_px(samples: int, radius_px: float, count: int) -> float:
    """Largest error of disc centroids, computed from the light of whole pixels."""
    rng = np.random.default_rng(7)
    reach = math.ceil(radius_px + 1.0)
    points = (np.arange(-reach * samples, (reach + 1) * samples) + 0.5) / samples
    pixels = np.floor(points) + 0.5
    worst = 0.0
    for u, v in rng.uniform(0.0, 1.0, (count, 2)):
        inside = np.hypot(points[:, None] - u, points[None, :] - v) < radius_px
        if inside.any():
            weight = inside / inside.sum()
            error = np.array(((weight.T @ pixels).sum() - u, (weight @ pixels).sum() - v))
            worst = max(worst, float(np.linalg.norm(error)))
    return worst


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 8])
def test_centroid_errors_of_discs_lie_between_half_the_bound_and_the_bound(samples: int) -> None:
    error = make_sampling_error(RendererKind.TRACE, samples=samples)
    worst = max(max_centroid_error_px(samples, 0.5 * size, 300) for size in (1.0, 1.3, 1.5, 3.0))
    assert worst <= error.centroid_error_px < 2.0 * worst


def test_centroid_errors_by_pixels_alone_lie_between_half_the_bound_and_the_bound() -> None:
    worst = max_centroid_error_px(24, 0.5, 300)
    assert worst <= PIXEL_CENTROID_ERROR_PX + math.sqrt(0.5) / 24
    assert PIXEL_CENTROID_ERROR_PX < 2.0 * worst
