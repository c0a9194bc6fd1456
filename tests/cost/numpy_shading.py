"""Shading of embreex's hits in NumPy: a table of colours, or bilinear texels in linear light."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world import shading
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import World, linear_from_srgb, srgb_from_linear

Float32s = npt.NDArray[np.float32]
Int32s = npt.NDArray[np.int32]
Bytes = npt.NDArray[np.uint8]

_TOP = 2**16 - 1  # levels of the table of encoded greys
_RGB = np.dtype("V3")


class RayShading(Protocol):
    """Rays in, colours of pixels out."""

    def shade(
        self, origins: Float32s, directions: Float32s, off_mirror: npt.NDArray[np.intp]
    ) -> Bytes:
        """(p, 3) sRGB of the (p * samples, 3) rays of pixels; rays off the mirror are black."""


class ColourTable:
    """Light that is constant over each triangle."""

    def __init__(
        self, scene: SceneMesh, world: World, embree: rtcore_scene.EmbreeScene, samples: int
    ) -> None:
        """Tabulate the colour and the radiance of each triangle, the background's last."""
        self._embree, self._samples = embree, samples
        self._radiance = radiance_table(scene, world)
        rgb = np.ascontiguousarray(encode(self._radiance).T)
        self._colours = rgb.view(_RGB).reshape(-1)
        self._grey = grey_table()

    def shade(
        self, origins: Float32s, directions: Float32s, off_mirror: npt.NDArray[np.intp]
    ) -> Bytes:
        """(p, 3) sRGB: one look-up a pixel, or the mean of its samples."""
        triangle = self._embree.run(origins, directions)
        if self._samples == 1:
            # Index -1, no hit, wraps to the background.
            pixels = self._colours.take(triangle, mode="wrap")
            rgb: Bytes = pixels.view(np.uint8).reshape(-1, 3)
            return rgb
        light = self._radiance.take(triangle, axis=1, mode="wrap")
        light[:, off_mirror] = 0.0
        return encode_samples(light, self._samples, self._grey)


class TexturedShading:
    """Textures times light that is constant over each triangle."""

    def __init__(
        self, scene: SceneMesh, world: World, embree: rtcore_scene.EmbreeScene, samples: int
    ) -> None:
        """Lay all textures out behind each other; triangles without have one white texel."""
        self._embree, self._samples = embree, samples
        self._radiance = radiance_table(scene, world)
        # Textures alone need no product: the usual case of a room that is shown as it was painted.
        self._is_tinted = bool((self._radiance[:, :-1] != 1.0).any())
        self._uv = uv_frames(scene)
        self._texels, self._first, self._width, self._height = lay_out_textures(scene)
        self._grey = grey_table()

    def shade(
        self, origins: Float32s, directions: Float32s, off_mirror: npt.NDArray[np.intp]
    ) -> Bytes:
        """(p, 3) sRGB of bilinear texels."""
        hit = self._embree.run(origins, directions, output=True)
        triangle = hit["primID"]
        light = self._sample_textures(triangle, hit["u"], hit["v"])
        if self._is_tinted:
            light *= self._radiance.take(triangle, axis=1, mode="wrap")
        else:
            light[:, triangle < 0] = self._radiance[:, -1:]
        light[:, off_mirror] = 0.0
        return encode_samples(light, self._samples, self._grey)

    def _sample_textures(self, triangle: Int32s, u: Float32s, v: Float32s) -> Float32s:
        """(3, n) texels at barycentric coordinates (u, v)."""
        a, b, au, bu, av, bv = self._uv.take(triangle, axis=1, mode="wrap")
        width, height = (look_up(size, triangle) for size in (self._width, self._height))
        column, fx = texel_and_fraction(a + u * au + v * av, width)
        row, fy = texel_and_fraction(b + u * bu + v * bv, height)
        stride = width.astype(np.int32) + 2
        upper = row * stride + column + self._first.take(triangle, mode="wrap")
        lower = upper + stride
        out = np.empty((3, len(triangle)), dtype=np.float32)
        # A channel at a time and in place: half the time of rows of three, measured.
        for channel, texels in enumerate(self._texels):
            top = interpolate(texels, upper, fx)
            bottom = interpolate(texels, lower, fx)
            bottom -= top
            bottom *= fy
            np.add(top, bottom, out=out[channel])
        return out


