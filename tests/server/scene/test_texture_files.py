"""Image files: modes and formats, damage, and sizes that are announced."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.runtime.memory import MIB, MemoryBudget
from catoptra_server.world.textures import load_texture, read_image_size
from helpers.mesh_file_samples import make_announcing_png, make_quadrant_image


@pytest.mark.parametrize("mode", ["L", "P", "RGBA", "CMYK", "1", "I;16"])
def test_texture_of_any_mode_is_rgb(tmp_path: Path, mode: str) -> None:
    path = tmp_path / ("q.tif" if mode == "CMYK" else "q.png")
    make_quadrant_image().convert("I" if mode == "I;16" else mode).convert(mode).save(path)
    assert load_texture(path).shape == (2, 2, 3)


@pytest.mark.parametrize("content", [b"", b"garbage", b"\x89PNG\r\n\x1a\n" + bytes(50)])
def test_texture_that_is_no_image_is_rejected_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "q.png"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"q\.png: Texture=.*expected an image file"):
        load_texture(path)


def test_truncated_texture_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "q.png"
    make_quadrant_image().resize((64, 64)).save(path)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ConfigError, match="an image file"):
        load_texture(path)


@pytest.mark.parametrize("side_px", [7000, 13_300, 60_000])
def test_texture_that_announces_gigabytes_is_rejected_undecoded(
    tmp_path: Path, side_px: int
) -> None:
    path = tmp_path / "q.png"
    path.write_bytes(make_announcing_png(side_px, side_px))
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError, match=r"q\.png: Texture=.*(a smaller image|exceeds limit)"):
            load_texture(path)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def test_textures_count_together(tmp_path: Path) -> None:
    path, memory = tmp_path / "q.png", MemoryBudget(5 * MIB)
    make_quadrant_image().resize((300, 300)).save(path)
    load_texture(path, memory)
    with pytest.raises(ConfigError, match=r"'300 x 300 px'.*7 MiB"):
        load_texture(path, memory)


def test_texture_of_a_format_that_needs_another_program_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "q.eps"
    make_quadrant_image().save(path)
    with pytest.raises(ConfigError, match="an image file"):
        load_texture(path)


def test_size_of_an_image_is_read_from_its_first_bytes() -> None:
    assert read_image_size(make_announcing_png(70, 50), SourceLocation("q.png")) == (70, 50)
