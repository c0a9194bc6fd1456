"""Baked factors against brute force and the analytic corner, and each step of the baking alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.occlusion import surface_grids
from catoptra_server.render.trace.occlusion.baking import (
    RADIUS_M,
    bake_occlusion,
    filter_factors,
    occluder_weights,
)
from catoptra_server.render.trace.occlusion.surface_grids import frame_surfaces, lay_out
from catoptra_server.render.trace.ray_caster import commit_ray_caster, commit_to_reference
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shading import BLOCK, OPEN
from catoptra_server.world.shapes import facet_normals
from catoptra_server.world.world_description import (
    Box,
    Item,
    Material,
    Rectangle,
    SphereBand,
    World,
)
from helpers.standing_things import FLOOR, SKY, bake_scene, integrate_factor, make_box_world

GREY = Material((0.5, 0.5, 0.5))
SCENE = build_scene(make_box_world())
FRAMES = frame_surfaces(SCENE, threads=1)
LAYOUT = lay_out(FRAMES, 0.1)
# The mean of 32 rays a node, four sets mixed, interpolated between nodes 5 cm apart.
TOLERANCE = 0.03


def factors_on_floor(world: World, points: list[tuple[float, float]]) -> Floats:
    occlusion = bake_scene(world).occlusion
    assert occlusion is not None
    at = np.array([(x, y, 0.0) for x, y in points])
    # Both triangles of the floor are one surface.
    return occlusion.factors(np.zeros(len(at), dtype=int), at)[:, 0]


def test_factors_beside_a_box_equal_brute_force() -> None:
    points = [(0.3, 0.1), (0.33, 0.0), (0.4, 0.0), (0.5, 0.3), (0.0, -0.35), (-0.6, 0.0)]
    scene = build_scene(make_box_world())
    exact = [integrate_factor(scene, np.array([*p, 0.0]), np.array([0, 0, -1.0])) for p in points]
    assert min(exact) < 0.8
    assert max(exact) > 0.95
    np.testing.assert_allclose(factors_on_floor(make_box_world(), points), exact, atol=TOLERANCE)


def make_wall_world() -> World:
    """A floor before a wall that is infinite for all purposes: its face at x = 1."""
    wall = Item("wall", Box((0.2, 8.0, 4.0)), Pose.from_rpy((1.1, 0.0, -2.0)), GREY)
    return World("wall", (FLOOR, wall), lights=(SKY,))


def analytic_factor(distance_m: float, count: int = 1000) -> float:
    """Factor of a floor at a distance from an infinite wall, by the midpoint rule.

    With u = sin^2(theta), evenly distributed, a ray at an angle phi to the wall's normal meets it
    after distance / (sin(theta) cos(phi)).
    """
    across = (np.arange(count) + 0.5) / count
    u, phi = np.meshgrid(across, np.pi * (across - 0.5))
    weights = occluder_weights(distance_m / (np.sqrt(u) * np.cos(phi)))
    return float(1.0 - 0.5 * weights.mean())


def test_analytic_factor_at_the_foot_is_a_half() -> None:
    assert analytic_factor(0.0) == 0.5
    assert analytic_factor(RADIUS_M) == 1.0


# Nearer than a node's distance the filter flattens the last step to the foot.
@pytest.mark.parametrize(
    ("distance_m", "tolerance"),
    [
        (0.01, 0.08),
        (0.05, 0.03),
        (0.1, 0.03),
        (0.2, 0.02),
        (0.35, 0.002),
        (0.4, 0.01),
        (0.7, 0.005),
    ],
)
def test_factor_before_a_wall_is_the_analytic_one(distance_m: float, tolerance: float) -> None:
    factor = factors_on_floor(make_wall_world(), [(1.0 - distance_m, 0.0)])
    np.testing.assert_allclose(factor, analytic_factor(distance_m), atol=tolerance)


def test_open_floor_has_the_factor_one_exactly() -> None:
    far = 0.25 + RADIUS_M + 0.2
    factors = factors_on_floor(make_box_world(), [(far, 0.0), (3.0, 3.0), (-far, 1.0)])
    assert factors.tolist() == [1.0, 1.0, 1.0]


def test_floor_alone_needs_no_map() -> None:
    assert bake_scene(World("floor", (FLOOR,), lights=(SKY,))).occlusion is None


def test_marking_on_a_floor_occludes_nothing() -> None:
    line = Item("line", Rectangle((1, 0.05)), Pose.from_rpy((0, 0, -0.001)), GREY)
    assert bake_scene(World("line", (FLOOR, line), lights=(SKY,))).occlusion is None


def test_thing_that_casts_no_shadow_occludes_nothing() -> None:
    world = make_box_world()
    items = (world.items[0], replace(world.items[1], casts_shadows=False))
    scene = bake_scene(replace(world, items=items))
    assert scene.occlusion is not None  # the floor darkens the foot of the box
    assert (scene.occlusion.patch_of[:2] == -1).all()


def test_scene_without_casters_needs_no_map() -> None:
    world = World("floor", (replace(FLOOR, casts_shadows=False),), lights=(SKY,))
    assert bake_scene(world).occlusion is None


def test_unlit_facets_have_no_grid() -> None:
    world = make_box_world()
    glowing = replace(world.items[1], material=Material((1, 1, 1), unlit=True))
    scene = bake_scene(replace(world, items=(world.items[0], glowing)))
    assert scene.occlusion is not None
    assert (scene.occlusion.patch_of[scene.unlit] == -1).all()


def test_threads_give_the_same_bytes_and_casters_those_of_rays_off_edges() -> None:
    scene = build_scene(make_box_world())
    texels = []
    for caster in (commit_to_reference(scene), commit_ray_caster(scene)):
        one, two = (bake_occlusion(scene, caster, threads=n) for n in (1, 2))
        assert one is not None
        assert two is not None
        np.testing.assert_array_equal(one.texels, two.texels)
        texels.append(one.texels)
    # The kernel rounds to float32: nodes at the feet of the box's edges may be inside or not.
    assert (texels[0] != texels[1]).mean() < 0.01


def run_filter(
    values: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    inside: np.ndarray[tuple[int, int], np.dtype[np.bool_]] | None = None,
) -> list[list[int]]:
    """Bytes of a grid of factors that has another one beside it, without a gap."""
    rows, columns = values.shape
    both = np.ones(2, dtype=np.int32)
    layout = replace(
        LAYOUT,
        columns=columns * both,
        rows=rows * both,
        left=np.array([0, columns], dtype=np.int32),
        top=0 * both,
        width=2 * columns,
        height=rows,
        grid=np.repeat([[0, 1]], columns, axis=1).repeat(rows, axis=0).astype(np.int32),
    )
    inside = np.zeros(values.shape, dtype=bool) if inside is None else inside
    near = np.zeros((rows, 2 * columns), dtype=bool)
    near[:, :columns] = True
    texels = filter_factors(layout, near, values.reshape(-1), inside.reshape(-1))
    assert (texels[:, columns:] == OPEN).all()
    return texels[:, :columns].tolist()


def test_four_sets_of_rays_are_weighed_alike() -> None:
    pattern = np.tile([[0.2, 0.4], [0.6, 0.8]], (4, 4))
    texels = np.array(run_filter(pattern))
    assert (texels[1:-1, 1:-1] == round(0.5 * OPEN)).all()


def test_small_grid_is_left_as_it_is() -> None:
    assert run_filter(np.array([[0.0, 0.2], [0.4, 1.0]])) == [[0, 51], [102, 255]]


def test_nodes_inside_a_solid_take_their_neighbours_factors() -> None:
    values, inside = np.full((8, 8), 0.6), np.zeros((8, 8), dtype=bool)
    values[:, 4:], inside[:, 4:] = 0.0, True
    texels = np.array(run_filter(values, inside))
    assert (texels[:, :5] == round(0.6 * OPEN)).all()
    # Farther inside nobody looks: open, so that tiles there need no factors.
    assert (texels[:, 7] == OPEN).all()


def test_weight_falls_from_one_at_the_surface_to_zero_at_the_radius() -> None:
    distances = np.array([0.0, 0.5 * RADIUS_M, RADIUS_M, 2.0 * RADIUS_M, np.inf])
    assert occluder_weights(distances).tolist() == [1.0, 0.25, 0.0, 0.0, 0.0]


def test_every_corner_of_a_triangle_lies_in_its_surface_s_rectangle() -> None:
    assert len(FRAMES.origin) == 7  # the floor and six sides
    for corners, patch in zip(SCENE.corners, FRAMES.patch_of, strict=True):
        sides = np.stack((FRAMES.side_x[patch], FRAMES.side_y[patch]))
        at = (corners - FRAMES.origin[patch]) @ np.linalg.pinv(sides)
        assert (at > -1e-9).all()
        assert (at < 1.0 + 1e-9).all()
        np.testing.assert_allclose(at @ sides + FRAMES.origin[patch], corners, atol=1e-9)


def test_small_triangles_have_grids_between_their_corners(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(surface_grids, "_MAX_SURFACES", 0)
    frames = frame_surfaces(SCENE, threads=1)
    assert sorted(frames.patch_of.tolist()) == list(range(len(SCENE)))
    third = (frames.origin + frames.side_y)[frames.patch_of]
    np.testing.assert_allclose(third, SCENE.corners[:, 2], atol=1e-12)


def make_ball(rings: int) -> SceneMesh:
    """A ball of 160 triangles a ring, just above a floor."""
    shape = SphereBand(0.3, 0.0, np.radians(179.9), sectors=80, rings=rings)
    ball = Item("ball", shape, Pose.from_rpy((0.0, 0.0, -0.31)), GREY)
    scene = build_scene(World("ball", (FLOOR, ball), lights=(SKY,)))
    # A band is visible from inside.
    outward = np.concatenate((scene.corners[:2], scene.corners[2:, ::-1]))
    return replace(scene, corners=outward, normals=facet_normals(outward)[0])


def test_many_small_triangles_are_occluded_as_by_grids_of_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(surface_grids, "_MAX_SURFACES", 1)
    scene = make_ball(40)
    centres, factors = scene.corners.mean(axis=1), []
    for most in (8000, 400):
        monkeypatch.setattr(surface_grids, "_MAX_SMALL_GRIDS", most)
        occlusion = bake_occlusion(scene, commit_ray_caster(scene), threads=1)
        assert occlusion is not None
        factors.append(occlusion.factors(np.arange(len(scene)), centres)[:, 0])
    single, joined = factors
    # The floor darkens the lower half.
    assert single[2:].mean() < 0.9
    assert np.abs(joined - single)[2:].mean() < TOLERANCE
    below = np.flatnonzero((centres[:, 2] > -0.25) & (centres[:, 2] < -0.1) & (joined != single))
    for number in below[:: len(below) // 3]:
        exact = integrate_factor(scene, centres[number], scene.normals[number], count=30)
        assert joined[number] == pytest.approx(exact, abs=0.1)


def test_small_triangles_share_at_most_so_many_grids_and_lie_behind_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(surface_grids, "_MAX_SURFACES", 1)
    scene = make_ball(80)
    frames = frame_surfaces(scene, threads=1)
    small = np.flatnonzero(frames.patch_of >= surface_grids._MAX_SURFACES)
    assert len(small) > 8000
    assert 4000 <= len(np.unique(frames.patch_of[small])) <= 8000
    assert (frames.patch_of >= 0).all()
    patch = frames.patch_of[small]
    from_origin = scene.corners[small] - frames.origin[patch][:, None]
    assert np.einsum("tci,ti->tc", from_origin, frames.normal[patch]).max() < 1e-9


def test_scene_without_a_surface_needs_no_map() -> None:
    world = World("line", (replace(FLOOR, shape=Rectangle((1.0, 1e-200))),), lights=(SKY,))
    assert bake_scene(world).occlusion is None


@pytest.mark.parametrize("distance_m", [0.03, 0.2, 50.0])
def test_grids_share_no_block_of_the_atlas(distance_m: float) -> None:
    layout = lay_out(FRAMES, distance_m)
    used = np.zeros((layout.height, layout.width), dtype=int)
    for x, y, w, h in zip(layout.left, layout.top, layout.columns, layout.rows, strict=True):
        assert x % BLOCK == y % BLOCK == 0
        assert min(w, h) >= 2
        used[y : y + -(-h // BLOCK) * BLOCK, x : x + -(-w // BLOCK) * BLOCK] += 1
    assert used.max() == 1
    grid = layout.grid
    for number, (left, top, right, bottom) in enumerate(layout.bounds().tolist()):
        assert (grid[top : bottom + 1, left : right + 1] == number).all()


def test_nodes_are_at_most_as_far_apart_as_asked() -> None:
    layout = lay_out(FRAMES, 0.07)
    for sides, count in ((FRAMES.side_x, layout.columns), (FRAMES.side_y, layout.rows)):
        assert (np.linalg.norm(sides, axis=-1) / (count - 1)).max() <= 0.07 + 1e-9
