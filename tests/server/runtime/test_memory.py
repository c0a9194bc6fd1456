"""Limits of memory, cached items, open files and processors."""

from __future__ import annotations

import os
import platform
import resource

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.runtime.memory import (
    DEFAULT_LIMIT_BYTES,
    MIB,
    LruDict,
    MemoryBudget,
    ViewSize,
    count_processors,
    raise_descriptor_limit,
    release_freed_memory,
)
from helpers.memory import resident_mb


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
        (ViewSize(1024**2, 1, effect_bytes_per_px=500), 536),
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
    "size",
    [ViewSize(360**2, 16**2), ViewSize(1024**2, 4, effect_bytes_per_px=500), ViewSize(2048**2, 4)],
)
def test_view_of_ordinary_cameras_fits_the_default(size: ViewSize) -> None:
    assert size.num_bytes <= DEFAULT_LIMIT_BYTES


def test_item_is_made_once() -> None:
    items: LruDict[str, list[int]] = LruDict(2)
    first = items.get_or_make("a", list)
    assert items.get_or_make("a", list) is first
    assert items.get("a") is first
    assert items.get("b") is None
    assert len(items) == 1


def test_item_used_longest_ago_is_removed_and_reported() -> None:
    removed: list[str] = []
    items: LruDict[str, str] = LruDict(2, on_remove=removed.append)
    for key in ("a", "b", "a", "c"):
        items.get_or_make(key, lambda: "made")
    assert removed == ["b"]
    assert items.keys() == ("a", "c")


def test_looking_at_an_item_is_no_use() -> None:
    items: LruDict[str, str] = LruDict(2)
    items.get_or_make("a", str)
    items.get_or_make("b", str)
    items.get("a")
    items.get_or_make("c", str)
    assert items.keys() == ("b", "c")


def test_item_whose_making_fails_leaves_the_others() -> None:
    items: LruDict[str, float] = LruDict(2)
    items.get_or_make("a", float)
    with pytest.raises(ZeroDivisionError):
        items.get_or_make("b", lambda: 1.0 / 0.0)
    assert items.keys() == ("a",)
    items.remove("a")
    items.clear()
    assert len(items) == 0


def test_item_when_set_takes_the_place_of_another_and_counts_as_a_use() -> None:
    removed: list[str] = []
    items: LruDict[str, int] = LruDict(2, on_remove=removed.append)
    items.put("a", 1)
    items.put("b", 2)
    items.put("a", 3)
    assert (items.get("a"), items.get("b"), removed) == (3, 2, [])
    items.put("c", 4)
    assert (items.keys(), removed) == (("a", "c"), ["b"])


BLOCK_BYTES = 100_000  # below the least size that glibc asks the system for
NUM_BLOCKS = 400


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc alone has malloc_trim")
def test_gaps_between_blocks_in_use_are_given_back() -> None:
    blocks = [np.ones(BLOCK_BYTES, dtype=np.uint8) for _ in range(NUM_BLOCKS)]
    kept = blocks[::2]
    del blocks
    before_mb = resident_mb(os.getpid())
    release_freed_memory()
    # 20 MB are free; half of it, since blocks share their first and last pages with neighbours.
    assert resident_mb(os.getpid()) < before_mb - 10.0
    assert all(block[0] == 1 for block in kept)


INFINITY = resource.RLIM_INFINITY


@pytest.mark.parametrize(
    ("soft", "hard", "raised"),
    [
        (1024, 4096, 4096),
        (1024, 1024, 1024),
        (1024, 1_000_000, 65_536),
        (1024, INFINITY, 65_536),
        (100_000, 1_000_000, 100_000),
        (INFINITY, INFINITY, INFINITY),
    ],
)
def test_soft_limit_is_raised_and_never_lowered(
    monkeypatch: pytest.MonkeyPatch, soft: int, hard: int, raised: int
) -> None:
    limits = [(soft, hard)]
    monkeypatch.setattr(resource, "getrlimit", lambda _: limits[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, new: limits.append(new))
    assert raise_descriptor_limit() == raised
    assert limits[-1] == (raised, hard)


def test_processors_are_those_of_the_affinity_mask(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {1, 5, 6}, raising=False)
    assert count_processors() == 3


@pytest.mark.parametrize(("count", "expected"), [(8, 8), (None, 1)])
def test_processors_without_an_affinity_mask_are_those_of_the_machine(
    monkeypatch: pytest.MonkeyPatch, count: int | None, expected: int
) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: count)
    assert count_processors() == expected
