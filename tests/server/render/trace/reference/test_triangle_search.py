"""First hits in float64: against exact arithmetic, and without leaks at edges and corners."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.reference.triangle_search import TriangleSearch

NUM_RAYS = 100_000

# Two triangles: a large one 3 m ahead, a small one 2 m ahead beside the axis.
CORNERS = np.array(
    [
        [(3.0, -1.0, -1.0), (3.0, 3.0, -1.0), (3.0, -1.0, 3.0)],
        [(2.0, 0.5, 0.5), (2.0, 0.7, 0.5), (2.0, 0.5, 0.7)],
    ]
)
AHEAD, ASIDE, BEHIND = (1.0, 0.0, 0.0), (1.0, 0.28, 0.28), (-1.0, 0.0, 0.0)


@pytest.fixture(autouse=True)
def _raise_on_floating_point_errors() -> Iterator[None]:
    with np.errstate(all="raise"):
        yield


def test_first_hits_have_distance_triangle_and_weights() -> None:
    directions = np.array([AHEAD, ASIDE, BEHIND])
    distance, triangle, weights = TriangleSearch(CORNERS).first_hits(np.zeros((3, 3)), directions)
    assert triangle.tolist() == [0, 1, -1]
    np.testing.assert_allclose(distance, (3.0, 2.0, np.inf), rtol=1e-14)
    np.testing.assert_allclose(weights, ((0.25, 0.25), (0.3, 0.3), (0.0, 0.0)))


def test_distance_is_counted_in_lengths_of_the_direction() -> None:
    directions = np.outer((0.5, 1e-200, 1e200), AHEAD)
    distance, *_ = TriangleSearch(CORNERS).first_hits(np.zeros((3, 3)), directions)
    np.testing.assert_allclose(distance, (6.0, 3e200, 3e-200), rtol=1e-14)


def test_hits_end_before_the_greatest_distance() -> None:
    search, origins = TriangleSearch(CORNERS), np.zeros((4, 3))
    limits, directions = np.array((2.9, 3.0, 3.1, np.inf)), np.tile(AHEAD, (4, 1))
    expected = [False, False, True, True]
    assert search.occludes(origins, directions, limits).tolist() == expected
    found = search.first_hits(origins, directions, limits)[0]
    assert np.isfinite(found).tolist() == expected
    assert limits.tolist() == [2.9, 3.0, 3.1, np.inf], "limits of the caller are kept"


def _exact_hit(
    corners: list[list[Fraction]], origin: list[int], direction: list[int]
) -> tuple[Fraction, bool] | None:
    """Exact distance of a triangle's plane along a ray, and whether an edge is met; None beside."""
    a, b, c = corners
    edge1, edge2 = ([q - p for p, q in zip(a, other, strict=True)] for other in (b, c))
    start = [o - p for o, p in zip(origin, a, strict=True)]

    def cross(p: list[Fraction], q: list[Fraction]) -> list[Fraction]:
        return [p[i - 2] * q[i - 1] - p[i - 1] * q[i - 2] for i in range(3)]

    def dot(p: list[Fraction], q: list[Fraction]) -> Fraction:
        return sum((x * y for x, y in zip(p, q, strict=True)), Fraction(0))

    way = [Fraction(d) for d in direction]
    determinant = dot(edge1, cross(way, edge2))
    if not determinant:
        return None
    weight1 = dot(start, cross(way, edge2)) / determinant
    weight2 = dot(way, cross(start, edge1)) / determinant
    distance = dot(edge2, cross(start, edge1)) / determinant
    weights = (weight1, weight2, 1 - weight1 - weight2)
    if min(weights) < 0 or distance <= 0:
        return None
    return distance, min(weights) == 0


def test_first_hits_are_those_of_exact_arithmetic() -> None:
    rng = np.random.default_rng(1)
    # Few integers: many triangles are degenerate, in one plane or along a ray, and many hits equal.
    corners = rng.integers(-3, 4, (60, 3, 3))
    rays = rng.integers(-4, 5, (2, 300, 3))
    distance, triangle, _ = TriangleSearch(corners.astype(float)).first_hits(*rays.astype(float))
    exact = [[[Fraction(int(x)) for x in corner] for corner in each] for each in corners]
    compared = 0
    for ray, (origin, direction) in enumerate(zip(*rays.tolist(), strict=True)):
        hits = [_exact_hit(each, origin, direction) for each in exact]
        # Rounding decides whether an edge that no other triangle shares is met.
        if any(hit is not None and hit[1] for hit in hits):
            continue
        compared += 1
        met = [(hit[0], number) for number, hit in enumerate(hits) if hit is not None]
        expected, number = min(met, default=(np.inf, -1))
        assert distance[ray] == pytest.approx(float(expected), rel=1e-13, abs=1e-13)
        # Rounded distances of different planes that cross where the ray does may differ.
        equal = {number, *(other for at, other in met if at == expected)}
        assert triangle[ray] in equal
    assert compared > 100


