"""Arrays on disk: read back bit for bit, harmless whatever a file holds, within their limit."""

from __future__ import annotations

import builtins
import os
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.runtime.array_cache import ArrayCache, find_cache_folder

ARRAYS = (np.arange(300, dtype=np.float32), np.zeros((2, 0), dtype=np.uint8))


def test_arrays_are_read_back(tmp_path: Path) -> None:
    cache = ArrayCache(tmp_path / "new")
    assert cache.read("one", 2) is None
    cache.write("one", ARRAYS)
    found = cache.read("one", 2)
    assert found is not None
    for array, expected in zip(found, ARRAYS, strict=True):
        np.testing.assert_array_equal(array, expected, strict=True)
        assert not array.flags.writeable
    ArrayCache(None).write("one", ARRAYS)
    assert ArrayCache(None).read("one", 2) is None


def test_arrays_are_read_without_a_parser_of_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Two threads of CPython 3.11.7 may fail in it: AST constructor recursion depth mismatch.
    def refuse(source: object, *_: object, **__: object) -> object:
        raise SystemError(f"{source!r} is parsed")

    cache = ArrayCache(tmp_path)
    cache.write("one", ARRAYS)
    with monkeypatch.context() as patch:
        patch.setattr(builtins, "compile", refuse)
        assert cache.read("one", 2) is not None


def spoil(content: bytes) -> dict[str, bytes]:
    return {
        "empty": b"",
        "cut off": content[: len(content) // 2],
        "a bit changed": content[:900] + bytes([content[900] ^ 1]) + content[901:],
        "foreign": b"#!/bin/sh\n" * 100,
        "digest alone": content[:32],
    }


@pytest.mark.parametrize("kind", spoil(b"." * 1000))
def test_damaged_file_costs_one_warning(
    tmp_path: Path, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    cache = ArrayCache(tmp_path)
    cache.write("one", ARRAYS)
    (file,) = tmp_path.iterdir()
    file.write_bytes(spoil(file.read_bytes())[kind])
    assert cache.read("one", 2) is None
    assert cache.read("one", 2) is None
    assert len(caplog.records) == 1
    cache.write("one", ARRAYS)
    assert cache.read("one", 2) is not None


@pytest.mark.parametrize("below", ["", "folder", "folder/folder"])
def test_unwritable_folder_costs_one_warning(
    tmp_path: Path, below: str, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    cache = ArrayCache(tmp_path / "file" / below)
    for key in ("one", "two"):
        assert cache.read(key, 2) is None
        cache.write(key, ARRAYS)
    assert len(caplog.records) == 1
    assert "cannot be stored" in caplog.text


def test_file_that_was_not_used_for_the_longest_time_goes_first(tmp_path: Path) -> None:
    cache = ArrayCache(tmp_path, max_bytes=4500)
    for age, key in enumerate(("used", "old", "new")):
        cache.write(key, ARRAYS)
        os.utime(tmp_path / f"{key}.arrays", (age, age))
    assert cache.read("used", 2) is not None
    cache.write("newest", ARRAYS)
    assert {file.stem for file in tmp_path.iterdir()} == {"used", "new", "newest"}
    cache.write("huge", [np.zeros(3000, dtype=np.uint8)])
    assert cache.read("huge", 1) is None


def test_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert find_cache_folder("costs") == Path("/somewhere/catoptra/costs")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative paths are invalid")
    assert find_cache_folder("costs") == Path.home() / ".cache/catoptra/costs"
