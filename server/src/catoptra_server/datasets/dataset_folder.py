"""The folder of a data set: begun, resumed, finished, read back; never one that only looks whole.

While shards are drawn, `unfinished.json` says what the folder is going to hold. The manifest
`dataset.json` replaces that file at the very end, so a folder with a manifest is whole. Beside the
shards are calibrations, and the files of `writers`.
"""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.calibration.calibration_folder import write_calibration
from catoptra_protocol.camera_conf import pairs_from_omni_camera
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.shards import (
    CHANNEL_FILES,
    FORMAT_VERSION,
    MANIFEST_NAME,
    METADATA,
    PICTURE,
    UNFINISHED_NAME,
    StoredSample,
    hash_file,
    iterate_samples,
    shard_name,
)
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.png_files import decode_png
from catoptra_server.datasets.recipe import Recipe
from catoptra_server.datasets.shards import (
    ShardRecord,
    read_record,
    remove_parts,
    write_whole,
)
from catoptra_server.datasets.writers import open_writers

_CALIBRATION_FOLDER = "calibration"
# The least that PNG files and metadata take, of their raw size: pictures of flat colours.
_MIN_PNG_FRACTION = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class DatasetIdentity:
    """What tells two data sets apart."""

    recipe_name: str
    digest: str
    """Of recipe, worlds and cameras."""
    environment: Mapping[str, str]
    recipe_text: str

    def to_json(self) -> dict[str, Any]:
        """Members that manifest and unfinished.json share."""
        return {
            "format": FORMAT_VERSION,
            "name": self.recipe_name,
            "digest": self.digest,
            "environment": dict(self.environment),
            "recipe": self.recipe_text,
        }


def open_folder(folder: Path, identity: DatasetIdentity) -> bool:
    """Make a folder ready for a data set; True where the whole one is there already.

    Raises:
        CatoptraError: The folder holds something else: samples of another recipe or of other
            code, or files that are no data set's.
    """
    found = _read_identity(folder)
    if found is not None:
        _require_same(folder, found, identity)
        if (folder / MANIFEST_NAME).exists():
            return True
        remove_parts(folder)
        return False
    if folder.exists() and any(folder.iterdir()):
        raise CatoptraError(f"{folder} is not empty, and holds no data set: name another folder")
    content = json.dumps(identity.to_json(), indent=1).encode()
    write_whole(folder / UNFINISHED_NAME, [content])
    return False


def _read_identity(folder: Path) -> dict[str, Any] | None:
    """Identity of the data set in a folder; None for none."""
    for name in (MANIFEST_NAME, UNFINISHED_NAME):
        path = folder / name
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (FileNotFoundError, NotADirectoryError):
            continue
        except (OSError, ValueError) as error:
            raise CatoptraError(f"{path} cannot be read: {error}") from error
        if not isinstance(content, dict):
            raise CatoptraError(f"{path} is no manifest of a data set")
        return content
    return None


def _require_same(folder: Path, found: Mapping[str, Any], identity: DatasetIdentity) -> None:
    """Raise CatoptraError unless a folder was begun with the same recipe and code."""
    if found.get("digest") != identity.digest:
        raise CatoptraError(
            f"{folder} holds samples of another recipe ({found.get('name', 'unnamed')}), or its "
            "worlds or robots have changed since: name another folder, or remove this one"
        )
    before, now = found.get("environment", {}), identity.environment
    different = [name for name in {**before, **now} if before.get(name) != now.get(name)]
    if different:
        raise CatoptraError(
            f"{folder} was begun with another {', '.join(sorted(different))}: shards would not "
            "match; go on with that installation, or name another folder"
        )


def find_finished_shards(folder: Path, recipe: Recipe) -> list[ShardRecord]:
    """Records of the shards that are whole, their hashes compared."""
    records = (read_record(folder, number) for number in range(recipe.num_shards))
    return [record for record in records if record is not None]


