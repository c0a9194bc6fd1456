"""Data sets that `catoptra-server dataset` has drawn, read sample by sample.

    for sample in open_dataset("out/field_tour"):
        sample.rgb, sample.channels["range"], sample.camera, sample.world_from_camera

Shards are read one after the other by the standard library, and no more than a sample is in memory.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.shards import (
    CHANNEL_FILES,
    FORMAT_VERSION,
    MANIFEST_NAME,
    METADATA,
    PICTURE,
    UNFINISHED_NAME,
    StoredSample,
    decompress_file,
    hash_file,
    iterate_samples,
)


@dataclass(frozen=True, eq=False)
class DatasetSample:
    """One sample: picture, ground truth and how it was taken."""

    key: str
    """Name in files, such as 000042."""
    rgb: npt.NDArray[np.uint8]
    """(h, w, 3) picture."""
    channels: Mapping[str, npt.NDArray[Any]]
    """Ground truth by the names of `labels/__init__.py`, in the types given there."""
    metadata: Mapping[str, Any]
    """World, robot, poses, light, effects, plan, error bound: the sample's JSON file."""

    @cached_property
    def camera(self) -> OmniCamera:
        """Camera model of the picture."""
        return omni_camera_from_pairs(tuple((k, v) for k, v in self.metadata["camera_model"]))[0]

    @cached_property
    def world_from_camera(self) -> Pose:
        """Pose of the mirror frame, whose origin is the effective viewpoint."""
        return _pose(self.metadata["world_from_camera"])

    @cached_property
    def world_from_robot(self) -> Pose:
        """Pose of the chassis."""
        return _pose(self.metadata["world_from_robot"])


def _pose(described: Mapping[str, Sequence[float]]) -> Pose:
    return Pose(
        _rotation(described["quaternion_xyzw"]), np.array(described["position_m"], dtype=float)
    )


def _rotation(quaternion: Sequence[float]) -> npt.NDArray[np.float64]:
    """(3, 3) rotation of a unit quaternion x, y, z, w."""
    *vector, w = quaternion
    v = np.array(vector)
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: npt.NDArray[np.float64] = (
        (w * w - v @ v) * np.eye(3) + 2.0 * np.outer(v, v) + 2.0 * w * cross
    )
    return rotation


class Dataset:
    """A whole data set; iterating reads its samples in order."""

    def __init__(self, folder: Path, manifest: Mapping[str, Any]) -> None:
        """Use `open_dataset`."""
        self.folder = folder
        self.manifest = manifest
        """Content of dataset.json: recipe, versions, cameras, hashes."""

    def __len__(self) -> int:
        """Number of samples."""
        return int(self.manifest["samples"])

    @property
    def shards(self) -> tuple[Path, ...]:
        """Shards, in order: a WebDataset's tar files."""
        return tuple(self.folder / shard["path"] for shard in self.manifest["shards"])

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that every sample has."""
        return tuple(self.manifest["channels"])

    def __iter__(self) -> Iterator[DatasetSample]:
        """Iterate over all samples."""
        return self.iterate()

    def iterate(
        self, *, channels: Sequence[str] | None = None, shards: Sequence[int] | None = None
    ) -> Iterator[DatasetSample]:
        """Yield samples in order.

        Args:
            channels: Channels to read; None for all. Files of others are skipped, not read.
            shards: Numbers of the shards to read, such as every eighth in one of eight processes;
                None for all.

        Raises:
            CatoptraError: There is no such channel, or a shard is damaged.
        """
        wanted = self.channels if channels is None else tuple(channels)
        unknown = sorted(set(wanted) - set(self.channels))
        if unknown:
            known = ", ".join(self.channels) or "none"
            raise CatoptraError(f"{self.folder} has no channel {unknown[0]}: it has {known}")
        suffixes = frozenset({PICTURE, METADATA, *(CHANNEL_FILES[name] for name in wanted)})
        for number in range(len(self.shards)) if shards is None else shards:
            for stored in iterate_samples(self.shards[number], suffixes):
                yield _decode_sample(self.shards[number], stored, wanted)

    def verify(self) -> None:
        """Compare the hash of every shard.

        Raises:
            CatoptraError: A shard is missing, or is not as it was written.
        """
        for path, shard in zip(self.shards, self.manifest["shards"], strict=True):
            if hash_file(path) != shard["sha256"]:
                raise CatoptraError(f"{path} is not as it was written: its hash differs")


def open_dataset(path: str | Path, *, verify: bool = False) -> Dataset:
    """Open a data set.

    Args:
        path: Its folder.
        verify: Compare the hashes of all shards first, at the speed of the disk.

    Raises:
        CatoptraError: There is no whole data set, or it is damaged.
    """
    folder = Path(path)
    manifest_path = folder / MANIFEST_NAME
    if not manifest_path.exists() and (folder / UNFINISHED_NAME).exists():
        raise CatoptraError(f"{folder} is not finished: run the command of its recipe again")
    try:
        manifest = json.loads(manifest_path.read_text(encoding="utf-8"))
        version = manifest["format"]
        dataset = Dataset(folder, {name: manifest[name] for name in manifest})
        is_complete = {"samples", "shards", "channels"} <= set(manifest)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CatoptraError(f"{folder} holds no data set: {manifest_path}: {error}") from error
    if version != FORMAT_VERSION or not is_complete:
        raise CatoptraError(f"{manifest_path} is of format {version}: not {FORMAT_VERSION}")
    if verify:
        dataset.verify()
    return dataset


def decode_file(suffix: str, content: bytes) -> npt.NDArray[Any] | None:
    """Array of one file of a sample, of the picture or a channel, compressed or not; None for
    others. A decoder for webdataset, whose own ones clip the 16 bits of ids and classes to 255:

        webdataset.WebDataset("out/mine/shards/{000000..000007}.tar").decode(decode_file)

    Args:
        suffix: Suffix of the file, with or without a point before: ids.png, range.npy.zst.
        content: The file.

    Raises:
        CatoptraError: zstandard is missing, or the file is damaged.
    """
    plain, content = decompress_file(suffix.removeprefix("."), content)
    if plain == PICTURE:
        return _decode_picture(content)
    channel = next((name for name, file in CHANNEL_FILES.items() if file == plain), None)
    return None if channel is None else _decode_channel(channel, content)


def _decode_sample(path: Path, stored: StoredSample, channels: Sequence[str]) -> DatasetSample:
    try:
        return DatasetSample(
            stored.key,
            _decode_picture(stored.files[PICTURE]),
            {name: _decode_channel(name, stored.files[CHANNEL_FILES[name]]) for name in channels},
            json.loads(stored.files[METADATA]),
        )
    except (KeyError, ValueError, EOFError, cv2.error) as error:
        raise CatoptraError(f"{path}: sample {stored.key} cannot be read: {error}") from error


def _decode_picture(content: bytes) -> npt.NDArray[np.uint8]:
    bgr = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ValueError(f"{PICTURE} is no picture")
    rgb: npt.NDArray[np.uint8] = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
    return rgb


def _decode_channel(name: str, content: bytes) -> npt.NDArray[Any]:
    """Array of a channel, in the type of `labels/__init__.py`."""
    array: npt.NDArray[Any] | None
    if CHANNEL_FILES[name].endswith(".png"):
        array = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    else:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    if array is None:
        raise ValueError(f"{CHANNEL_FILES[name]} is no picture")
    return array.astype(LABEL_CHANNELS[name].dtype)
