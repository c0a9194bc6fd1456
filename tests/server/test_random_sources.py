"""Streams depend on seed, names and index alone."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.random_sources import RandomSource


def drawn(stream: RandomSource, index: int, count: int = 4) -> list[float]:
    return list(stream.generator(index).standard_normal(count))


def test_stream_when_asked_again_repeats_itself() -> None:
    stream = RandomSource.from_names(7, "R1", "Odometry")
    assert drawn(stream, 3) == drawn(stream, 3)
    assert drawn(RandomSource.from_names(7, "R1", "Odometry"), 3) == drawn(stream, 3)


def test_stream_when_drawn_from_elsewhere_is_not_disturbed() -> None:
    stream = RandomSource.from_names(7, "R1", "Odometry")
    before = drawn(stream, 3)
    drawn(stream, 2, 1000)
    np.random.default_rng().standard_normal(10)
    assert drawn(stream, 3) == before


@pytest.mark.parametrize(
    "other",
    [
        RandomSource.from_names(8, "R1", "Odometry"),
        RandomSource.from_names(7, "R2", "Odometry"),
        RandomSource.from_names(7, "R1", "slip"),
        RandomSource.from_names(7, "R1Odometry"),
        RandomSource.from_names(71, "", "Odometry"),
        RandomSource.from_names(7),
    ],
)
def test_stream_when_of_another_seed_or_name_is_another(other: RandomSource) -> None:
    assert drawn(other, 3) != drawn(RandomSource.from_names(7, "R1", "Odometry"), 3)


def test_indices_when_neighbours_are_independent() -> None:
    stream = RandomSource.from_names(1, "x")
    table = np.array([drawn(stream, index, 8) for index in range(2000)])
    lag_one = np.corrcoef(table[:-1].ravel(), table[1:].ravel())[0, 1]
    # 16 000 pairs: a correlation of independent numbers is below 4 / sqrt(16 000).
    assert abs(lag_one) < 0.032
    assert len(np.unique(table)) == table.size


@pytest.mark.parametrize("index", [0, 2**32, 2**63])
def test_index_when_large_is_taken(index: int) -> None:
    assert np.isfinite(drawn(RandomSource.from_names(1, "x"), index)).all()
