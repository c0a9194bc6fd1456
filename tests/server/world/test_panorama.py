"""The sky by direction: maps of shared exponents, computed skies, Radiance HDR files."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world import sky
from catoptra_server.world.panorama import (
    MAX_RADIANCE,
    Panorama,
    load_panorama,
    make_panorama,
    solid_angles,
    texel_directions,
)
from catoptra_server.world.sky import SkyDescription, compute_sky, find_sky
from catoptra_server.world.world_description import DirectionalLight, HemisphereLight
from helpers.worlds import make_smooth_sky

GENERATOR = np.random.default_rng(20)
UP, DOWN, AHEAD, RIGHT = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def test_texels_keep_light_to_a_thousandth_of_the_brightest_colour() -> None:
    light = 10.0 ** GENERATOR.uniform(-3.0, 4.0, (64, 64, 1)) * GENERATOR.random((64, 64, 3))
    kept = make_panorama(light).decode()[1:-1, 1:-1]
    assert (np.abs(kept - light) / light.max(axis=-1, keepdims=True)).max() <= 0.5 / 256.0
    extremes = make_panorama(np.broadcast_to([0.0, 1e9, 1e-12], (2, 2, 3)).copy())
    assert extremes.largest == (0.0, MAX_RADIANCE, 0.0)


def test_directions_of_texels_have_their_light_and_edges_have_no_seam() -> None:
    light = GENERATOR.random((32, 32, 3))
    panorama = make_panorama(light)
    shown = panorama.radiance(texel_directions(32).reshape(-1, 3)).reshape(32, 32, 3)
    np.testing.assert_allclose(shown, light, atol=2e-3)
    # Below the horizon, beside the planes x = 0 and y = 0.
    slopes = np.linspace(0.01, 5.0, 200)
    for axis in (0, 1):
        beside = np.stack((np.ones(200), np.ones(200), slopes), axis=-1)
        beside[:, axis] = 1e-9
        across = beside * np.where(np.arange(3) == axis, -1.0, 1.0)
        np.testing.assert_allclose(panorama.radiance(beside), panorama.radiance(across), atol=1e-6)


def test_bounds_hold_in_every_direction_and_the_mean_is_by_solid_angle() -> None:
    panorama = make_smooth_sky(64)
    directions = GENERATOR.normal(size=(40000, 3))
    shown = panorama.radiance(directions)
    assert (shown >= panorama.least).all()
    assert (shown <= panorama.largest).all()
    np.testing.assert_allclose(shown.mean(axis=0), panorama.mean, rtol=0.02)
    assert solid_angles(33).sum() == pytest.approx(4.0 * math.pi, rel=1e-12)


NOON = SkyDescription(math.radians(50.0), math.radians(30.0))


def look(panorama: Panorama, *directions: tuple[float, float, float]) -> Floats:
    return panorama.radiance(np.array(directions))


def test_lights_of_a_sky_are_the_integrals_of_its_panorama() -> None:
    panorama, (sun, above, below) = compute_sky(NOON, 128)
    heights = -texel_directions(128) / np.linalg.norm(texel_directions(128), axis=-1)[..., None]
    light = panorama.decode()[1:-1, 1:-1] * (solid_angles(128) / math.pi)[..., None]
    light[panorama.decode()[1:-1, 1:-1].max(axis=-1) > 4.0] = 0.0  # the disc is the sun's
    for irradiance, sign in ((above, 1.0), (below, -1.0)):
        whole = (light * np.maximum(sign * heights[..., 2:], 0.0)).sum(axis=(0, 1))
        np.testing.assert_allclose(whole, irradiance, rtol=0.03)
    # A white level surface is near 1, more of it by the sun than by the sky.
    level = sun * math.sin(NOON.elevation_rad) + above
    assert 0.8 < level.mean() < 1.2
    assert (sun * math.sin(NOON.elevation_rad) > above).all()


def test_sky_has_the_colours_of_the_air() -> None:
    panorama, (noon, _, _) = compute_sky(NOON, 128)
    zenith, horizon, ground = look(panorama, UP, (-1.0, 0.0, -0.02), DOWN)
    assert zenith[2] > 1.5 * zenith[0]
    assert horizon.mean() > zenith.mean()
    assert 0.0 < ground.max() < 0.3
    _, (evening, _, _) = compute_sky(replace(NOON, elevation_rad=math.radians(4.0)), 128)
    assert evening[0] / evening[2] > 3.0 * noon[0] / noon[2]
    _, (hazy, _, _) = compute_sky(replace(NOON, turbidity=6.0), 128)
    assert (hazy < 0.7 * noon).all()
    for elevation in (0.0, 90.0):
        extreme, _ = compute_sky(replace(NOON, elevation_rad=math.radians(elevation)), 64)
        assert np.isfinite(extreme.decode()).all()


def test_disc_of_the_sun_is_where_the_light_comes_from() -> None:
    panorama, (sun, _, _) = compute_sky(NOON, 768)
    x, y, z = NOON.towards_sun.tolist()
    (disc,) = look(panorama, (x, y, z))
    assert 10.0 < disc.max() <= panorama.largest[0] <= sky.MAX_DISC + 5.0
    np.testing.assert_allclose(disc / disc.max(), sun / sun.max(), rtol=0.1)


def test_clouds_follow_their_seed_and_take_the_sun() -> None:
    clear, (sun, _, _) = compute_sky(NOON, 64)
    some = [compute_sky(replace(NOON, clouds=0.4, seed=seed), 64)[0] for seed in (0, 0, 1)]
    np.testing.assert_array_equal(some[0].texels, some[1].texels)
    assert (some[0].texels != some[2].texels).mean() > 0.05
    covered, (hidden, _, _) = compute_sky(replace(NOON, clouds=1.0), 64)
    assert (hidden < 0.2 * sun).all()
    zenith, cloud = look(clear, UP)[0], look(covered, UP)[0]
    assert zenith[2] / zenith[0] > 1.3 * cloud[2] / cloud[0]


def test_second_start_reads_the_sky(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(sky, "_SIZE", 64)
    first, lights = find_sky(NOON)
    monkeypatch.setattr(sky, "compute_sky", None)
    again, same_lights = find_sky(NOON)
    np.testing.assert_array_equal(again.texels, first.texels)
    assert lights == same_lights
    sun, hemisphere = lights
    assert isinstance(sun, DirectionalLight)
    assert isinstance(hemisphere, HemisphereLight)
    np.testing.assert_allclose(sun.direction, -NOON.towards_sun)
    with pytest.raises(TypeError):
        find_sky(replace(NOON, turbidity=3.0))


HEAD = b"#?RADIANCE\n# by hand\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n"


def write_hdr(path: Path, pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> Path:
    """File of (h, w, 4) pixels, in runs and literal bytes."""
    height, width = pixels.shape[:2]
    rows = b""
    for row in pixels.tolist():
        rows += bytes((2, 2, width >> 8, width & 255))
        for channel in zip(*row, strict=True):
            is_run = len(set(channel)) == 1
            parts = (128 + width, channel[0]) if is_run else (3, *channel[:3], width - 3)
            rows += bytes(parts if is_run else (*parts, *channel[3:]))
    path.write_bytes(HEAD + b"-Y %d +X %d\n" % (height, width) + rows)
    return path


@pytest.mark.parametrize("is_packed", [False, True])
def test_hdr_file_is_ahead_in_the_middle_and_up_at_the_top(tmp_path: Path, is_packed: bool) -> None:
    pixels = np.zeros((8, 16, 4), dtype=np.uint8)
    pixels[..., 3] = 129
    pixels[:, 7:9, 0] = 128  # ahead
    pixels[:, 11:13, 1] = 64  # to the right
    pixels[:2, :, 2] = 32
    path = write_hdr(tmp_path / "sky.hdr", pixels)
    if not is_packed:
        path.write_bytes(HEAD + b"-Y 8 +X 16\n" + pixels.tobytes())
    panorama = load_panorama(path)
    # 128 2^(129 - 136) is 1; an exposure of 2 has doubled the light.
    ahead, right, up, down = look(panorama, AHEAD, RIGHT, UP, DOWN)
    assert ahead.tolist() == [0.5, 0.0, 0.0]
    assert right.tolist() == [0.0, 0.25, 0.0]
    assert up[2] == 0.125
    assert down[2] == 0.0


def test_hdr_file_that_is_damaged_anywhere_is_rejected_or_finite(tmp_path: Path) -> None:
    pixels = GENERATOR.integers(0, 255, (6, 16, 4)).astype(np.uint8)
    content = write_hdr(tmp_path / "whole.hdr", pixels).read_bytes()
    damaged = [content[:length] for length in range(0, len(content), 7)]
    for _ in range(200):
        spoilt = bytearray(content)
        spoilt[GENERATOR.integers(len(content))] = GENERATOR.integers(256)
        damaged.append(bytes(spoilt))
    rejected = 0
    for number, one in enumerate(damaged):
        (path := tmp_path / f"{number}.hdr").write_bytes(one)
        try:
            assert np.isfinite(load_panorama(path).decode()).all()
        except DomainError:
            rejected += 1
    assert rejected > len(content) // 7
