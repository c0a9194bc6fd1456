"""Dust particles and scratches on a mirror, and the fraction of each pixel that they cover.

Positions on the surface and the image scale there come from a table of rings of the mirror, from
the axis to the rim, by plan radius: the fraction of the surface within, the image radius, and px
per metre along the meridian, along the plan radius, and tangentially. Linear between rings, within
1e-5 of the exact values. Domain: central mirrors.

Particles are discs with exponentially distributed diameters (an assumption), uniform over the
surface; scratches are straight in plan, of one width, with exponentially distributed lengths. Sizes
are the central quantiles of their distribution, so all cameras have equal sizes and the coverage is
exact; positions are random, by the camera's key. Contaminants are cut into cells of at most a
quarter pixel, and each cell covers the pixels of a square of the same area. Not simulated: the
height of a particle above the surface, and its mirror image.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import cos, hypot, interpolate_linear, ln, matmul, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.kernels.grey_levels import UInt32Array, pcg3d

# Limit of time and memory: above, fewer but larger particles have the same coverage.
_MAX_PARTICLES = 2**19
_CELLS_PER_PX = 4.0
_WORD_RANGE = 2.0**32


@dataclass(frozen=True, slots=True)
class Contaminants:
    """Amounts and sizes of dust and scratches."""

    coverage: float
    """Fraction of the surface under dust."""
    mean_particle_diameter_m: float
    num_scratches: int
    mean_scratch_length_m: float
    scratch_width_m: float
    """Width of every scratch."""

    def particle_diameters_m(self, area_m2: float) -> Floats:
        """Diameters, (n,), of the particles on a surface, in ascending order."""
        covered_m2 = self.coverage * area_m2
        # The mean square of an exponential distribution is twice the square of its mean.
        expected = covered_m2 / (
            0.5 * math.pi * self.mean_particle_diameter_m * self.mean_particle_diameter_m
        )
        # Any coverage above 0 has at least one particle.
        count = min(round(expected) or math.ceil(expected), _MAX_PARTICLES)
        sizes = _exponential_quantiles(count)
        # Rescaled so that the areas sum to the coverage exactly, whatever the rounded count.
        scale = (
            math.sqrt(covered_m2 / (0.25 * math.pi * float(matmul(sizes, sizes)))) if count else 0.0
        )
        return scale * sizes

    def scratch_lengths_m(self) -> Floats:
        """Lengths, (n,), of the scratches."""
        return self.mean_scratch_length_m * _exponential_quantiles(self.num_scratches)


@dataclass(frozen=True, slots=True, eq=False)
class ContaminantCells:
    """Squares in the image, (n,), parallel to the pixels."""

    u: Floats
    """Columns of the centres, px."""
    v: Floats
    """Rows of the centres, px."""
    side_px: Floats
    """Sides, up to 1 px."""


def particle_cells(
    contaminants: Contaminants,
    camera: OmniCamera,
    surface_table: _MirrorSurfaceTable,
    key: UInt32Array,
) -> ContaminantCells:
    """Cells of all dust particles in a camera's image."""
    diameter = contaminants.particle_diameters_m(surface_table.area_m2)
    area_fraction, turn, _ = _uniform_variates(len(diameter), key)
    radius_px, radial, tangential = surface_table.interpolate(
        surface_table.plan_radius_from_area_fraction(area_fraction)
    )
    cells_per_side = np.ceil(_CELLS_PER_PX * diameter * np.maximum(radial, tangential)).astype(
        np.intp
    )
    parts = []
    # Particles of one resolution are cut together: a dozen array operations for each resolution
    # instead of each particle.
    for side in np.unique(cells_per_side):
        chosen = cells_per_side == side
        x, y = _disc_cell_centres(int(side))
        size = diameter[chosen, None]
        # Cells are spread along the image radius, at azimuth 0, and then turned about the centre.
        outward = radius_px[chosen, None] + size * radial[chosen, None] * x
        sideways = size * tangential[chosen, None] * y
        azimuth = 2.0 * np.pi * turn[chosen, None]
        cosine, sine = cos(azimuth), sin(azimuth)
        # The particle's exact image area, shared by the cells: the raster of cells loses none.
        area = 0.25 * np.pi * np.square(size) * (radial * tangential)[chosen, None] / len(x)
        side_px = np.broadcast_to(np.sqrt(area), outward.shape)
        parts.append(
            np.stack(
                (outward * cosine - sideways * sine, outward * sine + sideways * cosine, side_px)
            )
        )
    return _join_cells(parts, camera)


