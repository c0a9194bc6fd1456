"""The folder of a data set: begun, resumed, finished; never one that only looks whole.

While shards are drawn, `unfinished.json` says what the folder is going to hold. The manifest
`dataset.json` takes its place at the very end, so a folder with a manifest is whole.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels.channels import LABEL_CHANNELS
from catoptra_protocol.shards import FORMAT_VERSION, MANIFEST_NAME, UNFINISHED_NAME
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.recipe import Recipe
from catoptra_server.datasets.shard_writer import (
    ShardRecord,
    read_record,
    remove_parts,
    write_whole,
)

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
    """Make a folder ready for a data set; whether it already holds the whole one.

    Raises:
        CatoptraError: The folder holds something else: another recipe's samples, those of other
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
    sizes = [min_sample_bytes(stage, number) for number in range(len(stage.cameras))]
    needed = num_samples * sum(sizes) // len(sizes)
    free = shutil.disk_usage(folder).free
    if free < needed:
        raise CatoptraError(
            f"{folder} has {free / 1e9:.1f} GB of free space, and {num_samples} samples take at "
            f"least {needed / 1e9:.1f} GB: free space, name another folder or lower Samples"
        )


def min_sample_bytes(stage: DatasetStage, camera: int) -> int:
    """Least size of a sample's files: channels that are not compressed, and very flat pictures."""
    optics = stage.cameras[camera].spec.camera
    pixel_bytes = 3.0 * _MIN_PNG_FRACTION
    for name in stage.recipe.channels:
        channel = LABEL_CHANNELS[name]
        size = np.dtype(channel.dtype).itemsize * channel.depth
        # Normals are stored as float16, integers as PNG.
        size_fraction = {"f": 1.0, "u": _MIN_PNG_FRACTION}[np.dtype(channel.dtype).kind]
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
        identity: As it was begun.
        records: Records of all shards.
        details: Further members of the manifest.
    """
    shards = [record.to_json() for record in sorted(records, key=lambda one: one.number)]
    content = {**identity.to_json(), **details, "shards": shards}
    write_whole(folder / MANIFEST_NAME, [json.dumps(content, indent=1, sort_keys=True).encode()])
    (folder / UNFINISHED_NAME).unlink(missing_ok=True)
