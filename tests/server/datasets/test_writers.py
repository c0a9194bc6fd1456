"""Files of other programs next to the shards, each read by its own tool or by its parser."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.shards import iterate_samples
from catoptra_server.datasets.poses import measure_motion
from catoptra_server.datasets.writers import _read_rotation
from helpers.dataset_recipes import stage_recipe, write_drive, write_recipe
from helpers.drawn_datasets import draw_dataset
from helpers.run_lengths import mask_from_string

FORMATS = "coco_folder,yolo,yolo_polygons,kitti,asl"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a data set of six samples of three drives in all formats with pictures."""
    root = tmp_path_factory.mktemp("writers")
    lines = ("Channels=ids", f"Formats={FORMATS}")
    return draw_dataset(write_drive(root, lines=lines), root / "out")


@pytest.fixture(scope="module")
def samples(folder: Path) -> list[dict[str, Any]]:
    """Metadata of the samples, with the bytes of their pictures."""
    found = [one for n in range(3) for one in iterate_samples(folder / f"shards/00000{n}.tar")]
    return [{**json.loads(one.files["json"]), "png": one.files["rgb.png"]} for one in found]


# pycocotools 2.0 has the warning in its own conversion of masks.
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_pycocotools_reads_the_folder(folder: Path, samples: list[dict[str, Any]]) -> None:
    module = pytest.importorskip("pycocotools.coco", reason="needs the package pycocotools")
    coco = module.COCO(folder / "coco/annotations/instances.json")
    images = coco.loadImgs(coco.getImgIds())
    for image, sample in zip(images, samples, strict=True):
        assert (folder / "coco/images" / image["file_name"]).read_bytes() == sample["png"]
        own = coco.loadAnns(coco.getAnnIds(imgIds=[image["id"]]))
        assert [one["area"] for one in own] == [one["area_px"] for one in sample["objects"]]
        assert all(coco.annToMask(one).sum() == one["area"] for one in own)


def read_yolo(root: Path) -> dict[str, list[tuple[str, np.ndarray]]]:
    """Class and numbers of each row, by picture: ultralytics 8.3, `check_det_dataset`,
    `img2label_paths` and `verify_image_label`."""
    data = yaml.safe_load((root / "data.yaml").read_text(encoding="utf-8"))
    names = data["names"]
    assert data["train"]
    assert data["val"]
    assert min(names) >= 0
    assert max(names) < len(names)
    found = {}
    for image in sorted((root / data["train"]).iterdir()):
        assert min(cv2.imread(str(image)).shape[:2]) > 9
        label = Path("/labels/".join(str(image).rsplit("/images/", 1))).with_suffix(".txt")
        rows = [line.split() for line in label.read_text().strip().splitlines() if line]
        boxes = np.array([row[:5] for row in rows], dtype=np.float32)
        if any(len(row) > 6 for row in rows):
            segments = [np.array(row[1:], dtype=np.float32).reshape(-1, 2) for row in rows]
            assert all(len(one) >= 3 for one in segments)
            assert all((one >= 0).all() and (one <= 1).all() for one in segments)
        else:
            assert {len(row) for row in rows} <= {5}
            assert boxes[:, 1:].max() <= 1
            assert len(np.unique(boxes, axis=0)) == len(boxes)
        assert boxes.min() >= 0
        assert boxes[:, 0].max() < len(names)
        found[image.stem] = [(names[int(row[0])], np.array(row[1:], float)) for row in rows]
    return found


def test_yolo_reads_the_boxes(folder: Path, samples: list[dict[str, Any]]) -> None:
    found = read_yolo(folder / "yolo")
    for sample in samples:
        rows = found[sample["key"]]
        assert [name for name, _ in rows] == [one["class"] for one in sample["objects"]]
        for (_, (u, v, width, height)), one in zip(rows, sample["objects"], strict=True):
            box = 64 * np.array((u - 0.5 * width, v - 0.5 * height, width, height))
            np.testing.assert_allclose(box, one["box_px"], atol=1e-6)


