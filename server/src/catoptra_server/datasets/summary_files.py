"""Files beside the shards: calibrations, trajectories, COCO annotations, a Parquet index.

They are read back from the metadata of the samples, of which the shards' other files are skipped,
so that they hold what the shards hold.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from catoptra_protocol.calibration.calibration_folder import write_calibration
from catoptra_protocol.camera_conf import pairs_from_omni_camera
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels.masks import CocoImage, coco_from_images
from catoptra_protocol.shards import METADATA, PICTURE, iterate_samples, shard_name
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.parquet_index import write_parquet_index
from catoptra_server.datasets.recipe import Recipe
from catoptra_server.datasets.shard_writer import write_whole

CALIBRATION_FOLDER = "calibration"
COCO_NAME = "annotations.json"
TRAJECTORY_FOLDER = "trajectories"

# Members of an annotation that a COCO file has.
_COCO_MEMBERS = (
    *("id", "name", "class", "area_px", "box_px", "mask"),
    *("spherical_box", "occluded_fraction"),
)


def iterate_metadata(folder: Path, recipe: Recipe) -> Iterator[dict[str, Any]]:
    """Yield the metadata of all samples, in order.

    Raises:
        CatoptraError: A shard is missing or damaged.
    """
    for number in range(recipe.num_shards):
        path = folder / shard_name(number)
        for sample in iterate_samples(path, frozenset({METADATA})):
            try:
                yield json.loads(sample.files[METADATA])
            except (KeyError, ValueError) as error:
                raise CatoptraError(f"{path}: sample {sample.key} has no metadata") from error


def write_summaries(folder: Path, stage: DatasetStage) -> None:
    """Write the files that a recipe asks for.

    Raises:
        CatoptraError: A shard cannot be read, a file not written, or a package is missing.
    """
    recipe = stage.recipe
    for camera in stage.cameras:
        calibration = folder / CALIBRATION_FOLDER / camera.name
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
    if "coco" in recipe.formats:
        content = coco_from_images([_coco_image(one) for one in iterate_metadata(folder, recipe)])
        write_whole(folder / COCO_NAME, [json.dumps(content, sort_keys=True).encode()])
    if "tum" in recipe.formats:
        _write_trajectories(folder, recipe)
    if "parquet" in recipe.formats:
        write_parquet_index(folder, iterate_metadata(folder, recipe))


def describe_cameras(folder: Path, stage: DatasetStage) -> dict[str, Any]:
    """Members of the manifest: each camera's model, and its calibration files."""
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
                for path in (folder / CALIBRATION_FOLDER / camera.name).iterdir()
            ),
        }
        for camera in stage.cameras
    }


def _coco_image(metadata: Mapping[str, Any]) -> CocoImage:
    width_px, height_px = metadata["size_px"]
    # All images are in memory at once: without outlines and corners, four fifths of a record.
    objects = [{name: one[name] for name in _COCO_MEMBERS} for one in metadata["objects"]]
    return CocoImage(f"{metadata['key']}.{PICTURE}", width_px, height_px, objects)


def _write_trajectories(folder: Path, recipe: Recipe) -> None:
    """Write the camera's poses of each sequence as TUM's text: t x y z qx qy qz qw a line."""
    lines: list[str] = []
    sequence = 0
    for metadata in iterate_metadata(folder, recipe):
        if metadata["sequence"] != sequence:
            _write_trajectory(folder, sequence, lines)
            sequence, lines = metadata["sequence"], []
        lines.append(_trajectory_line(metadata))
    _write_trajectory(folder, sequence, lines)


def _write_trajectory(folder: Path, sequence: int, lines: list[str]) -> None:
    path = folder / TRAJECTORY_FOLDER / f"{sequence:06d}.txt"
    write_whole(path, ["".join(lines).encode()])


def _trajectory_line(metadata: Mapping[str, Any]) -> str:
    pose = metadata["world_from_camera"]
    numbers = (metadata["time_s"], *pose["position_m"], *pose["quaternion_xyzw"])
    return " ".join(f"{number:.9g}" for number in numbers) + "\n"
