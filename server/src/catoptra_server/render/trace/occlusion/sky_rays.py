"""Directions to the sky, distributed by the cosine, and the weight of an occluder by its distance.

A point's factor is 1 less the mean weight over the hemisphere of its normal:
1 - (1 / pi) integral of cos(theta) weight(distance(direction)). An occluder at distance 0 has the
weight 1, so a point at the foot of an infinite wall has the factor 1/2; weights fall to 0 at the
radius, since in a closed room every direction ends on something. Source: Zhukov et al. 1998,
"An ambient light illumination model".
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats

# Beyond, nothing occludes: the size of things that stand on floors. Chosen by pictures of the
# field, the corridor and the rescue world.
RADIUS_M = 0.5
# Sets of directions, one for each node of a square of four nodes; a filter then mixes all of them.
NUM_SETS = 4
RAYS_PER_NODE = 32


def occluder_weights(distances: Floats) -> Floats:
    """Weights of occluders at distances, metres: 1 at distance 0, 0 from the radius on."""
    nearness = np.maximum(1.0 - distances / RADIUS_M, 0.0)
    weights: Floats = nearness * nearness
    return weights


def sky_directions() -> Floats:
    """(NUM_SETS, RAYS_PER_NODE, 3) unit directions around z, distributed by the cosine.

    Sobol's first two dimensions: each block of a power of two points is stratified by itself, and
    all blocks together are, too.
    """
    count = NUM_SETS * RAYS_PER_NODE
    # Half a cell off the borders: no ray along the surface, none along its normal.
    across = (_van_der_corput(count) + 0.5 / count) % 1.0
    around = 2.0 * np.pi * (_sobol_second(count) + 0.5 / count)
    radius = np.sqrt(across)
    directions = np.stack(
        (radius * np.cos(around), radius * np.sin(around), np.sqrt(1.0 - across)), axis=-1
    )
    return directions.reshape(NUM_SETS, RAYS_PER_NODE, 3)


def _van_der_corput(count: int) -> Floats:
    """(count,) radical inverses in base 2."""
    return _digital_sequence(count, [2**-bit for bit in range(1, 17)])


def _sobol_second(count: int) -> Floats:
    """(count,) second dimension of Sobol's sequence: the polynomial x + 1."""
    columns, value = [], 1 << 15
    for _ in range(16):
        columns.append(value)
        value ^= value >> 1
    return _digital_sequence(count, [column / 65536.0 for column in columns])


def _digital_sequence(count: int, columns: list[float]) -> Floats:
    """(count,) exclusive sums of 16-bit columns, as fractions, by the bits of the index."""
    index = np.arange(count)
    total = np.zeros(count, dtype=np.int64)
    for bit, column in enumerate(columns):
        total ^= np.where(index >> bit & 1, int(column * 65536.0), 0)
    return total / 65536.0
