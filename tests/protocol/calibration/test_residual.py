"""Residual between two models of a camera."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import PAPER, TUM_VI, TUM_VI_KB


def test_camera_has_no_residual_to_itself_turned_or_flipped() -> None:
    turned = replace(PAPER, image_up_azimuth_rad=0.7)
    for other in (PAPER, PAPER.with_picture(Picture.FLIPPED), turned):
        residual = compute_residual(PAPER, other)
        assert residual.max_px < 1e-10
        assert residual.fraction_missing < 1e-3


def test_displaced_centre_is_the_residual() -> None:
    u, v = PAPER.centre_px
    residual = compute_residual(PAPER, replace(PAPER, centre_px=(u + 0.3, v)))
    assert residual.max_px == pytest.approx(0.3)
    assert residual.rms_px == pytest.approx(0.3)
    assert 0.0 < residual.rms_deg < residual.max_deg


def test_two_published_models_of_one_lens_differ_by_what_is_known() -> None:
    centred = replace(TUM_VI_KB, centre_px=TUM_VI.centre_px)
    assert 0.5 < compute_residual(TUM_VI, centred).max_px < 2.0


def test_model_that_ends_earlier_misses_a_part() -> None:
    narrow = replace(PAPER, rim_rad=math.radians(90.0))
    residual = compute_residual(PAPER, narrow)
    # (h / rim)^2 of the disc is left.
    left = (PAPER.horizon_radius_px / PAPER.rim_radius_px) ** 2
    assert residual.fraction_missing == pytest.approx(1.0 - left, abs=0.01)
