"""No test uses the user's cache folder."""

from __future__ import annotations

from pathlib import Path

from catoptra_server.planning.cost_cache import default_cache_folder


def test_cache_of_tests_is_their_own(cache_folder: Path) -> None:
    assert default_cache_folder().is_relative_to(cache_folder)
    assert not cache_folder.is_relative_to(Path.home() / ".cache")
