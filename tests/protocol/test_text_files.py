"""Text files: encodings, and sizes that are checked before memory is taken."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.text_files import read_text_file


def read(path: Path, max_bytes: int = 1000) -> str:
    return read_text_file(path, kind="list", max_bytes=max_bytes)


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_file_with_and_without_a_byte_order_mark_is_its_text(tmp_path: Path, mark: bytes) -> None:
    path = tmp_path / "x.txt"
    path.write_bytes(mark + "é\r\n".encode())
    assert read(path) == "é\r\n"


def test_file_when_not_utf_8_names_the_line_of_the_byte(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_bytes(b"a\nb\n\xfc")
    with pytest.raises(ConfigError, match=r"x\.txt:3.*UTF-8"):
        read(path)


@pytest.mark.parametrize("name", ["missing.txt", ".", "a\0b"])
def test_file_when_unreadable_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="a readable list"):
        read(tmp_path / name)


def test_file_of_just_the_limit_is_read(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_bytes(1000 * b"a")
    assert len(read(path)) == 1000


def test_file_of_40_gb_is_rejected_after_its_first_bytes(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    with path.open("wb") as file:
        file.truncate(40 * 10**9)  # sparse: takes no space on the disk
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError, match="a smaller list: at most 1000 bytes"):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_device_without_a_size_is_rejected() -> None:
    with pytest.raises(ConfigError, match="a smaller list: at most 1000 bytes"):
        read(Path("/dev/zero"))