def scratch_cells(
    contaminants: Contaminants,
    camera: OmniCamera,
    surface_table: _MirrorSurfaceTable,
    key: UInt32Array,
) -> ContaminantCells:
    """Cells of all scratches in a camera's image, without their parts beyond the mirror's rim."""
    lengths = contaminants.scratch_lengths_m()
    area_fraction, turn, heading = _uniform_variates(len(lengths), key)
    step_m = 1.0 / (_CELLS_PER_PX * surface_table.max_px_per_m)
    rows = math.ceil(contaminants.scratch_width_m / step_m)
    parts = []
    for r, length, azimuth, direction in zip(
        surface_table.plan_radius_from_area_fraction(area_fraction),
        lengths,
        2.0 * np.pi * turn,
        np.pi * heading,
        strict=True,
    ):
        columns = math.ceil(length / step_m)
        along, across = np.meshgrid(
            length * _cell_centres(columns), contaminants.scratch_width_m * _cell_centres(rows)
        )
        x = r * cos(azimuth) + along * cos(direction) - across * sin(direction)
        y = r * sin(azimuth) + along * sin(direction) + across * cos(direction)
        cell_m2 = length * contaminants.scratch_width_m / (columns * rows)
        parts.append(_project_cells(x.ravel(), y.ravel(), cell_m2, surface_table))
    return _join_cells(parts, camera)


def pixel_coverage(cells: ContaminantCells, camera: OmniCamera) -> Floats:
    """Fraction of each pixel, (h, w), that squares cover, at most 1; overlaps count twice."""
    height, width = camera.height_px, camera.width_px
    covered = np.zeros(height * width)
    half = 0.5 * cells.side_px
    # A side is at most a pixel, so a cell lies in two columns and two rows at most.
    columns, rows = (
        _split_between_pixels(centre - half, cells.side_px) for centre in (cells.u, cells.v)
    )
    for column, width_px in columns:
        for row, height_px in rows:
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            pixel = (row * width + column)[inside]
            # bincount adds repeated pixels in a fixed order: the same bits in every run.
            covered += np.bincount(pixel, (width_px * height_px)[inside], height * width)
    return np.minimum(covered, 1.0).reshape(height, width)


_NUM_RINGS = 1025


