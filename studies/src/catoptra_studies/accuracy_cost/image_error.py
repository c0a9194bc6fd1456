"""How far a picture is from another: RMSE, PSNR and SSIM over the part that shows anything.

SSIM is that of Wang, Bovik, Sheikh & Simoncelli 2004 with their numbers: an 11 x 11 Gaussian window
of 1.5 px, K1 = 0.01, K2 = 0.03, on luma, here Rec. 601's; the mean is over the counted pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.renderer import Image

_PEAK = 255.0
_C1, _C2 = (0.01 * _PEAK) ** 2, (0.03 * _PEAK) ** 2
_WINDOW_PX, _SIGMA_PX = 11, 1.5
_LUMA = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True, slots=True)
class ImageError:
    """rmse: grey levels of 255, all channels alike. psnr_db: inf where nothing differs."""

    rmse: float
    psnr_db: float
    ssim: float


def compute_image_error(pairs: Sequence[tuple[Image, Image]], mask: Bools) -> ImageError:
    """Return the error of (picture, reference) pairs together, over (h, w) counted pixels."""
    squares = [np.mean(np.square(signed_difference(*pair))[mask]) for pair in pairs]
    rmse = math.sqrt(float(np.mean(squares)))
    ssim = float(np.mean([ssim_map(*pair)[mask].mean() for pair in pairs]))
    return ImageError(rmse, psnr_db(rmse), ssim)


def psnr_db(rmse: float) -> float:
    """Return the peak signal-to-noise ratio of an RMSE in grey levels."""
    return 20.0 * math.log10(_PEAK / rmse) if rmse > 0.0 else math.inf


def signed_difference(image: Image, reference: Image) -> Floats:
    """Return (h, w, 3) signed differences in grey levels."""
    return image.astype(np.float64) - reference


def ssim_map(image: Image, reference: Image) -> Floats:
    """Return (h, w) structural similarities, 1 where the neighbourhoods are the same."""
    x, y = image @ _LUMA, reference @ _LUMA
    mean_x, mean_y = _blur(x), _blur(y)
    variance_x = _blur(x * x) - mean_x**2
    variance_y = _blur(y * y) - mean_y**2
    covariance = _blur(x * y) - mean_x * mean_y
    brightness = (2.0 * mean_x * mean_y + _C1) / (mean_x**2 + mean_y**2 + _C1)
    structure = (2.0 * covariance + _C2) / (variance_x + variance_y + _C2)
    similar: Floats = brightness * structure
    return similar


def _blur(values: Floats) -> Floats:
    size = (_WINDOW_PX, _WINDOW_PX)
    blurred: Floats = cv2.GaussianBlur(values, size, _SIGMA_PX, borderType=cv2.BORDER_REFLECT_101)
    return blurred