def test_first_hits_of_many_triangles_are_those_of_all_tested() -> None:
    rng = np.random.default_rng(2)
    corners = rng.uniform(-5.0, 5.0, (3000, 1, 3)) + 0.3 * rng.normal(size=(3000, 3, 3))
    origins, directions = rng.normal(size=(2, 500, 3))
    distance, triangle, weights = TriangleSearch(corners).first_hits(origins, directions)
    first, edges = corners[:, 0], corners[:, 1:] - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    # The point in each triangle's plane, and its weights there.
    along = directions @ normals.T
    at = (np.einsum("ti,ti->t", first, normals) - origins @ normals.T) / along
    points = origins[:, None] + at[..., None] * directions[:, None] - first
    planes = np.linalg.pinv(edges)
    found = np.einsum("rti,tij->rtj", points, planes)
    is_met = (found.min(axis=2) >= 0.0) & (found.sum(axis=2) <= 1.0) & (at > 0.0)
    expected = np.where(is_met, at, np.inf)
    nearest = expected.argmin(axis=1)
    np.testing.assert_array_equal(triangle, np.where(is_met.any(axis=1), nearest, -1))
    np.testing.assert_allclose(distance, expected.min(axis=1), rtol=1e-10)
    hits = np.flatnonzero(triangle >= 0)
    np.testing.assert_allclose(weights[hits], found[hits, nearest[hits]], atol=1e-9)
    assert 100 < len(hits) < 500


def make_ball(radius_m: float = 1.0) -> Floats:
    """Triangles of a closed surface around the origin: cubes' faces, swollen to a sphere."""
    steps = np.linspace(-1.0, 1.0, 9)
    u, v = (axis.reshape(-1) for axis in np.meshgrid(steps[:-1], steps[:-1], indexing="ij"))
    step = steps[1] - steps[0]
    squares = [(u, v), (u + step, v), (u + step, v + step), (u, v + step)]
    faces = []
    for axis, side in product(range(3), (-1.0, 1.0)):
        corners = [np.roll(np.stack((np.full(u.shape, side), *uv)), axis, axis=0) for uv in squares]
        faces += [[corners[i] for i in (0, 1, 2)], [corners[i] for i in (0, 2, 3)]]
    found = np.concatenate([np.array(face).transpose(2, 0, 1) for face in faces])
    # Rounded first, so that corners are shared to the last bit.
    found = np.round(found * 8.0) / 8.0
    return radius_m * found / np.linalg.norm(found, axis=-1, keepdims=True)


def edge_points(corners: Floats, rng: np.random.Generator) -> Floats:
    """(n, 3) corners, and points of edges."""
    rows = rng.integers(len(corners), size=NUM_RAYS)
    number = rng.integers(3, size=NUM_RAYS)
    one, other = corners[rows, number], corners[rows, (number + 1) % 3]
    fraction = rng.choice((0.0, 0.5, 1.0, rng.uniform()), (NUM_RAYS, 1))
    return one + fraction * (other - one)


@pytest.mark.parametrize("centre_m", [0.0, 1e3, 1e6])
@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_no_ray_slips_out_of_a_ball_through_edges_or_corners(
    centre_m: float, spread: float
) -> None:
    rng = np.random.default_rng(3)
    corners = make_ball() + centre_m * np.array((1.0, -0.7, 0.3))
    origins = np.tile(corners.mean(axis=(0, 1)), (NUM_RAYS, 1))
    origins += spread * rng.uniform(-1.0, 1.0, origins.shape)
    directions = edge_points(corners, rng) - origins
    assert (TriangleSearch(corners).first_hits(origins, directions)[1] >= 0).all()


