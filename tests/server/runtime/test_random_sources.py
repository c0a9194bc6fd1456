"""Random numbers depend on seed, names and index alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.runtime.random_sources import RandomSource


def normal_variates(source: RandomSource, index: int, count: int = 4) -> list[float]:
    return source.normal_variates(index, count)


def test_normal_variates_have_the_moments_of_the_normal_distribution() -> None:
    variates = np.array(normal_variates(RandomSource.from_names(1, "x"), 0, 100_000))
    # Four standard deviations of each mean: of x^n of a normal variate, from its moments.
    for power, mean, deviation in ((1, 0.0, 1.0), (2, 1.0, 1.42), (3, 0.0, 3.88), (4, 3.0, 9.8)):
        assert abs((variates**power).mean() - mean) < 4.0 * deviation / math.sqrt(100_000)


def test_source_when_used_again_repeats_itself() -> None:
    source = RandomSource.from_names(7, "R1", "Odometry")
    assert normal_variates(source, 3) == normal_variates(source, 3)
    assert normal_variates(RandomSource.from_names(7, "R1", "Odometry"), 3) == normal_variates(
        source, 3
    )


def test_source_when_others_are_used_is_unchanged() -> None:
    source = RandomSource.from_names(7, "R1", "Odometry")
    before = normal_variates(source, 3)
    normal_variates(source, 2, 1000)
    np.random.default_rng().standard_normal(10)
    assert normal_variates(source, 3) == before


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
def test_source_of_another_seed_or_name_differs(other: RandomSource) -> None:
    assert normal_variates(other, 3) != normal_variates(
        RandomSource.from_names(7, "R1", "Odometry"), 3
    )


def test_indices_when_neighbours_are_independent() -> None:
    source = RandomSource.from_names(1, "x")
    table = np.array([normal_variates(source, index, 8) for index in range(2000)])
    lag_one = np.corrcoef(table[:-1].ravel(), table[1:].ravel())[0, 1]
    # 16 000 pairs: a correlation of independent numbers is below 4 / sqrt(16 000).
    assert abs(lag_one) < 0.032
    assert len(np.unique(table)) == table.size


@pytest.mark.parametrize("index", [0, 2**32, 2**63])
def test_index_when_large_is_valid(index: int) -> None:
    assert np.isfinite(normal_variates(RandomSource.from_names(1, "x"), index)).all()


@pytest.mark.parametrize("index", [0, 1, 2**40, 2**63])
def test_generator_is_philox_of_the_key_at_the_counter_of_the_index(index: int) -> None:
    source = RandomSource.from_names(7, "R1", "Odometry")
    philox = np.random.Philox(
        key=np.array(source.key, dtype=np.uint64),
        counter=np.array((0, 0, 0, index), dtype=np.uint64),
    )
    expected = np.random.Generator(philox)
    assert source.generator(index).random(4).tolist() == expected.random(4).tolist()


def test_generators_of_one_source_share_no_state() -> None:
    source = RandomSource.from_names(7, "R1", "Odometry")
    first, second = source.generator(3), source.generator(4)
    interleaved = [draw.random() for draw in (first, second, first, second)]
    assert interleaved[::2] == source.generator(3).random(2).tolist()
    assert interleaved[1::2] == source.generator(4).random(2).tolist()
