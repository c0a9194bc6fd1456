"""Files beside a mesh file: found by the names of other machines, inside its folder and budget."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.runtime.memory import MIB, MemoryBudget
from catoptra_server.world.mesh_assets import Losses, MeshAssets
from catoptra_server.world.textures import TextureReader
from catoptra_server.world.world_description import MeshFile
from helpers.mesh_file_samples import make_announcing_png, make_quadrant_image


def make_assets(folder: Path, limit_bytes: int = 100 * MIB) -> MeshAssets:
    path = folder / "m.obj"
    textures = TextureReader(MemoryBudget(limit_bytes))
    return MeshAssets(MeshFile(path), textures, Losses(path))


@pytest.mark.parametrize(
    "name",
    [
        "m.mtl",
        " m.mtl ",
        "/m.mtl",
        "elsewhere/m.mtl",
        "a\\m.mtl",
        "M.MTL",
        "%6d.mtl",
        "C:\\b\\m.mtl",
    ],
)
def test_file_is_found_in_the_folder_by_its_name(tmp_path: Path, name: str) -> None:
    (tmp_path / "m.mtl").write_bytes(b"abc")
    assets = make_assets(tmp_path)
    assert assets.get(name) == b"abc"


@pytest.mark.parametrize(
    "name", ["../secret", "..%2fsecret", "/etc/hostname", "", ".", "missing", "a\0b", 5000 * "a"]
)
def test_file_outside_the_folder_is_not_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret").write_bytes(b"abc")
    folder = tmp_path / "model"
    folder.mkdir()
    with pytest.raises(FileNotFoundError, match="a file inside"):
        make_assets(folder).get(name)


@pytest.mark.parametrize("name", ["link", "LINK", "folder/secret"])
def test_link_out_of_the_folder_is_not_followed(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret").write_bytes(b"abc")
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path / "secret")
    (folder / "folder").symlink_to(tmp_path)
    with pytest.raises(FileNotFoundError):
        make_assets(folder).get(name)


def test_file_of_40_gb_is_rejected_unread(tmp_path: Path) -> None:
    with (tmp_path / "m.bin").open("wb") as file:
        file.truncate(40 * 10**9)  # sparse: takes no space on the disk
    with pytest.raises(ConfigError, match=r"m\.bin: File='40000000000 bytes'.*a smaller file"):
        make_assets(tmp_path).get("m.bin")


def test_image_that_announces_gigabytes_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "m.PNG").write_bytes(make_announcing_png(10_000, 10_000))
    with pytest.raises(ConfigError, match=r"m\.PNG: Texture='10000 x 10000 px'"):
        make_assets(tmp_path).get_texture("m.PNG", "material paint")


def test_texture_of_two_names_is_read_once(tmp_path: Path) -> None:
    make_quadrant_image().save(tmp_path / "q.png")
    assets = make_assets(tmp_path)
    first = assets.get_texture("q.png", "material a")
    assert assets.get_texture("elsewhere\\Q.PNG", "material b") is first


def test_loss_is_logged_once_with_its_effect_and_number(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    losses = Losses(tmp_path / "m.obj")
    for _ in range(3):
        losses.add("bump map", "flat")
    losses.add("skin", "as stored")
    with caplog.at_level(logging.WARNING):
        losses.log()
    path = tmp_path / "m.obj"
    assert [record.getMessage() for record in caplog.records] == [
        f"{path}: bump map: flat (3 times)",
        f"{path}: skin: as stored (once)",
    ]
