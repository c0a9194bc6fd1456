"""Files beside a mesh file: found inside its folder, within the budget."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.runtime.memory import MIB, MemoryBudget
from catoptra_server.world.mesh_assets import MeshAssets
from helpers.mesh_file_samples import make_announcing_png


@pytest.mark.parametrize("name", ["m.mtl", " m.mtl ", "/m.mtl", "elsewhere/m.mtl"])
def test_file_is_found_in_the_folder_by_its_name(tmp_path: Path, name: str) -> None:
    (tmp_path / "m.mtl").write_bytes(b"abc")
    assets = MeshAssets(tmp_path, MemoryBudget())
    assert assets.get(name) == assets[name] == b"abc"


@pytest.mark.parametrize("name", ["../secret", "/etc/hostname", "", "missing"])
def test_file_outside_the_folder_is_not_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret").write_bytes(b"abc")
    folder = tmp_path / "meshes"
    folder.mkdir()
    with pytest.raises(FileNotFoundError):
        MeshAssets(folder, MemoryBudget()).get(name)


def test_file_of_40_gb_is_rejected_unread(tmp_path: Path) -> None:
    with (tmp_path / "m.bin").open("wb") as file:
        file.truncate(40 * 10**9)  # sparse: takes no space on the disk
    assets = MeshAssets(tmp_path, MemoryBudget())
    with pytest.raises(ConfigError, match=r"m\.bin: File='40000000000 bytes'.*a smaller file"):
        assets.get("m.bin")
    assert assets.rejection is not None


def test_image_that_announces_gigabytes_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "m.PNG").write_bytes(make_announcing_png(10_000, 10_000))
    with pytest.raises(ConfigError, match=r"m\.PNG: Texture='10000 x 10000 px'"):
        MeshAssets(tmp_path, MemoryBudget(100 * MIB)).get("m.PNG")
