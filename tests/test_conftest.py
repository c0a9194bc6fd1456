"""No test uses the user's cache folder; tests are no part of garbage collections."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest

from catoptra_server.runtime.array_cache import find_cache_folder


def test_cache_of_tests_is_their_own(cache_folder: Path) -> None:
    assert find_cache_folder("costs").is_relative_to(cache_folder)
    assert not cache_folder.is_relative_to(Path.home() / ".cache")


def test_collections_of_garbage_leave_out_tests_and_keep_what_they_make(
    request: pytest.FixtureRequest,
) -> None:
    collected = [id(each) for each in gc.get_objects()]
    assert id(request.node) not in collected
    made = [[]]
    assert id(made) in [id(each) for each in gc.get_objects()]
