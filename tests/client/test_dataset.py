"""Data sets read by the client's loader, and by webdataset."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.dataset import decode_file, open_dataset
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.optics.camera_rays import rays_from_pixel_grid
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.shards import (
    StoredSample,
    compress_arrays,
    iterate_samples,
    load_zstandard,
)
from catoptra_server.datasets.dataset_folder import verify_dataset
from catoptra_server.datasets.png_files import encode_png
from catoptra_server.datasets.sample import SampleDescriber
from catoptra_server.datasets.sample_renderer import SampleRenderer
from catoptra_server.datasets.shards import write_shard
from helpers.dataset_recipes import stage_recipe, write_drive
from helpers.drawn_datasets import draw_dataset


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a data set of six samples with all channels."""
    root = tmp_path_factory.mktemp("dataset")
    return draw_dataset(write_drive(root), root / "out")


def test_samples_are_those_that_were_drawn(folder: Path) -> None:
    stage = stage_recipe(folder.parent / "recipe.ini")
    describer, renderer = SampleDescriber(stage), SampleRenderer(stage)
    dataset = open_dataset(folder, verify=True)
    samples = [*dataset]
    assert len(samples) == len(dataset) == 6
    for index, sample in enumerate(samples):
        drawn = renderer.render_sample(describer.describe_sample(index))
        assert sample.key == drawn.key
        np.testing.assert_array_equal(sample.rgb, drawn.rgb)
        for name in LABEL_CHANNELS:
            tolerance = 1e-3 if name == "normal" else 0.0  # stored as float16
            np.testing.assert_allclose(
                sample.channels[name], drawn.channels[name], rtol=0.0, atol=tolerance
            )
            assert sample.channels[name].dtype == drawn.channels[name].dtype
    renderer.close()


def test_camera_pose_and_ranges_give_the_points_of_the_world(folder: Path) -> None:
    for sample in open_dataset(folder):
        camera, pose = sample.camera, sample.world_from_camera
        u, v = (np.arange(64) + 0.5,) * 2
        origins, directions, valid = rays_from_pixel_grid(camera, u, v)
        assert origins is None, "a central camera"
        seen = valid & np.isfinite(sample.channels["range"])
        ranges = sample.channels["range"][seen].astype(float)
        points = pose.transform_points(ranges[:, None] * directions[seen])
        np.testing.assert_allclose(points, sample.channels["point"][seen], atol=1e-4)


def test_pose_is_a_rotation(folder: Path) -> None:
    sample = next(iter(open_dataset(folder)))
    for pose in (sample.world_from_camera, sample.world_from_robot):
        assert isinstance(pose, Pose)
        np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


def test_some_channels_and_shards_alone_are_read(folder: Path) -> None:
    dataset = open_dataset(folder)
    samples = [*dataset.iterate(channels=["ids"], shards=[2, 0])]
    assert [sample.key for sample in samples] == ["000004", "000005", "000000", "000001"]
    assert {*samples[0].channels} == {"ids"}
    with pytest.raises(CatoptraError, match="has no channel depth: it has range"):
        next(dataset.iterate(channels=["depth"]))


