"""Files next to the shards for programs that read no shards: one table, one walk over the samples.

    coco           annotations.json, whose pictures are members of the shards
    coco_folder    coco/annotations/instances.json and coco/images
    yolo           yolo: data.yaml, images and labels, a box a line (ultralytics)
    yolo_polygons  yolo_polygons, the same with an outline a line
    kitti          kitti/training: image_2, label_2 and calib of KITTI's objects
    asl            asl/SEQUENCE/mav0: cam0, imu0 and mocap0, as in EuRoC and TUM-VI
    tum            trajectories/SEQUENCE.txt: t x y z qx qy qz qw a line
    parquet        index.parquet: a row a sample

All are made from the metadata and pictures in the shards, and so agree with them. To add one: a
class with `add` and `finish`, its row in _WRITERS, its word in `recipe.py:FORMATS`.

Source: ultralytics, `verify_image_label`; KITTI's devkit, readme.txt and
`evaluate_object.cpp`; basalt `io/dataset_io_euroc.h`.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels.masks import CocoImage, coco_from_images
from catoptra_protocol.optics.elementary import arctan2, matmul
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.shards import METADATA, PICTURE
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.shards import write_plain, write_whole
from catoptra_server.frames.labels import SceneLabels

_Record = Mapping[str, Any]
_REMEDY = "pip install 'catoptra-server[parquet]', or leave parquet out of the recipe's Formats"
_COLUMNS = ("key", "index", "sequence", "step", "time_s", "world", "camera", "robot", "brightness")
# Members of an annotation that a COCO file has.
_COCO_MEMBERS = (
    *("id", "name", "class", "area_px", "box_px", "mask"),
    *("spherical_box", "occluded_fraction"),
)
# Least occluded fractions of KITTI's levels 1, partly, and 2, largely; 3 is unknown.
_KITTI_OCCLUSIONS = (0.05, 0.5)
# Rows are KITTI's right, down and ahead, columns the robot's ahead, right and down.
_KITTI_AXES = np.array(((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
# From SAE to axes with z up, x kept, of body and world.
_UP = np.array((1.0, -1.0, -1.0))


class SummaryWriter(Protocol):
    """Writer of one format, to which a walk over the samples gives each of them in order."""

    def add(self, metadata: _Record, picture: bytes) -> None:
        """Take a sample; the picture is a PNG file, empty for formats without pictures."""

    def finish(self) -> None:
        """Write what comes last."""


class _CocoWriter:
    def __init__(self, path: Path, stage: DatasetStage, images: Path | None = None) -> None:
        self._path, self._folder, self._stage = path, images, stage
        self._images: list[CocoImage] = []

    def add(self, metadata: _Record, picture: bytes) -> None:
        width_px, height_px = metadata["size_px"]
        name = f"{metadata['key']}.{PICTURE if self._folder is None else 'png'}"
        # All images are in memory at once: without outlines and corners, four fifths of a record.
        objects = [{name: one[name] for name in _COCO_MEMBERS} for one in metadata["objects"]]
        self._images.append(CocoImage(name, width_px, height_px, objects))
        if self._folder is not None:
            write_plain(self._folder / name, picture)

    def finish(self) -> None:
        content = coco_from_images(self._images, self._stage.recipe.class_numbers)
        write_whole(self._path, [json.dumps(content, sort_keys=True).encode()])


class _YoloWriter:
    """Boxes, or outlines whose rings are joined by lines to the first point and back."""

    def __init__(self, folder: Path, stage: DatasetStage, describe: Callable[[_Record], str]):
        self._folder, self._describe = folder, describe
        # YOLO counts classes from 0 without gaps: fixed numbers give their order.
        numbers = stage.recipe.class_numbers or {
            name: 0
            for world in range(len(stage.recipe.worlds))
            for name in SceneLabels(stage.world(world).scene).classes
        }
        self._classes = sorted(numbers, key=lambda name: (numbers[name], name))

    def add(self, metadata: _Record, picture: bytes) -> None:
        lines = []
        for one in metadata["objects"]:
            if one["class"] not in self._classes:
                self._classes.append(one["class"])
            text = self._describe({**one, "size_px": metadata["size_px"]})
            lines.append(f"{self._classes.index(one['class'])} {text}\n")
        write_plain(self._folder / "images/train" / f"{metadata['key']}.png", picture)
        labels = self._folder / "labels/train" / f"{metadata['key']}.txt"
        write_plain(labels, "".join(lines).encode())

    def finish(self) -> None:
        names = "".join(f"  {n}: {json.dumps(name)}\n" for n, name in enumerate(self._classes))
        text = f"path: .\ntrain: images/train\nval: images/train\nnames:\n{names}"
        write_whole(self._folder / "data.yaml", [text.encode()])


def _describe_yolo_box(record: _Record) -> str:
    (x, y, width, height), (across, down) = record["box_px"], record["size_px"]
    numbers = (x + 0.5 * width) / across, (y + 0.5 * height) / down, width / across, height / down
    return " ".join(f"{number:.9g}" for number in numbers)


def _describe_yolo_polygon(record: _Record) -> str:
    first, *others = record["polygons"]
    points = [*first, first[0]]
    for ring in others:
        points += [*ring, ring[0], first[0]]
    across, down = record["size_px"]
    return " ".join(f"{x / across:.9g} {y / down:.9g}" for x, y in points)


class _KittiWriter:
    """Objects in a level camera: right, down and ahead of the robot, at the viewpoint."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "kitti/training"

    def add(self, metadata: _Record, picture: bytes) -> None:
        key = metadata["key"]
        kitti_from_world = matmul(_KITTI_AXES, _read_rotation(metadata["world_from_robot"]).T)
        viewpoint = np.array(metadata["world_from_camera"]["position_m"])
        lines = [_describe_kitti(one, kitti_from_world, viewpoint) for one in metadata["objects"]]
        write_plain(self._folder / f"image_2/{key}.png", picture)
        write_plain(self._folder / f"label_2/{key}.txt", "".join(lines).encode())
        write_plain(self._folder / f"calib/{key}.txt", _kitti_calibration(metadata).encode())

    def finish(self) -> None:
        """Do nothing: all files belong to samples."""


