"""RMSE, PSNR and SSIM of an image against a reference, over the pixels inside the mirror.

SSIM as in Wang, Bovik, Sheikh & Simoncelli 2004, with their constants: an 11 x 11 Gaussian window
of 1.5 px, K1 = 0.01, K2 = 0.03, on luma, here that of Rec. 601.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_studies.plot_style import Image

_PEAK = 255.0
# They keep both quotients of SSIM finite where an image is black or flat.
_C1, _C2 = (0.01 * _PEAK) ** 2, (0.03 * _PEAK) ** 2
_WINDOW_PX, _SIGMA_PX = 11, 1.5
_LUMA = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True, slots=True)
class ImageError:
    """Difference of images from their references."""

    rmse: float
    """Root mean square in grey levels of 255, all channels alike."""

    psnr_db: float
    """Peak signal-to-noise ratio; inf where no pixel differs."""

    ssim: float
    """Mean structural similarity; 1 where no pixel differs."""


def compute_image_error(pairs: Sequence[tuple[Image, Image]], mask: Bools) -> ImageError:
    """Error over several images together.

    Args:
        pairs: (image, reference) of equal shapes (h, w, 3).
        mask: (h, w) pixels that count.
    """
    # Squares are averaged before the root, so that four poses count like one large image.
    squares = [np.mean(np.square(signed_difference(*pair))[mask]) for pair in pairs]
    rmse = math.sqrt(float(np.mean(squares)))
    ssim = float(np.mean([ssim_map(*pair)[mask].mean() for pair in pairs]))
    return ImageError(rmse, psnr_db(rmse), ssim)


def psnr_db(rmse: float) -> float:
    """Peak signal-to-noise ratio of an RMSE in grey levels."""
    return 20.0 * math.log10(_PEAK / rmse) if rmse > 0.0 else math.inf


def signed_difference(image: Image, reference: Image) -> Floats:
    """(h, w, 3) differences in grey levels, positive where the image is brighter."""
    return image.astype(np.float64) - reference


def ssim_map(image: Image, reference: Image) -> Floats:
    """(h, w) structural similarity around each pixel."""
    # SSIM is defined for one channel.
    x, y = image @ _LUMA, reference @ _LUMA
    mean_x, mean_y = _blur(x), _blur(y)
    variance_x = _blur(x * x) - mean_x**2
    variance_y = _blur(y * y) - mean_y**2
    covariance = _blur(x * y) - mean_x * mean_y
    luminance = (2.0 * mean_x * mean_y + _C1) / (mean_x**2 + mean_y**2 + _C1)
    structure = (2.0 * covariance + _C2) / (variance_x + variance_y + _C2)
    similarity: Floats = luminance * structure
    return similarity


def _blur(values: Floats) -> Floats:
    size = (_WINDOW_PX, _WINDOW_PX)
    # Reflected borders, as the window has to be full in every pixel of the image.
    blurred: Floats = cv2.GaussianBlur(values, size, _SIGMA_PX, borderType=cv2.BORDER_REFLECT_101)
    return blurred