@pytest.mark.parametrize("distance_m", [0.1, 10.0, 1e6])
def test_no_ray_slips_through_a_surface_from_afar(distance_m: float) -> None:
    rng = np.random.default_rng(4)
    corners = make_ball()
    points = edge_points(corners, rng)
    # From outside, at up to 80 degrees from the surface's normal.
    directions = rng.normal(size=points.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    steep = np.einsum("ni,ni->n", directions, points)
    directions = (directions * np.sign(steep)[:, None])[np.abs(steep) > 0.17]
    origins = points[np.abs(steep) > 0.17] + distance_m * directions
    found = TriangleSearch(corners).first_hits(origins, -directions)
    assert (found[1] >= 0).all()
    # A ray from 1e6 m has steps of 1e-10 m, 6 times as much along the surface.
    np.testing.assert_allclose(found[0], distance_m, rtol=1e-14, atol=0.05)


def test_rays_along_axes_meet_edges_corners_and_borders_of_boxes() -> None:
    grid = np.arange(5.0)
    x, y = (axis.reshape(-1) for axis in np.meshgrid(grid[:-1], grid[:-1]))
    squares = [
        np.stack((x + i, y + j, 0.0 * x), axis=1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    corners = np.concatenate(
        [np.stack([squares[k] for k in one], 1) for one in ((0, 1, 2), (0, 2, 3))]
    )
    at = np.stack(np.meshgrid(np.arange(9) / 2, np.arange(9) / 2), axis=-1).reshape(-1, 2)
    for axis, zero in product(range(3), (0.0, -0.0)):
        turned = np.roll(corners, axis, axis=2)
        origins = np.roll(np.column_stack((at, np.full(len(at), 2.0))), axis, axis=1)
        directions = np.roll(np.tile((zero, zero, -4.0), (len(at), 1)), axis, axis=1)
        distance, *_ = TriangleSearch(turned).first_hits(origins, directions)
        assert (distance == 0.5).all()


def test_triangles_as_small_as_rounding_are_met_by_no_ray_beside_them() -> None:
    rng, step = np.random.default_rng(5), np.spacing(5.0)
    wall = np.array([[(4.0, -9.0, -9.0), (4.0, 9.0, -9.0), (4.0, 0.0, 9.0)]])
    for _ in range(100):
        tiny = (3.0, 5.0, 1.0) + step * rng.integers(-3, 4, (7, 3, 3))
        directions = np.column_stack((np.ones(50), rng.uniform(-0.1, 0.1, (50, 2))))
        found = TriangleSearch(np.concatenate((tiny, wall))).first_hits(
            np.zeros((50, 3)), directions
        )
        assert set(found[1].tolist()) == {7}


def test_triangles_in_the_plane_of_a_ray_are_not_met_beside_them() -> None:
    rng = np.random.default_rng(6)
    for _ in range(100):
        # The ray's plane contains the triangle, which begins beside the ray.
        directions, aside = rng.normal(size=(2, 3))
        along, off = rng.uniform(1.0, 9.0, (2, 3, 1))
        corners = (along * directions + off * aside)[None]
        found = TriangleSearch(corners).first_hits(np.zeros((1, 3)), directions[None])
        assert found[1].tolist() == [-1]


def test_degenerate_and_non_finite_triangles_are_never_met() -> None:
    a, b, c = CORNERS[0]
    nan, inf = np.full(3, np.nan), np.full(3, np.inf)
    bad = [(a, a, b), (a, b, b), (a, a, a), (a, 0.5 * (a + b), b), (a, nan, c), (nan, nan, nan)]
    bad += [(a, b, inf), (-inf, b, c), (1e300 * a, 1e300 * b, 1e300 * c)]
    corners = np.array([*bad, *bad, CORNERS[0]])
    points = np.concatenate((edge_points(CORNERS, np.random.default_rng(6))[:999], [a, b, c]))
    for mesh, expected in ((corners, {len(corners) - 1}), (corners[:-1], {-1})):
        found = TriangleSearch(mesh).first_hits(np.zeros(points.shape), points * (1.0, 0.99, 0.99))
        assert set(found[1].tolist()) - {-1} == expected - {-1}


@pytest.mark.parametrize("count", [2, 7, 40, 1000])
def test_of_triangles_at_the_same_distance_the_lowest_number_is_met(count: int) -> None:
    rng = np.random.default_rng(count)
    far, near = CORNERS[0] + (4.0, 0.0, 0.0), CORNERS[0]
    corners = np.where(rng.permutation(count)[:, None, None] % 2 == 0, near, far)
    directions = np.column_stack((np.ones(500), rng.uniform(-0.2, 0.2, (500, 2))))
    found = TriangleSearch(corners).first_hits(np.zeros((500, 3)), directions)
    lowest = int(np.flatnonzero((corners == near).all(axis=(1, 2)))[0])
    assert set(found[1].tolist()) == {lowest}


def test_hits_depend_on_no_other_rays() -> None:
    rng = np.random.default_rng(7)
    search = TriangleSearch(make_ball())
    origins, directions = rng.normal(size=(2, 40_000, 3))
    whole = search.first_hits(origins, directions)
    for some in (slice(0, 5), slice(16_000, 17_000), rng.permutation(40_000)):
        for all_rays, part in zip(
            whole, search.first_hits(origins[some], directions[some]), strict=True
        ):
            np.testing.assert_array_equal(all_rays[some], part)


@pytest.mark.parametrize("corners", [CORNERS, np.zeros((0, 3, 3)), np.full((2, 3, 3), np.nan)])
def test_rays_that_are_none_meet_nothing(corners: Floats) -> None:
    search = TriangleSearch(corners)
    no_rays = np.zeros((0, 3))
    assert [len(found) for found in search.first_hits(no_rays, no_rays)] == [0, 0, 0]
    bad = np.array([(0.0, 0.0, 0.0), (np.nan, 0.0, 0.0), (np.nan, 1.0, np.inf)])
    assert search.first_hits(np.zeros((3, 3)), bad)[1].tolist() == [-1, -1, -1]
    assert search.first_hits(bad[1:], np.ones((2, 3)))[1].tolist() == [-1, -1]
    assert not search.occludes(np.zeros((1, 3)), np.array([BEHIND]), np.full(1, np.inf)).any()
