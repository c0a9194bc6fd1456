"""Limit of open files: raised to the hard limit, within bounds."""

from __future__ import annotations

import resource

import pytest

from catoptra_server.runtime.memory import MAX_DESCRIPTORS, raise_descriptor_limit

INFINITY = resource.RLIM_INFINITY


@pytest.mark.parametrize(
    ("soft", "hard", "raised"),
    [
        (1024, 4096, 4096),
        (1024, 1024, 1024),
        (1024, 1_000_000, MAX_DESCRIPTORS),
        (1024, INFINITY, MAX_DESCRIPTORS),
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