@dataclass(frozen=True, slots=True, eq=False)
class _MirrorSurfaceTable:
    """Table of (n,) rings of a mirror, from the axis to the rim."""

    r_m: Floats
    """Radius about the axis, in plan."""
    area_fraction: Floats
    """Fraction of the surface within the ring."""
    image_radius_px: Floats
    """Radius in the image."""
    radial_px_per_m: Floats
    """Image px per metre of surface, along the meridian."""
    tangential_px_per_m: Floats
    """Image px per metre of surface, around the axis."""
    plan_radial_px_per_m: Floats
    """Image px per metre of the plan radius."""
    area_m2: float
    """Area of the whole surface."""

    @property
    def max_px_per_m(self) -> float:
        """Largest scale of lengths in plan, in any direction."""
        return float(max(self.plan_radial_px_per_m.max(), self.tangential_px_per_m.max()))

    @property
    def max_px2_per_m2(self) -> float:
        """Largest scale of areas of the surface."""
        return float((self.radial_px_per_m * self.tangential_px_per_m).max())

    def plan_radius_from_area_fraction(self, area_fraction: Floats) -> Floats:
        """Plan radius, m, within which a fraction of the surface lies."""
        # Near the axis areas grow with the square of the radius: in the square roots the relation
        # is nearly linear and interpolates well.
        r: Floats = interpolate_linear(
            np.sqrt(area_fraction), np.sqrt(self.area_fraction), self.r_m
        )
        return r

    def interpolate(self, r_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Image radius in px, radial and tangential px per metre of surface, at plan radii."""
        radius, radial, tangential = (
            interpolate_linear(r_m, self.r_m, values)
            for values in (self.image_radius_px, self.radial_px_per_m, self.tangential_px_per_m)
        )
        return radius, radial, tangential


@lru_cache(maxsize=4)
def mirror_surface_table(camera: OmniCamera) -> _MirrorSurfaceTable:
    """Surface table of a camera's mirror."""
    t = np.linspace(0.0, camera.rim_t, _NUM_RINGS)
    r, z = camera.mirror.surface_point(t)
    radius_px = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    arc = np.concatenate(([0.0], np.cumsum(hypot(np.diff(r), np.diff(z)))))
    # Exact lateral areas of the cone frusta between rings.
    rings = np.pi * (r[1:] + r[:-1]) * np.diff(arc)
    area = np.concatenate(([0.0], np.cumsum(rings)))
    radial = np.gradient(radius_px, arc, edge_order=2)
    # On the axis both scales agree by symmetry, where the quotient would be 0 / 0.
    tangential = np.concatenate((radial[:1], radius_px[1:] / r[1:]))
    return _MirrorSurfaceTable(
        r_m=r,
        area_fraction=area / area[-1],
        image_radius_px=radius_px,
        radial_px_per_m=radial,
        tangential_px_per_m=tangential,
        plan_radial_px_per_m=np.gradient(radius_px, r, edge_order=2),
        area_m2=float(area[-1]),
    )


def _split_between_pixels(
    start: Floats, length: Floats
) -> list[tuple[npt.NDArray[np.intp], Floats]]:
    """Split intervals of up to 1 px between the two pixels that contain them."""
    pixel = np.floor(start)
    first = np.minimum(pixel + 1.0 - start, length)
    index = pixel.astype(np.intp)
    return [(index, first), (index + 1, length - first)]


def _project_cells(
    x: Floats, y: Floats, cell_m2: float, surface_table: _MirrorSurfaceTable
) -> Floats:
    """Project cells from plan to the image.

    Returns:
        (3, n): u and v from the image centre, px, and side, px, of the cells within the rim.
    """
    r = hypot(x, y)
    x, y, r = (values[r <= surface_table.r_m[-1]] for values in (x, y, r))
    _, _, tangential = surface_table.interpolate(r)
    # A scratch is measured in plan, so its area scales by the plan radius, not the meridian.
    plan_radial = interpolate_linear(r, surface_table.r_m, surface_table.plan_radial_px_per_m)
    # Image radius over plan radius is the tangential scale: both directions scale by it.
    return np.stack((tangential * x, tangential * y, np.sqrt(cell_m2 * plan_radial * tangential)))


def _join_cells(parts: list[Floats], camera: OmniCamera) -> ContaminantCells:
    # The empty first part keeps shapes valid where there is nothing to join.
    joined = [part.reshape(3, -1) for part in (np.zeros((3, 0)), *parts)]
    u, v, side = np.concatenate(joined, axis=1)
    return ContaminantCells(u + camera.centre_px[0], v + camera.centre_px[1], side)


def _disc_cell_centres(cells_per_side: int) -> tuple[Floats, Floats]:
    """Centres of the cells, of cells_per_side^2, that lie in a disc of diameter 1."""
    y, x = np.meshgrid(_cell_centres(cells_per_side), _cell_centres(cells_per_side))
    inside = hypot(x, y) <= 0.5
    return x[inside], y[inside]


def _cell_centres(count: int) -> Floats:
    """Centres of equal parts of the interval from -1/2 to 1/2."""
    return (np.arange(count) + 0.5) / max(count, 1) - 0.5


def _exponential_quantiles(count: int) -> Floats:
    """Quantiles (i + 1/2) / count of the exponential distribution of mean 1."""
    return -ln((np.arange(count, 0, -1) - 0.5) / max(count, 1))


def _uniform_variates(count: int, key: UInt32Array) -> tuple[Floats, Floats, Floats]:
    """Three times (count,) uniform variates in (0, 1), the same for the same key."""
    index = np.arange(count, dtype=np.uint32)
    words = pcg3d(index + key[0], key[1:2], key[2:])
    # Half a step centres each variate in its interval of 2^-32: neither 0 nor 1 occurs.
    first, second, third = ((word.astype(np.float64) + 0.5) / _WORD_RANGE for word in words)
    return first, second, third
