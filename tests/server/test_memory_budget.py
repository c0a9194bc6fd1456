"""Estimates of memory, and the limit that they are compared with."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MIB, MemoryBudget, ViewSize


def reserve(budget: MemoryBudget, num_bytes: int) -> None:
    where = SourceLocation("x.ini", 7)
    budget.reserve(num_bytes, where=where, key="K", value="9", remedy="a smaller K")


def test_budget_is_exceeded_by_the_sum_of_all_reservations() -> None:
    budget = MemoryBudget(100 * MIB)
    reserve(budget, 60 * MIB)
    reserve(budget, 40 * MIB)
    with pytest.raises(ConfigError, match=r"x\.ini:7: K='9': .*a smaller K: .*101 MiB.*of 100 "):
        reserve(budget, 1)


@pytest.mark.parametrize(
    ("size", "measured_mib"),
    [
        # Larger peak of both renderers, measured in tests/measurements/memory_per_item.py.
        (ViewSize(1024**2, 1), 95),
        (ViewSize(2048**2, 4), 465),
        (ViewSize(512**2, 64), 429),
        (ViewSize(3072**2, 1), 504),
        (ViewSize(1024**2, 1, has_effects=True), 536),
        # Rays of a ball: above the start's 80 MiB.
        (ViewSize(2048**2, 4, has_origins=True), 702),
        (ViewSize(3072**2, 1, has_origins=True), 472),
    ],
)
def test_view_takes_what_was_measured(size: ViewSize, measured_mib: float) -> None:
    assert 0.9 * measured_mib <= size.num_bytes / MIB <= 1.8 * measured_mib


@pytest.mark.parametrize(
    "size",
    [
        ViewSize(8192**2, 1),
        ViewSize(360**2, 16**2, num_texels=5 * 8192**2),
        ViewSize(2048**2, 16),
        ViewSize(1, 1, num_texels=8192**2, samples_per_texel=8),
    ],
)
def test_view_of_gigabytes_exceeds_the_default(size: ViewSize) -> None:
    assert size.num_bytes > DEFAULT_LIMIT_BYTES


@pytest.mark.parametrize(
    "size", [ViewSize(360**2, 16**2), ViewSize(1024**2, 4, has_effects=True), ViewSize(2048**2, 4)]
)
def test_view_of_ordinary_cameras_fits_the_default(size: ViewSize) -> None:
    assert size.num_bytes <= DEFAULT_LIMIT_BYTES