def test_damage_is_found(folder: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "copy")
    shard = copy / "shards/000001.tar"
    content = bytearray(shard.read_bytes())
    # In the first file of the first sample, behind its header.
    content[512:600] = bytes(88)
    shard.write_bytes(bytes(content))
    with pytest.raises(CatoptraError, match=r"000001\.tar is not as it was written"):
        open_dataset(copy, verify=True)
    with pytest.raises(CatoptraError, match=r"000001\.tar: sample 000002 cannot be read"):
        list(open_dataset(copy))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none", "", "holds no data set"),
        ("dataset.json", "{", "holds no data set"),
        ("dataset.json", "[]", "holds no data set"),
        ("dataset.json", '{"format": 7, "samples": 1}', "is of format 7: not 1"),
        ("unfinished.json", "{}", "is not finished"),
    ],
)
def test_folder_without_a_whole_data_set_is_an_error(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(CatoptraError, match=message):
        open_dataset(tmp_path)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_webdataset_reads_the_shards(folder: Path) -> None:
    webdataset = pytest.importorskip("webdataset", reason="needs the package webdataset")
    urls = [str(path) for path in open_dataset(folder).shards]
    found = [*webdataset.WebDataset(urls, shardshuffle=False)]
    expected = [*open_dataset(folder)]
    assert [sample["__key__"] for sample in found] == [sample.key for sample in expected]
    assert {"rgb.png", "range.npy", "ids.png", "normal.npy", "flow.npy", "json"} <= set(found[0])


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_webdataset_decodes_large_numbers_by_the_decoder_of_here(
    folder: Path, tmp_path: Path
) -> None:
    webdataset = pytest.importorskip("webdataset", reason="needs the package webdataset")
    _, stored = compress_sample(folder, "000003")
    stored |= {"ids.png": encode_png(np.full((4, 5), 40_000, np.uint16))}
    write_shard(tmp_path, 0, [("000003", stored)])
    urls = [str(tmp_path / "shards/000000.tar")]
    (sample,) = webdataset.WebDataset(urls, shardshuffle=False).decode(decode_file)
    assert sample["ids.png"].max() == 40_000
    expected = next(one for one in open_dataset(folder) if one.key == "000003")
    np.testing.assert_array_equal(sample["rgb.png"], expected.rgb)
    np.testing.assert_array_equal(sample["range.npy.zst"], expected.channels["range"])
    assert sample["json"]["key"] == "000003"


def compress_sample(folder: Path, key: str) -> tuple[StoredSample, dict[str, bytes]]:
    """A sample of a data set, and its files compressed."""
    shards = (iterate_samples(path) for path in open_dataset(folder).shards)
    stored = next(one for shard in shards for one in shard if one.key == key)
    return stored, compress_arrays(stored.files)


def test_compressed_arrays_are_the_same_in_less_room(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("zstandard", reason="needs the extra [zstd]")
    recipe = write_drive(tmp_path, lines=("Channels=all", "Compression=zstd"))
    compressed = draw_dataset(recipe, tmp_path / "out")
    list(verify_dataset(compressed))
    for plain, small in zip(open_dataset(folder), open_dataset(compressed), strict=True):
        assert plain.metadata == small.metadata
        for name, channel in plain.channels.items():
            np.testing.assert_array_equal(small.channels[name], channel)
    sizes = [
        sum(path.stat().st_size for path in open_dataset(one).shards)
        for one in (folder, compressed)
    ]
    assert sizes[1] < 0.7 * sizes[0]


def test_damaged_and_oversized_arrays_are_errors(folder: Path) -> None:
    zstandard = pytest.importorskip("zstandard", reason="needs the extra [zstd]")
    _, files = compress_sample(folder, "000000")
    with pytest.raises(CatoptraError, match=r"range\.npy\.zst is damaged"):
        decode_file("range.npy.zst", files["range.npy.zst"][:-9])
    # A header alone, which states four terabytes.
    header = b"\x28\xb5\x2f\xfd\xe0" + (2**42).to_bytes(8, "little") + b"\x01\x00\x00"
    assert zstandard.frame_content_size(header) == 2**42
    with pytest.raises(CatoptraError, match="states a size"):
        decode_file("range.npy.zst", header)


def test_missing_package_is_an_error_that_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "zstandard", None)
    load_zstandard.cache_clear()
    with pytest.raises(CatoptraError, match=r"catoptra-client\[zstd\]"):
        decode_file(".range.npy.zst", b"")
    recipe = write_drive(tmp_path, lines=("Compression=zstd",))
    with pytest.raises(CatoptraError, match=r"catoptra-server\[zstd\]"):
        draw_dataset(recipe, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    load_zstandard.cache_clear()