def test_fixed_numbers_of_classes_are_those_of_coco_and_the_order_of_yolo(tmp_path: Path) -> None:
    scene = stage_recipe(write_recipe(tmp_path)).world(0).scene
    known = sorted({"robot", *(one.class_name for one in scene.objects)}, reverse=True)
    numbers = {name: 3 * number + 7 for number, name in enumerate(known)}
    lines = ("Formats=coco,yolo",)
    fixed = ("[Catoptra.Classes]", *(f"{name}={number}" for name, number in numbers.items()))
    folder = draw_dataset(write_recipe(tmp_path, *fixed, lines=lines), tmp_path / "out")
    categories = json.loads((folder / "annotations.json").read_bytes())["categories"]
    assert {one["name"]: one["id"] for one in categories} == numbers
    names = yaml.safe_load((folder / "yolo/data.yaml").read_text(encoding="utf-8"))["names"]
    assert [*names.values()] == known


def fill(points: np.ndarray, side: int) -> np.ndarray:
    """(side, side) pixels whose centres are within a polygon by the even-odd rule."""
    v, u = np.mgrid[:side, :side] + 0.5
    inside = np.zeros((side, side), dtype=bool)
    for (a, b), (c, d) in zip(points, np.roll(points, -1, axis=0), strict=True):
        if b != d:
            crosses = ((b <= v) != (d <= v)) & (u < a + (v - b) / (d - b) * (c - a))
            inside ^= crosses
    return inside


def test_yolo_reads_outlines_that_fill_the_masks(
    folder: Path, samples: list[dict[str, Any]]
) -> None:
    found = read_yolo(folder / "yolo_polygons")
    has_parts = False
    for sample in samples:
        for (_, row), one in zip(found[sample["key"]], sample["objects"], strict=True):
            mask = mask_from_string(one["mask"]["counts"], 64, 64)
            np.testing.assert_array_equal(fill(64 * row.reshape(-1, 2), 64), mask)
            has_parts |= len(one["polygons"]) > 1
    assert has_parts


def read_kitti(path: Path) -> list[dict[str, Any]]:
    """Labels of a file: the devkit's `loadGroundtruth`, fscanf of "%s %lf %d" and 12 of "%lf"."""
    found = []
    for line in path.read_text().splitlines():
        texts = line.split()
        assert len(texts) == 15
        numbers = [float(texts[1]), int(texts[2]), *map(float, texts[3:])]
        assert 0.0 <= numbers[0] <= 1.0
        assert numbers[1] in range(4)
        found.append({"type": texts[0], "numbers": numbers})
    return found


def kitti_corners(numbers: list[float]) -> np.ndarray:
    """(8, 3) corners of the devkit's `computeBox3D.m`."""
    h, w, l, *place, yaw = numbers[7:]  # noqa: E741  the devkit's names
    x = np.array((l, l, -l, -l, l, l, -l, -l)) / 2
    y = np.array((0, 0, 0, 0, -h, -h, -h, -h))
    z = np.array((w, -w, -w, w, w, -w, -w, w)) / 2
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack((c * x + s * z, y, -s * x + c * z)) + place


def test_kitti_reads_boxes_that_are_those_of_the_world(
    folder: Path, samples: list[dict[str, Any]]
) -> None:
    for sample in samples:
        key = sample["key"]
        assert (folder / f"kitti/training/image_2/{key}.png").read_bytes() == sample["png"]
        calibration = (folder / f"kitti/training/calib/{key}.txt").read_text().splitlines()
        counts = {line.split(":")[0]: len(line.split()) - 1 for line in calibration}
        assert [counts[name] for name in ("P2", "R0_rect", "Tr_velo_to_cam")] == [12, 9, 12]
        rotation = _read_rotation(sample["world_from_robot"])
        viewpoint = np.array(sample["world_from_camera"]["position_m"])
        found = read_kitti(folder / f"kitti/training/label_2/{key}.txt")
        for label, one in zip(found, sample["objects"], strict=True):
            left, top, width, height = one["box_px"]
            assert label["numbers"][3:7] == [left, top, left + width - 1, top + height - 1]
            right, down, ahead = kitti_corners(label["numbers"]).T
            corners = np.column_stack((ahead, right, down)) @ rotation.T + viewpoint
            box = one["box_3d"]
            signs = np.array([[(k >> axis & 1) * 2 - 1 for axis in range(3)] for k in range(8)])
            turned = signs * box["half_size_m"] @ np.array(box["rotation"]).reshape(3, 3).T
            truth = turned + box["position_m"]
            distance = np.linalg.norm(corners[:, None] - truth, axis=-1)
            # Things of this corridor stand upright; numbers have six decimals.
            assert distance.min(axis=1).max() < 2e-5
            assert distance.min(axis=0).max() < 2e-5