def require_space(folder: Path, stage: DatasetStage, num_samples: int) -> None:
    """Raise CatoptraError where a disk has less room than samples take at the very least.

    Args:
        folder: Folder on the disk, which exists.
        stage: Cameras and channels.
        num_samples: Samples to be drawn.
    """
    sizes = [_min_sample_bytes(stage, number) for number in range(len(stage.cameras))]
    needed = num_samples * sum(sizes) // len(sizes)
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise CatoptraError(
            f"{folder} has {_describe_size(free)} of free space, and {num_samples} samples take at "
            f"least {_describe_size(needed)}: free space, name another folder or lower Samples"
        )


def _describe_size(num_bytes: int) -> str:
    """Size to three digits: 712 bytes, 4.12 MB."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if num_bytes >= size:
            number = num_bytes / size
            return f"{number:.0f} {unit}" if number >= 100.0 else f"{number:.3g} {unit}"
    return f"{num_bytes} bytes"


def _min_sample_bytes(stage: DatasetStage, camera: int) -> int:
    """Least size of a sample's files: channels that are not compressed, and very flat pictures."""
    optics = stage.cameras[camera].spec.camera
    float_fraction = 1.0 if stage.recipe.compression == "none" else _MIN_PNG_FRACTION
    pixel_bytes = 3.0 * _MIN_PNG_FRACTION
    for name in stage.recipe.channels:
        channel = LABEL_CHANNELS[name]
        size = np.dtype(channel.dtype).itemsize * channel.depth
        # Normals are stored as float16, integers as PNG.
        size_fraction = {"f": float_fraction, "u": _MIN_PNG_FRACTION}[np.dtype(channel.dtype).kind]
        pixel_bytes += size * size_fraction * (0.5 if name == "normal" else 1.0)
    return int(pixel_bytes * optics.width_px * optics.height_px)


def finish_folder(
    folder: Path,
    identity: DatasetIdentity,
    records: Sequence[ShardRecord],
    details: Mapping[str, Any],
) -> None:
    """Write the manifest, which makes a data set whole.

    Args:
        folder: The folder.
        identity: Identity at the beginning.
        records: Records of all shards.
        details: Further members of the manifest.
    """
    shards = [record.to_json() for record in sorted(records, key=lambda one: one.number)]
    content = {**identity.to_json(), **details, "shards": shards}
    write_whole(folder / MANIFEST_NAME, [json.dumps(content, indent=1, sort_keys=True).encode()])
    (folder / UNFINISHED_NAME).unlink(missing_ok=True)


def read_manifest(folder: Path) -> dict[str, Any]:
    """Manifest of a whole data set.

    Raises:
        CatoptraError: The folder holds none, or one that is not finished.
    """
    path = folder / MANIFEST_NAME
    if not path.exists() and (folder / UNFINISHED_NAME).exists():
        raise CatoptraError(f"{folder} is not finished: run the command of its recipe again")
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        if manifest["format"] != FORMAT_VERSION:
            raise CatoptraError(f"{path} is of format {manifest['format']}: not {FORMAT_VERSION}")
        return {name: manifest[name] for name in ("name", "channels", "shards", "samples")}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CatoptraError(f"{path} is no manifest of a data set: {error}") from error


def verify_dataset(folder: Path) -> Iterator[str]:
    """Read a data set back, and yield a line about each shard.

    Raises:
        CatoptraError: Something is missing or damaged; names file and sample.
    """
    manifest = read_manifest(folder)
    suffixes = {PICTURE, METADATA, *(CHANNEL_FILES[name] for name in manifest["channels"])}
    num_samples = 0
    for shard in manifest["shards"]:
        path = folder / shard["path"]
        if hash_file(path) != shard["sha256"]:
            raise CatoptraError(f"{path} has another hash than {MANIFEST_NAME}: it is damaged")
        keys = [_check_sample(path, sample, suffixes) for sample in iterate_samples(path)]
        if len(keys) != shard["samples"] or keys != sorted(set(keys)):
            raise CatoptraError(f"{path} has {len(keys)} samples instead of {shard['samples']}")
        num_samples += len(keys)
        yield f"{path}: {len(keys)} samples, {shard['bytes']} bytes"
    if num_samples != manifest["samples"]:
        raise CatoptraError(f"{folder} has {num_samples} of {manifest['samples']} samples")
    yield f"{folder}: all {num_samples} samples are as they were written"


