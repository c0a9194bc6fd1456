"""Files beside a mesh file, and sizes that glTF files announce: within folder and budget."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.runtime.memory import MIB, MemoryBudget
from catoptra_server.world.mesh_assets import MeshAssets, reserve_gltf
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


WHERE = SourceLocation("m.glb")
HUGE_IMAGE = make_announcing_png(13_300, 13_300)


def reserve(data: bytes, limit_bytes: int = 100 * MIB) -> None:
    def read_asset(name: str) -> bytes:
        assert name == "buffer.bin"
        return HUGE_IMAGE

    reserve_gltf(data, MemoryBudget(limit_bytes), WHERE, read_asset)


def make_glb(header: dict[str, Any], binary: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def make_accessor(count: int, *, kind: str = "VEC3", component: int = 5126) -> dict[str, Any]:
    return {"count": count, "type": kind, "componentType": component}


VIEW_OF_IMAGE = {"buffer": 0, "byteLength": len(HUGE_IMAGE)}
DATA_URI = "data:image/png;base64," + base64.b64encode(HUGE_IMAGE).decode()


@pytest.mark.parametrize(
    "header",
    [
        {"accessors": [make_accessor(10**9)]},
        {"accessors": 1000 * [make_accessor(10**4)]},
        {"accessors": [make_accessor(2 * 10**6, kind="MAT4", component=5121)] * 4},
        {"bufferViews": 1000 * [{"buffer": 0, "byteLength": 2**20}]},
        {"images": [{"bufferView": 0}], "bufferViews": [VIEW_OF_IMAGE], "buffers": [{}]},
        {"images": [{"uri": DATA_URI}]},
        {
            "images": [{"bufferView": 0}],
            "bufferViews": [VIEW_OF_IMAGE],
            "buffers": [{"uri": DATA_URI}],
        },
        {
            "images": [{"bufferView": 0}],
            "bufferViews": [VIEW_OF_IMAGE],
            "buffers": [{"uri": "buffer.bin"}],
        },
    ],
)
def test_file_that_announces_gigabytes_is_rejected(header: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"m\.glb: (File|Texture)=.* MiB"):
        reserve(make_glb(header, HUGE_IMAGE))


@pytest.mark.parametrize("is_binary", [True, False])
def test_file_of_a_triangle_fits(is_binary: bool) -> None:
    header = {"accessors": [make_accessor(3)], "bufferViews": [{"buffer": 0, "byteLength": 36}]}
    reserve(make_glb(header) if is_binary else json.dumps(header).encode(), limit_bytes=72)


def test_negative_count_hides_no_other() -> None:
    header = {"accessors": [make_accessor(10**9), make_accessor(-(10**9))]}
    with pytest.raises(ValueError, match="at least 0"):
        reserve(make_glb(header))


def reserve_or_error(data: bytes) -> Exception | None:
    try:
        reserve(data)
    except (ConfigError, ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        return error
    except struct.error as error:
        return error
    return None


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.sampled_from(["VEC3", "data:,x", "a.png"]),
    lambda inner: (
        st.lists(inner, max_size=2)
        | st.dictionaries(
            st.sampled_from(
                ["count", "type", "componentType", "byteLength", "bufferView", "uri", "buffer"]
            ),
            inner,
            max_size=3,
        )
    ),
    max_leaves=6,
)


@settings(derandomize=True, max_examples=300, deadline=None)
@given(
    st.dictionaries(
        st.sampled_from(["accessors", "bufferViews", "images", "buffers"]), JSON_VALUES, max_size=4
    )
)
def test_header_when_arbitrary_is_counted_or_rejected(header: dict[str, Any]) -> None:
    error = reserve_or_error(make_glb(header))
    assert error is None or str(error) or isinstance(error, KeyError)