def interpolate(texels: Float32s, left: Int32s, fraction: Float32s) -> Float32s:
    """(n,) values between texels and their right neighbours."""
    value = texels.take(left, mode="clip")
    right = texels.take(left + 1, mode="clip")
    right -= value
    right *= fraction
    value += right
    return value


def look_up(size: Float32s, triangle: Int32s) -> Float32s:
    """Size of each ray's texture; one number where all textures have the same."""
    return size.take(triangle, mode="wrap") if len(size) > 1 else size


def texel_and_fraction(coordinate: Float32s, size: Float32s) -> tuple[Int32s, Float32s]:
    """Column or row in a texture with a border of one texel, and the fraction beyond it."""
    position = (coordinate - np.floor(coordinate)) * size
    position += np.float32(0.5)
    texel = position.astype(np.int32)
    position -= texel
    return texel, position


def radiance_table(scene: SceneMesh, world: World) -> Float32s:
    """(3, n + 1) linear radiance of each triangle, the background's last."""
    radiance = np.concatenate([shading.facet_radiance(scene, world.lights), [world.background]])
    return np.ascontiguousarray(radiance.T, dtype=np.float32)


def uv_frames(scene: SceneMesh) -> Float32s:
    """(6, n + 1) texture coordinates of a corner and of two edges of each triangle."""
    a, b, c = np.moveaxis(scene.uv, 1, 0)
    frames = np.concatenate((a, b - a, c - a), axis=-1)
    return np.ascontiguousarray(np.vstack([frames, np.zeros(6)]).T, dtype=np.float32)


def lay_out_textures(scene: SceneMesh) -> tuple[Float32s, Int32s, Float32s, Float32s]:
    """(3, k) linear texels of all textures, each with a border; the last is white.

    Returns:
        The texels; and for each of n + 1 triangles its texture's first texel, width and height:
        one number where all textures have the same size.
    """
    linear = linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)
    images = [*scene.textures, np.full_like(scene.textures[0], 255)]
    padded = [np.pad(linear[image], ((1, 1), (1, 1), (0, 0)), mode="wrap") for image in images]
    starts = np.cumsum([0, *(image[..., 0].size for image in padded)])[:-1]
    # Index -1, no texture or no hit, wraps to the white texture.
    of_triangle = np.append(scene.texture_index, -1)
    sizes = np.array([image.shape[:2] for image in images], dtype=np.float32)
    texels = np.ascontiguousarray(np.concatenate([p.reshape(-1, 3) for p in padded]).T)
    if (sizes == sizes[0]).all():
        height, width = sizes[:1].T.copy()
    else:
        height, width = sizes[of_triangle].T.copy()
    return texels, starts[of_triangle].astype(np.int32), width, height


def encode_samples(light: Float32s, samples: int, grey: Bytes) -> Bytes:
    """(p, 3) sRGB of the means of (3, p * samples) radiance, which is scaled in place."""
    if samples > 1:
        light = sum_samples(light, samples)
    light *= np.float32(_TOP / samples)
    light += np.float32(0.5)
    rgb = np.empty((light.shape[1], 3), dtype=np.uint8)
    for channel, levels in enumerate(light):
        # "clip" also limits light above white, as on a sensor.
        rgb[:, channel] = grey.take(levels.astype(np.int32), mode="clip")
    return rgb


def sum_samples(light: Float32s, samples: int) -> Float32s:
    """(3, p) sums of (3, p * samples) values."""
    total = light[:, 0::samples].copy()
    for offset in range(1, samples):
        total += light[:, offset::samples]
    return total


def grey_table() -> Bytes:
    """(2^16,) encoded greys of linear light."""
    return encode(np.arange(_TOP + 1) / _TOP)


def encode(linear: Floats | Float32s) -> Bytes:
    """uint8 sRGB of linear light."""
    return np.rint(255.0 * srgb_from_linear(np.asarray(linear, dtype=np.float64))).astype(np.uint8)