def _describe_kitti(record: _Record, kitti_from_world: Floats, viewpoint: Floats) -> str:
    """Line of a label: the box's most upright axis counts as upright, the first other as length."""
    left, top, width, height = record["box_px"]
    box, occluded = record["box_3d"], record["occluded_fraction"]
    level = 3 if occluded is None else sum(occluded >= one for one in _KITTI_OCCLUSIONS)
    axes = matmul(kitti_from_world, np.array(box["rotation"]).reshape(3, 3))
    up = int(np.argmax(np.abs(axes[1])))
    along, across = (axis for axis in range(3) if axis != up)
    size_m = 2.0 * np.array(box["half_size_m"])
    place = matmul(kitti_from_world, np.array(box["position_m"]) - viewpoint)
    # The middle of the lower face.
    place[1] += 0.5 * size_m[up]
    yaw_rad = float(arctan2(-axes[2, along], axes[0, along]))
    alpha_rad = math.remainder(yaw_rad - float(arctan2(place[0], place[2])), 2.0 * math.pi)
    numbers = (
        *(left, top, left + width - 1, top + height - 1),
        *(size_m[up], size_m[across], size_m[along], *place, yaw_rad),
    )
    texts = " ".join(f"{number:.6f}" for number in numbers)
    name = "_".join(record["class"].split())
    return f"{name} {float(record['truncated']):.2f} {level} {alpha_rad:.6f} {texts}\n"


