"""Rays that leak out of closed meshes, and distances beyond float64's by more than rounding.

Run: .venv/bin/python tests/measurements/watertight.py [RAYS=1e7]

Rays begin inside of meshes that are closed, half of them as near to a wall as float32 allows, and
are aimed at corners, edges and insides of triangles: 16 at one triangle from one place, or each its
own way; then from the same places at the aims of other rays, time and again, since making rays
costs more than casting them. Prints, for each mesh, size and distance from the coordinates' origin:
rays that meet nothing (each is a leak); of the first turn hits whose distance differs by more than
the reserve from that of the met triangle's plane in float64 (by the same float32 ray), hits outside
of the met triangle by more, and, of a sample, hits that are not the nearest of all triangles in
float64.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster

RADII_M = (1e-3, 1.0, 1e3, 2e5)
DISTANCES = (0.0, 3.0, 1e3)
"""Of the centre from the origin along each axis, in radii."""
CHUNK, SAMPLE = 1 << 18, 512
TURNS = 32
"""How often the places of a chunk are used."""
# Two roundings of a coordinate, of the distance, of the shear and of their products, each 2^-24,
# and as many again; along the ray by the cosine of incidence, across the plane as it is.
RESERVE = 16 * 2.0**-24


def make_shell() -> Floats:
    """(n, 3, 3) bumpy sphere."""
    rng, (rows, columns) = np.random.default_rng(5), (24, 31)
    polar = np.repeat(np.linspace(0.0, np.pi, rows + 1)[:, None], columns, axis=1)
    azimuth = 2 * np.pi * np.arange(columns) / columns
    level = np.sin(polar) * (np.arange(rows + 1) % rows > 0)[:, None]
    bumps = rng.uniform(0.5, 1.0, polar.shape)
    bumps[[0, -1]] = 1.0
    sides = (level * np.cos(azimuth), level * np.sin(azimuth), np.cos(polar))
    return join_rings(bumps[..., None] * np.stack(sides, axis=-1))


def join_rings(points: Floats) -> Floats:
    """Triangles between rings (rows, columns, 3) of points."""
    right = np.roll(points, -1, axis=1)
    a, b, c, d = points[:-1], right[:-1], right[1:], points[1:]
    return np.concatenate((np.stack((a, b, c), 2), np.stack((a, c, d), 2))).reshape(-1, 3, 3)


def make_ring(heights: tuple[float, ...], radii: tuple[float, ...], columns: int) -> Floats:
    """Body of revolution of slivers and of fans of `columns` triangles."""
    azimuth = 2 * np.pi * np.arange(columns) / columns
    circle = np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros(columns)), axis=-1)
    return join_rings(
        np.stack([r * circle + [0, 0, z] for z, r in zip(heights, radii, strict=True)])
    )


def make_sheets() -> Floats:
    """Two cubes in one place, of walls of 2 and of 450 triangles."""
    walls = []
    for steps in (1, 15):
        grid = np.linspace(-1.0, 1.0, steps + 1)
        u, v = np.meshgrid(grid, grid, indexing="ij")
        for axis in range(3):
            for side in (-1.0, 1.0):
                points = np.stack((np.full_like(u, side), u, v), axis=-1)
                p = np.roll(points, axis, axis=-1)
                a, b, c, d = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
                walls += [np.stack((a, b, c), 2), np.stack((a, c, d), 2)]
    return np.concatenate([wall.reshape(-1, 3, 3) for wall in walls])


MESHES: dict[str, Callable[[], Floats]] = {
    "bumpy shell": make_shell,
    # A ray that is aimed at a fan's centre tests all of its triangles.
    "fans": lambda: make_ring((-1.0, 0.0, 1.0), (0.0, 1.0, 0.0), 1_500),
    "slivers": lambda: make_ring((-1.0, -1.0, 1.0, 1.0), (0.0, 1.0, 1.0, 0.0), 1_500),
    "coplanar sheets": make_sheets,
}


def aim(rng: np.random.Generator, corners: Floats, chosen: np.ndarray) -> Floats:
    """(n, 3) points of triangles: a quarter corners, half of edges, a quarter of the inside."""
    weights = rng.dirichlet(np.ones(3), len(chosen))
    kind = rng.integers(0, 4, len(chosen))
    weights[kind < 3, 2] = 0.0
    weights[kind == 0, 1] = 0.0
    weights = rng.permuted(weights / weights.sum(axis=1, keepdims=True), axis=1)
    return np.einsum("nc,nci->ni", weights, corners[chosen])


def make_rays(
    rng: np.random.Generator, corners: Floats, centre: Floats, count: int
) -> tuple[Floats, Floats]:
    """Origins (n, 3), float32 numbers inside of the mesh, and points (n, 3) at which rays aim."""
    radius = np.abs(corners - centre).max()
    ulp = np.spacing(np.float32(np.abs(corners).max()))
    chosen = rng.integers(0, len(corners), count)
    is_narrow = np.repeat(rng.uniform(size=count // 16 + 1) < 0.5, 16)[:count]
    first = np.arange(count) // 16 * 16
    chosen[is_narrow] = chosen[first[is_narrow]]
    aims, at = aim(rng, corners, chosen), aim(rng, corners, rng.permuted(chosen))
    at[is_narrow] = aims[first[is_narrow]]
    nearest = np.log10(np.clip(64.0 * ulp / radius, 1e-6, 0.5))
    depth = 10.0 ** np.where(rng.uniform(size=count) < 0.5, nearest * rng.uniform(size=count), -0.1)
    depth[is_narrow] = depth[first[is_narrow]]
    origins = (at + (centre - at) * depth[:, None]).astype(np.float32).astype(np.float64)
    return origins, aims


def turn(origins: Floats, aims: Floats) -> Floats:
    """(n, 3) directions, float32 numbers."""
    directions = aims - origins
    length = np.sqrt(np.einsum("ni,ni->n", directions, directions))[:, None]
    is_ray = length > 0.0
    directions = np.where(is_ray, directions / np.where(is_ray, length, 1.0), [0, 0, 1])
    return directions.astype(np.float32).astype(np.float64)


def check_hits(
    corners: Floats, origins: Floats, directions: Floats, distances: Floats
) -> tuple[Bools, Bools]:
    """Whether distances differ from those of the (n, 3, 3) triangles' planes, and whether the
    points of the planes are outside of the triangles, each by more than the reserve.
    """
    a, b, c = corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    area = np.linalg.norm(normals, axis=1)
    facing = np.einsum("ni,ni->n", normals, directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.einsum("ni,ni->n", normals, a - origins) / facing
        cosine = np.abs(facing) / area
        # The rounding of a sliver's normal turns its plane about its long side.
        longest = np.maximum(np.linalg.norm(b - a, axis=1), np.linalg.norm(c - a, axis=1))
        reserve = RESERVE * (np.abs(corners).max((1, 2)) + np.abs(origins).max(1) + distances)
        along = reserve / cosine * np.maximum(1.0, longest**2 / area)
        points = origins + directions * distances[:, None]
        outside = np.zeros(len(a))
        for start, end in ((a, b), (b, c), (c, a)):
            out = np.cross(end - start, normals)
            out /= np.linalg.norm(out, axis=1, keepdims=True)
            outside = np.fmax(outside, np.einsum("ni,ni->n", out, points - start))
    return np.abs(exact - distances) > along, outside > reserve + np.minimum(along, longest)


def not_nearest(corners: Floats, origins: Floats, directions: Floats, distances: Floats) -> Bools:
    """Whether a hit in float64, clear of edges, is nearer or farther than by the reserve."""
    a, b, c = corners.swapaxes(0, 1)
    ab, ac = b - a, c - a
    p = np.cross(directions[:, None], ac)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / (ab * p).sum(-1)
        t = origins[:, None] - a
        u, q = (t * p).sum(-1) * inverse, np.cross(t, ab)
        v = (directions[:, None] * q).sum(-1) * inverse
        exact = (ac * q).sum(-1) * inverse
        cosine = np.abs(inverse) ** -1 / np.linalg.norm(np.cross(ab, ac), axis=-1)
        reserve = RESERVE * (np.abs(corners).max() + distances[:, None]) / cosine
        is_clear = (np.minimum(np.minimum(u, v), 1.0 - u - v) > 1e-3) & (exact > reserve)
        return (is_clear & (exact + 2.0 * reserve < distances[:, None])).any(axis=1)


def main() -> None:
    """Print a line for each mesh, size and distance."""
    total = int(float(sys.argv[1])) if len(sys.argv) > 1 else 10_000_000
    per_case = -(-total // (len(MESHES) * len(RADII_M) * len(DISTANCES)))
    rng, begin, sums = np.random.default_rng(1), time.perf_counter(), np.zeros(5, dtype=np.int64)
    heads = ("radius m", "at radii", "rays", "leaks", "plane", "outside", "nearer")
    print(f"{'mesh':16}" + "".join(f"{head:>10}" for head in heads))
    for name, make in MESHES.items():
        for radius in RADII_M:
            for distance in DISTANCES:
                centre = np.full(3, distance * radius)
                corners = (centre + radius * make()).astype(np.float32).astype(np.float64)
                caster, row = KernelMeshCaster(corners, np.zeros(3)), np.zeros(5, dtype=np.int64)
                for first in range(0, per_case, CHUNK * TURNS):
                    turns = min(TURNS, -(-(per_case - first) // CHUNK))
                    origins, aims = make_rays(rng, corners, centre, min(CHUNK, per_case))
                    for number in range(turns):
                        rays = origins, turn(origins, np.roll(aims, 16 * 997 * number, axis=0))
                        distances, triangles = caster.closest_triangles(*rays)
                        row[:2] += len(origins), (triangles < 0).sum()
                        if number:
                            continue
                        hit = triangles >= 0
                        found = [values[hit] for values in (*rays, distances)]
                        plane, outside = check_hits(corners[triangles[hit]], *found)
                        some = slice(0, max(16, SAMPLE * 1500 // len(corners)))
                        nearer = not_nearest(corners, *(values[some] for values in found))
                        row[2:] += plane.sum(), outside.sum(), nearer.sum()
                sums += row
                numbers = (f"{number:10g}" for number in (radius, distance))
                print(f"{name:16}", *numbers, *(f"{n:10d}" for n in row), sep="", flush=True)
    print(f"{'all':36}", *(f"{n:10d}" for n in sums), sep="")
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