def _check_sample(path: Path, sample: StoredSample, suffixes: set[str]) -> str:
    """Check the files of a sample; the sample's name."""
    if set(sample.files) != suffixes:
        different = sorted(set(sample.files) ^ suffixes)
        raise CatoptraError(
            f"{path}: sample {sample.key}: {', '.join(different)} is missing or new"
        )
    try:
        shapes = {
            decode_array(suffix, content).shape[:2]
            for suffix, content in sample.files.items()
            if suffix != METADATA
        }
        key = json.loads(sample.files[METADATA])["key"]
    except (ValueError, KeyError, CatoptraError) as error:
        raise CatoptraError(f"{path}: sample {sample.key} cannot be read: {error}") from error
    if len(shapes) != 1 or key != sample.key:
        raise CatoptraError(f"{path}: sample {sample.key}: its files do not belong together")
    return sample.key


def decode_array(suffix: str, content: bytes) -> np.ndarray[Any, Any]:
    """Array of a sample's file.

    Raises:
        ValueError, DomainError: The file is damaged.
    """
    if suffix.endswith(".png"):
        return decode_png(content)
    array: np.ndarray[Any, Any] = np.load(io.BytesIO(content), allow_pickle=False)
    return array


def describe_cameras(folder: Path, stage: DatasetStage) -> dict[str, Any]:
    """Members of the manifest: each camera's model and calibration files."""
    return {
        camera.name: {
            "robot": camera.robot.class_name,
            "model": [
                list(pair)
                for pair in pairs_from_omni_camera(
                    camera.spec.camera, camera.robot.viewpoint_height_m(camera.omni)
                )
            ],
            "calibration": sorted(
                path.relative_to(folder).as_posix()
                for path in (folder / _CALIBRATION_FOLDER / camera.name).iterdir()
            ),
        }
        for camera in stage.cameras
    }


def write_summaries(folder: Path, stage: DatasetStage) -> None:
    """Write the files that a recipe asks for.

    Raises:
        CatoptraError: A shard cannot be read, a file not written, or a package is missing.
    """
    recipe = stage.recipe
    for camera in stage.cameras:
        calibration = folder / _CALIBRATION_FOLDER / camera.name
        try:
            write_calibration(
                camera.spec.camera,
                calibration,
                name=camera.name,
                picture=camera.spec.camera.picture,
                robot_from_mirror=camera.omni.robot_from_mirror.rotation,
            )
        except OSError as error:
            raise CatoptraError(f"{calibration} cannot be written: {error.strerror}") from error
    writers, suffixes = open_writers(folder, stage)
    if writers:
        for metadata, picture in _walk_samples(folder, recipe, suffixes):
            for writer in writers:
                writer.add(metadata, picture)
    for writer in writers:
        writer.finish()


def _walk_samples(
    folder: Path, recipe: Recipe, suffixes: frozenset[str]
) -> Iterator[tuple[dict[str, Any], bytes]]:
    """Yield metadata and picture of all samples, in order; no picture without its suffix.

    Raises:
        CatoptraError: A shard is missing or damaged.
    """
    for number in range(recipe.num_shards):
        path = folder / shard_name(number)
        for sample in iterate_samples(path, suffixes):
            try:
                yield json.loads(sample.files[METADATA]), sample.files.get(PICTURE, b"")
            except (KeyError, ValueError) as error:
                raise CatoptraError(f"{path}: sample {sample.key} has no metadata") from error