def _kitti_calibration(metadata: _Record) -> str:
    """The camera that readers ask for: a pinhole of 90 degrees, which is not this camera."""
    width, height = metadata["size_px"]
    pinhole = f"{width / 2:g} 0 {width / 2:g} 0 0 {width / 2:g} {height / 2:g} 0 0 0 1 0"
    lines = {f"P{number}": pinhole for number in range(4)}
    lines |= {
        "R0_rect": "1 0 0 0 1 0 0 0 1",
        "Tr_velo_to_cam": "0 -1 0 0 0 0 -1 0 1 0 0 0",
        "Tr_imu_to_velo": "1 0 0 0 0 1 0 0 0 0 1 0",
    }
    return "".join(f"{name}: {numbers}\n" for name, numbers in lines.items())


class _AslWriter:
    """Sequences with z up: the body is the chassis, x ahead, y left; times begin at 1 s, since
    readers take 0 for none."""

    def __init__(self, folder: Path, stage: DatasetStage) -> None:
        self._folder, self._stage = folder / "asl", stage
        self._sequence: list[_Record] = []

    def add(self, metadata: _Record, picture: bytes) -> None:
        if self._sequence and self._sequence[0]["sequence"] != metadata["sequence"]:
            self.finish()
        self._sequence.append({name: one for name, one in metadata.items() if name != "objects"})
        path = self._root(metadata) / f"cam0/data/{_nanoseconds(metadata['time_s'])}.png"
        write_plain(path, picture)

    def _root(self, metadata: _Record) -> Path:
        return self._folder / f"{metadata['sequence']:06d}/mav0"

    def finish(self) -> None:
        samples, self._sequence = self._sequence, []
        if not samples:
            return
        root = self._root(samples[0])
        times = [_nanoseconds(one["time_s"]) for one in samples]
        _write_table(root / "cam0", "filename", ((t, f"{t}.png") for t in times))
        poses = (
            (t, *_UP * pose["position_m"], *np.roll(pose["quaternion_xyzw"] * np.append(_UP, 1), 1))
            for t, pose in zip(times, (one["world_from_robot"] for one in samples), strict=True)
        )
        header = "p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
        _write_table(root / "mocap0", header, poses)
        rows = [row for one in samples for row in one.get("imu", ())]
        step_s = samples[1]["time_s"] - samples[0]["time_s"] if len(samples) > 1 else 1.0
        self._write_camera(root, samples[0], 1.0 / (step_s or 1.0))
        if rows:
            header = ",".join(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz")
            header += "," + ",".join(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz")
            up = np.tile(_UP, 2)
            table = ((_nanoseconds(row[0]), *(up * row[1:])) for row in rows)
            _write_table(root / "imu0", header, table)
            rate = f"rate_hz: {1.0 / (rows[1][0] - rows[0][0]):.9g}\n"
            noise = "".join(
                f"{name}: 0.0\n"
                for sensor in ("gyroscope", "accelerometer")
                for name in (f"{sensor}_noise_density", f"{sensor}_random_walk")
            )
            _write_sensor(root / "imu0", "imu", np.eye(4), rate + noise)

    def _write_camera(self, root: Path, metadata: _Record, rate_hz: float) -> None:
        name = metadata["camera"]
        camera = next(one for one in self._stage.cameras if one.name == name)
        robot_from_camera = camera.sensor.robot_from_camera({})
        body_from_camera = np.eye(4)
        body_from_camera[:3, :3] = _UP[:, None] * robot_from_camera.rotation
        body_from_camera[:3, 3] = _UP * robot_from_camera.translation
        text = f"rate_hz: {rate_hz:.9g}\nresolution: {metadata['size_px']}\n"
        text += f"# Model and distortion: calibration/{name}, in the formats of many programs.\n"
        _write_sensor(root / "cam0", "camera", body_from_camera, text)


def _nanoseconds(time_s: float) -> int:
    return round(1e9 * time_s) + 1_000_000_000


def _write_table(folder: Path, header: str, rows: Iterator[Sequence[Any]]) -> None:
    lines = [f"#timestamp [ns],{header}\n"]
    for time_ns, *values in rows:
        texts = (one if isinstance(one, str) else f"{one:.12g}" for one in values)
        lines.append(",".join((str(time_ns), *texts)) + "\n")
    write_plain(folder / "data.csv", "".join(lines).encode())


def _write_sensor(folder: Path, kind: str, body_from_sensor: Floats, text: str) -> None:
    numbers = ", ".join(f"{number:.12g}" for number in body_from_sensor.reshape(-1))
    pose = f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{numbers}]\n"
    write_plain(folder / "sensor.yaml", f"sensor_type: {kind}\n{pose}{text}".encode())


def _read_rotation(pose: _Record) -> Floats:
    """(3, 3) rotation of a pose in metadata."""
    x, y, z, w = pose["quaternion_xyzw"]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2.0 * w * cross + 2.0 * matmul(cross, cross))