def read_asl(path: Path) -> list[list[float]]:
    """Rows of a file: basalt's `EurocIO`, numbers with one character between."""
    lines = path.read_text().splitlines()
    return [[float(one) for one in line.split(",")] for line in lines if line[0] != "#"]


def test_basalt_s_reader_finds_pictures_poses_and_imu(
    folder: Path, samples: list[dict[str, Any]]
) -> None:
    for sequence in range(3):
        root = folder / f"asl/{sequence:06d}/mav0"
        own = [one for one in samples if one["sequence"] == sequence]
        rows = [line.split(",") for line in (root / "cam0/data.csv").read_text().splitlines()[1:]]
        for (time_ns, name), sample in zip(rows, own, strict=True):
            assert int(time_ns) == round(1e9 * sample["time_s"]) + 10**9
            assert (root / "cam0/data" / name).read_bytes() == sample["png"]
        sensor = yaml.safe_load((root / "cam0/sensor.yaml").read_text())
        body_from_camera = np.array(sensor["T_BS"]["data"]).reshape(4, 4)
        poses, imu = (np.array(read_asl(root / name / "data.csv")) for name in ("mocap0", "imu0"))
        assert yaml.safe_load((root / "imu0/sensor.yaml").read_text())["rate_hz"] == 50.0
        for pose, sample in zip(poses, own, strict=True):
            w, x, y, z = pose[4:]
            body = np.eye(4)
            at = {"quaternion_xyzw": [x, y, z, w]}
            body[:3, :3], body[:3, 3] = _read_rotation(at), pose[1:4]
            camera = (body @ body_from_camera)[:3, 3] * (1, -1, -1)
            expected = sample["world_from_camera"]["position_m"]
            np.testing.assert_allclose(camera, expected, atol=1e-9)
        np.testing.assert_array_equal(np.diff(imu[:, 0]), 2e7)
        # On level ground the force is gravity, plus what wheels do along the floor.
        np.testing.assert_allclose(imu[:, 6], 9.81, atol=1e-6)
        integrated = integrate(imu[imu[:, 0] < poses[1, 0]], poses[0], 0.02)
        np.testing.assert_allclose(integrated, poses[1, 1:4], atol=1e-7)


def integrate(imu: np.ndarray, pose: np.ndarray, step_s: float) -> np.ndarray:
    """Position after the steps of an IMU, from a pose at rest; z up."""
    w, *vector = pose[4:]
    rotation = _read_rotation({"quaternion_xyzw": [*vector, w]})
    place, velocity = pose[1:4], np.zeros(3)
    for row in imu:
        velocity = velocity + step_s * (rotation @ row[4:7] - (0.0, 0.0, 9.81))
        rotation = rotation @ cv2.Rodrigues(step_s * row[1:4])[0]
        place = place + step_s * velocity
    return place


def test_imu_of_any_motion_integrates_to_its_poses() -> None:
    random = np.random.default_rng(3)
    places = [Pose.from_rpy((1.0, 2.0, -0.3), (0.1, -0.2, 0.5))] * 2
    for _ in range(40):
        step = Pose.from_rpy(random.normal(0.0, 0.01, 3), random.normal(0.0, 0.05, 3))
        places.append(places[-1] @ step)
    measured = measure_motion(places, 0.02)
    # From rest: the first step is without motion.
    np.testing.assert_allclose(measured[0, 1:4], 0.0, atol=1e-12)
    rotation, place, velocity = places[0].rotation, places[0].translation, np.zeros(3)
    for row, expected in zip(measured, places[1:], strict=True):
        velocity = velocity + 0.02 * (rotation @ row[4:] + (0.0, 0.0, 9.81))
        rotation = rotation @ cv2.Rodrigues(0.02 * row[1:4])[0]
        place = place + 0.02 * velocity
        np.testing.assert_allclose(place, expected.translation, atol=1e-9)
        np.testing.assert_allclose(rotation, expected.rotation, atol=1e-9)
