"""The affinity mask counts, where the system has one."""

from __future__ import annotations

import os

import pytest

from catoptra_server.runtime.memory import count_processors


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
