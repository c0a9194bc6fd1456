"""How far a calibrated camera's pictures may be from its lens, by the calibration's own statement.

A file may state a covariance of parameters, `catoptra_covariance: NAMES | NUMBERS`: names as of
`derivatives.parameter_names`, and the rows of their covariance; as a field or in a comment. Of all
lenses that it allows, 95 % have no pixel farther from the picture's than the number stated: the
quantile of the largest displacement over a grid of pixels, to first order in the parameters.
Without a covariance `catoptra_rms_px` or OpenCV's `avg_reprojection_error`, an rms distance of
marks from their images, counts with the radius that holds 95 % of them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from catoptra_protocol.calibration.files import file_error
from catoptra_protocol.optics.derivatives import differentiate_direction, parameter_names
from catoptra_protocol.optics.elementary import hypot, matmul
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

_COVARIANCE = "catoptra_covariance"
_STATED = re.compile(rf'"?{_COVARIANCE}"?[ \t]*:[ \t]*"?([^"\n]*)')
_RMS = re.compile(r'"?(catoptra_rms_px|avg_reprojection_error)"?[ \t]*:[ \t]*"?([^"\s,}]*)')
# The 95 % radius of normal errors alike in u and v, over their rms distance: sqrt(ln 20).
_RADIUS_PER_RMS = 1.7308
_COVERAGE = 0.95
# A quantile of 4000 draws covers 95 % to 0.35 %; displacements are smooth over the image.
_NUM_DRAWS, _GRID_SIDE, _SEED = 4000, 17, 38


def state_model_error(camera: OmniCamera, text: str, file: str) -> OmniCamera:
    """The camera of a file with its `model_error_px`; unchanged if the file states none.

    Raises:
        ConfigError: A covariance that is not one, of unknown parameters, or no rms.
    """
    if (stated := _STATED.search(text)) is not None:
        root, columns = _read_root(camera, stated[1], file)
        return replace(camera, model_error_px=_largest_displacement_px(camera, root, columns))
    if (stated := _RMS.search(text)) is None:
        return camera
    rms_px = _number(stated[2])
    if not 0.0 <= rms_px < math.inf:
        raise file_error(file, stated[1], "pixels of 0 or more", value=stated[2])
    return replace(camera, model_error_px=_RADIUS_PER_RMS * rms_px)


def draw_camera(
    camera: OmniCamera, text: str, file: str, draw: Callable[[int], Floats]
) -> OmniCamera:
    """One of the cameras that the covariance of a camera's file allows.

    Args:
        camera: The camera as calibrated.
        text, file: The calibration file, and its name for errors.
        draw: Makes (n,) standard normal numbers.

    Raises:
        ConfigError: The file states no covariance, or a wrong one.
        DomainError: The parameters drawn are of no camera.
    """
    if (stated := _STATED.search(text)) is None:
        raise file_error(file, _COVARIANCE, "a covariance, to draw a camera from")
    root, columns = _read_root(camera, stated[1], file)
    moves = matmul(root, draw(len(columns))[:, None])[:, 0].tolist()
    names = parameter_names(camera)
    for column, move in zip(columns, moves, strict=True):
        camera = _displace(camera, names[column], move)
    return camera


def _displace(camera: OmniCamera, name: str, move: float) -> OmniCamera:
    """A camera with another value of a parameter of `parameter_names`."""
    if name.startswith("centre_"):
        u, v = camera.centre_px
        is_u = name == "centre_u_px"
        return replace(camera, centre_px=(u + move * is_u, v + move * (not is_u)))
    if hasattr(camera, name):
        return replace(camera, **{name: getattr(camera, name) + move})
    part = "plane" if name in ("p1", "p2") or name.startswith("stretch") else "projection"
    owner: Any = getattr(camera, part)
    stem, _, index = name.rpartition("_")
    if index.isdecimal() and isinstance(values := getattr(owner, stem, None), tuple):
        at = int(index)
        changed = replace(owner, **{stem: (*values[:at], values[at] + move, *values[at + 1 :])})
    else:
        changed = replace(owner, **{name: getattr(owner, name) + move})
    return replace(camera, **{part: changed})


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _read_root(camera: OmniCamera, stated: str, file: str) -> tuple[Floats, list[int]]:
    """Lower (n, n) root of a covariance, and the columns of its parameters in a Jacobian."""
    words, _, numbers = stated.partition("|")
    names, known = words.split(), parameter_names(camera)
    unknown = next((name for name in names if name not in known), None)
    if unknown is not None or len(set(names)) != len(names):
        expected = f"parameters of this camera, each once: {', '.join(known)}"
        raise file_error(file, _COVARIANCE, expected, value=unknown or words.strip())
    values = np.array([_number(word) for word in numbers.split()])
    if not names or len(values) != len(names) ** 2:
        expected = f"{len(names)} x {len(names)} numbers after |"
        raise file_error(file, _COVARIANCE, expected, value=f"{len(values)} numbers")
    root = _cholesky(values.reshape(len(names), len(names)))
    if root is None:
        raise file_error(file, _COVARIANCE, "a symmetric, positive covariance")
    return root, [known.index(name) for name in names]


def _cholesky(matrix: Floats) -> Floats | None:
    """Lower root of a symmetric positive matrix; None of others."""
    sizes = np.sqrt(np.abs(np.diagonal(matrix)))
    slack = 1e-9 * np.outer(sizes, sizes)
    if not np.isfinite(matrix).all() or (np.abs(matrix - matrix.T) > slack).any():
        return None
    root = np.zeros_like(matrix)
    for i in range(len(matrix)):
        for j in range(i + 1):
            left = float(matrix[i, j] - (root[i, :j] * root[j, :j]).sum())
            if i == j and not left > 0.0:
                return None
            root[i, j] = math.sqrt(left) if i == j else left / root[j, j]
    return root


def _largest_displacement_px(camera: OmniCamera, root: Floats, columns: list[int]) -> float:
    """Quantile of the largest displacement over the image, by a (n, n) root of a covariance."""
    u = np.linspace(0.0, camera.width_px, _GRID_SIDE)
    v = np.linspace(0.0, camera.height_px, _GRID_SIDE)
    directions, valid = camera.direction_from_pixel(np.stack(np.meshgrid(u, v), axis=-1))
    by_parameters = differentiate_direction(camera, directions[valid]).by_parameters
    draws = np.random.default_rng(_SEED).standard_normal((len(columns), _NUM_DRAWS))
    moved = matmul(matmul(by_parameters[..., columns], root), draws)
    largest = hypot(moved[:, 0], moved[:, 1]).max(axis=0, initial=0.0)
    return float(np.sort(largest)[round(_COVERAGE * _NUM_DRAWS)])
