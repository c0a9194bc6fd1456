"""Textures at ever coarser levels, and which of them a sample sees: no texel is finer than samples.

Twins: render/trace/kernel/src/texture_levels.h, glsl/include/texture_levels.glsl.

A sample covers a part of a surface; steps to the two neighbouring samples, in texels, are its
footprint. Where these are longer than a texel, a look-up in the image itself picks single texels of
many: a distant pattern flickers. Each level halves the one before by the mean of what its texels
cover, so a look-up in the level of the footprint averages all of it, at the cost of two look-ups.

The footprint is an ellipse, a level's texel is a square. Seen at a grazing angle the ellipse is
long: the level of its longer axis would blur the texture across it, that of the shorter one would
leave it aliased. As a compromise the longer axis counts at most `MAX_STRETCH` times the shorter.
Source: Williams 1983 for levels, Igehy 1999 for steps on a surface, Heckbert 1989 for the ellipse.
"""

from __future__ import annotations

from typing import cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.shading import sample_texture
from catoptra_server.scene.texture_files import Texture

MAX_STRETCH = 3.0
"""Longer axis of a footprint over the shorter, beyond which it is not averaged any further.

Chosen in tests/measurements/texture_aliasing.py."""

Levels = tuple[npt.NDArray[np.float32], ...]
"""(h, w, 3) linear texels of the image, then of each coarser level, to one texel."""


def build_levels(image: Texture) -> Levels:
    """All levels of an image; each side is half the one before, rounded down, as in OpenGL."""
    # Float32: in float64 a texture of 4096 px would take 400 MB.
    levels = [linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)[image]]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(_halve_rows(_halve_rows(levels[-1]).swapaxes(0, 1)).swapaxes(0, 1))
    return tuple(np.ascontiguousarray(level) for level in levels)


def _halve_rows(texels: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Half as many rows of the same height together: means by the covered parts."""
    count = len(texels)
    half = count // 2
    if half == 0:
        return texels
    if count % 2 == 0:
        return 0.5 * (texels[0::2] + texels[1::2])
    # Row k of n covers 2 + 1/n old rows, from k (2 + 1/n) on: a part of the first, the second,
    # a part of the third.
    row = np.arange(half, dtype=np.float32)[:, None, None]
    parts = (half - row) * texels[0:-2:2] + half * texels[1:-1:2] + (row + 1.0) * texels[2::2]
    return np.asarray(parts / np.float32(count), dtype=np.float32)


def uv_gradients(corners: Floats, uv: Floats) -> Floats:
    """(n, 2, 3) change of texture coordinates a metre, in the planes of (n, 3, 3) triangles.

    Zero for a triangle without area.

    Args:
        corners: positions, metres.
        uv: (n, 3, 2) texture coordinates of the corners.
    """
    edges = corners[:, 1:] - corners[:, :1]
    # The dual of the two edges within their plane.
    gram = np.einsum("nai,nbi->nab", edges, edges)
    area = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    adjugate = np.stack((gram[:, 1, 1], -gram[:, 0, 1], -gram[:, 1, 0], gram[:, 0, 0]), axis=-1)
    inverse = adjugate.reshape(-1, 2, 2) / np.where(area > 0.0, area, 1.0)[:, None, None]
    dual = np.einsum("nab,nbi->nai", inverse, edges)
    gradient: Floats = np.einsum("nak,nai->nki", uv[:, 1:] - uv[:, :1], dual)
    return gradient


def uv_steps(
    gradients: Floats, normals: Floats, hits: Floats, directions: Floats, ray_steps: Floats
) -> Floats:
    """(n, 2, 2) texture coordinates from each sample to its two neighbours (second axis).

    Args:
        gradients: (n, 2, 3) of the coordinates, as `uv_gradients` returns.
        normals: (n, 3) of the surfaces, of any length but zero.
        hits: (n,) distances along the directions, metres.
        directions: (n, 3) unit directions of the rays.
        ray_steps: (n, 2, 3) from each direction to those of its neighbours.
    """
    # A ray beside this one meets the plane where it has gone further, or less far, by the slope.
    cosine = np.einsum("ni,ni->n", normals, directions)
    slopes = np.einsum("ni,nsi->ns", normals, ray_steps)
    # A ray within the plane has no footprint on it: the image itself is as good as any level.
    slopes = slopes / np.where(cosine == 0.0, np.inf, cosine)[:, None]
    on_plane = ray_steps - slopes[..., None] * directions[:, None]
    steps: Floats = hits[:, None, None] * np.einsum("nki,nsi->nsk", gradients, on_plane)
    return steps


def footprint_texels(steps: Floats, size: tuple[int, int]) -> Floats:
    """(n,) texels across the footprint of samples, of which one level's texel should be.

    Args:
        steps: (n, 2, 2) coordinates to the neighbouring samples, as `uv_steps` returns.
        size: (width, height) of the image.
    """
    texels = steps * np.asarray(size, dtype=np.float64)
    squares = np.square(texels).sum(axis=(-2, -1))
    area = np.abs(texels[:, 0, 0] * texels[:, 1, 1] - texels[:, 0, 1] * texels[:, 1, 0])
    # Longer axis squared, as the larger singular value: in this form nothing cancels.
    root = np.sqrt(np.maximum(squares - 2.0 * area, 0.0) * (squares + 2.0 * area))
    longer = np.sqrt(0.5 * (squares + root))
    # The shorter axis is the area over the longer one.
    limit = MAX_STRETCH * area / np.where(longer > 0.0, longer, 1.0)
    result: Floats = np.minimum(longer, limit)
    return result


def sample_levels(levels: Levels, uv: Floats, footprint: Floats) -> Floats:
    """(n, 3) linear colours at (n, 2) coordinates, averaged over (n,) footprints in texels.

    A footprint of up to one texel reads the image itself, as `sample_texture` does; one from 2^k to
    1.5 2^k texels level k alone, since that halves the look-ups. From there on the colour is linear
    in the footprint, up to level k + 1.
    """
    fraction, exponent = np.frexp(np.maximum(footprint, 1.0))
    level = np.minimum(exponent - 1, len(levels) - 1)
    weight = np.where(level < len(levels) - 1, np.maximum(4.0 * fraction - 3.0, 0.0), 0.0)[:, None]
    colours = np.zeros((len(uv), 3))
    for number, (fine, coarse) in enumerate(zip(levels, (*levels[1:], levels[-1]), strict=True)):
        rays = np.flatnonzero(level == number)
        # Float64 by its coordinates, whatever the texels are.
        one, other = (sample_texture(cast(Floats, each), uv[rays]) for each in (fine, coarse))
        colours[rays] = (1.0 - weight[rays]) * one + weight[rays] * other
    return colours
