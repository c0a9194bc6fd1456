"""Hard cases of tests/stability on the device, with float32 tolerances."""

from __future__ import annotations

import math

import moderngl
import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_server.render.projection.atlas import GUARD_TEXELS, Atlas, pack_atlas
from helpers.shaders import atlas_texels, evaluate_shader
from helpers.worlds import regions_of_size
from stability.catalogue import Case, load

# The encoding's roots are fitted to a thousandth of a grey level, and drivers' roots add to it.
ENCODING_TOLERANCE = 0.02 / 255.0
# Three float32 operations, a division, and drivers' own inverse root.
LAMP_TOLERANCE = 2e-5


def float32_values(group: str, formula: str) -> list[Case]:
    """Float32 cases of a formula that have a value, and are not denormal."""
    return [
        case
        for case in load(group)
        if (case.formula, case.float_type, case.expect) == (formula, "float32", "value")
    ]


def test_encoding_when_at_the_ends_of_the_curve_is_that_of_50_digits(
    context: moderngl.Context,
) -> None:
    cases = float32_values("light", "srgb_from_linear")
    assert len(cases) >= 9
    inputs = np.repeat([[case.inputs["linear"]] for case in cases], 3, axis=1)
    shown = evaluate_shader(
        context, "srgb_from_linear.frag", include="include/colour.glsl", inputs=(inputs,)
    )
    expected = np.array([float(case.reference) for case in cases])
    assert np.abs(shown[:, 0] - expected).max() < ENCODING_TOLERANCE


def test_encoding_over_every_half_float_never_falls_and_ends_at_0_and_1(
    context: moderngl.Context,
) -> None:
    # What the passes store: every half float from 0 to 1, 15361 of them.
    halves = np.arange(0x3C01, dtype=np.uint16).view(np.float16).astype(np.float64)
    inputs = np.repeat(halves[:, None], 3, axis=1)
    shown = evaluate_shader(
        context, "srgb_from_linear.frag", include="include/colour.glsl", inputs=(inputs,)
    )[:, 0]
    assert shown[0] == 0.0
    assert shown[-1] == pytest.approx(1.0, abs=5e-6)  # of the fit
    # The two branches meet within the fit; the target has 8 bits.
    assert np.diff(shown).min() > -ENCODING_TOLERANCE
    assert (np.diff(np.rint(255.0 * shown)) >= 0).all()


def test_point_light_when_near_and_far_is_that_of_50_digits(context: moderngl.Context) -> None:
    cases = float32_values("light", "point_irradiance")
    assert len(cases) >= 4
    heights = np.array([case.inputs["height_m"] for case in cases])
    # The light is at the viewpoint, floors below, z down.
    places = np.stack((np.zeros_like(heights), np.zeros_like(heights), heights), axis=-1)
    normals = np.tile([0.0, 0.0, -1.0], (len(heights), 1))
    shown = evaluate_shader(
        context,
        "point_irradiance.frag",
        include="include/point_irradiance.glsl",
        inputs=(places, normals),
        uniforms={"light_positions": [(0.0, 0.0, 0.0)], "light_intensities": [(1.0, 1.0, 1.0)]},
        define=(("NUM_POINT_LIGHTS", 1),),
    )
    expected = np.array([float(case.reference) for case in cases])
    np.testing.assert_allclose(shown[:, 0], expected, rtol=LAMP_TOLERANCE)


def face_at_texel(atlas: Atlas, texel: np.ndarray) -> int:
    """Face whose cell contains a texel position."""
    inside = [
        cell.region.face
        for cell in atlas.cells
        if cell.x <= texel[0] <= cell.x + cell.width and cell.y <= texel[1] <= cell.y + cell.height
    ]
    assert len(inside) == 1
    return int(inside[0])


def test_face_when_on_an_edge_or_a_corner_is_that_of_the_catalogue(
    context: moderngl.Context,
) -> None:
    atlas = pack_atlas(
        regions_of_size(math.pi - 1e-3, 128), guard_texels=GUARD_TEXELS, max_texels=4096
    )
    cases = [
        case
        for case in float32_values("cube", "face_from_direction")
        if any(case.inputs["direction"])
    ]
    assert len(cases) >= 20
    directions = np.array([case.inputs["direction"] for case in cases])
    texels = atlas_texels(context, atlas, directions)
    faces = [face_at_texel(atlas, texel) for texel in texels]
    assert faces == [int(float(case.reference)) for case in cases]


def test_face_of_the_zero_vector_is_n_and_finite(context: moderngl.Context) -> None:
    atlas = pack_atlas(
        regions_of_size(math.pi - 1e-3, 128), guard_texels=GUARD_TEXELS, max_texels=4096
    )
    (texel,) = atlas_texels(context, atlas, np.zeros((1, 3)))
    assert texel == pytest.approx(atlas.texel_transforms()[Face.N][:2], abs=1e-3)


def test_coordinates_over_a_dense_grid_of_directions_are_the_twins(
    context: moderngl.Context,
) -> None:
    atlas = pack_atlas(
        regions_of_size(math.pi - 1e-3, 512), guard_texels=GUARD_TEXELS, max_texels=4096
    )
    theta, gamma = np.meshgrid(np.linspace(0, math.pi, 361), np.linspace(-math.pi, math.pi, 721))
    ring = np.sin(theta)
    grid = np.stack((ring * np.cos(gamma), ring * np.sin(gamma), np.cos(theta)), axis=-1)
    directions = grid.reshape(-1, 3).astype(np.float32).astype(np.float64)
    difference = atlas_texels(context, atlas, directions) - atlas.texels_from_direction(directions)
    # Places in an atlas of some 2000 texels, an ulp of which is 1.2e-4; three operations.
    assert np.abs(difference).max() < 1e-3