class _TrajectoryWriter:
    """TUM's text of the camera's poses of each sequence."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "trajectories"
        self._sequence, self._lines = -1, list[bytes]()

    def add(self, metadata: _Record, picture: bytes) -> None:
        if self._sequence != metadata["sequence"]:
            self.finish()
        self._sequence = metadata["sequence"]
        pose = metadata["world_from_camera"]
        numbers = (metadata["time_s"], *pose["position_m"], *pose["quaternion_xyzw"])
        self._lines.append((" ".join(f"{number:.9g}" for number in numbers) + "\n").encode())

    def finish(self) -> None:
        if self._lines:
            write_whole(self._folder / f"{self._sequence:06d}.txt", self._lines)
            self._lines = []


def require_pyarrow() -> None:
    """Raise CatoptraError where pyarrow is missing: before anything is drawn."""
    try:
        import pyarrow.parquet  # noqa: F401 - is there such a package?
    except ImportError as error:
        raise CatoptraError(f"a Parquet index needs pyarrow: {_REMEDY}") from error


class _ParquetWriter:
    def __init__(self, folder: Path) -> None:
        require_pyarrow()
        self._path = folder / "index.parquet"
        self._rows: list[dict[str, Any]] = []

    def add(self, metadata: _Record, picture: bytes) -> None:
        pose = metadata["world_from_camera"]
        names = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
        values = (*pose["position_m"], *pose["quaternion_xyzw"])
        row = {name: metadata[name] for name in _COLUMNS}
        self._rows.append(row | dict(zip(names, values, strict=True)))

    def finish(self) -> None:
        import pyarrow
        import pyarrow.parquet

        file = io.BytesIO()
        pyarrow.parquet.write_table(pyarrow.Table.from_pylist(self._rows), file)
        write_whole(self._path, [file.getvalue()])


_WRITERS: Mapping[str, Callable[[Path, DatasetStage], SummaryWriter]] = {
    "coco": lambda folder, stage: _CocoWriter(folder / "annotations.json", stage),
    "coco_folder": lambda folder, stage: _CocoWriter(
        folder / "coco/annotations/instances.json", stage, folder / "coco/images"
    ),
    "yolo": lambda folder, stage: _YoloWriter(folder / "yolo", stage, _describe_yolo_box),
    "yolo_polygons": lambda folder, stage: _YoloWriter(
        folder / "yolo_polygons", stage, _describe_yolo_polygon
    ),
    "kitti": lambda folder, _: _KittiWriter(folder),
    "asl": _AslWriter,
    "tum": lambda folder, _: _TrajectoryWriter(folder),
    "parquet": lambda folder, _: _ParquetWriter(folder),
}
_WITHOUT_PICTURES = frozenset({"coco", "tum", "parquet"})


def open_writers(folder: Path, stage: DatasetStage) -> tuple[list[SummaryWriter], frozenset[str]]:
    """Writers of a recipe's formats, and suffixes of the files that they read.

    Raises:
        CatoptraError: A package is missing.
    """
    formats = stage.recipe.formats
    has_pictures = not _WITHOUT_PICTURES.issuperset(formats)
    suffixes = {METADATA, PICTURE} if has_pictures else {METADATA}
    return [_WRITERS[name](folder, stage) for name in formats], frozenset(suffixes)
