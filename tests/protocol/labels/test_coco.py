"""COCO files of annotations."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.labels.annotations import annotate_objects
from catoptra_protocol.labels.channels import GroundTruth, LabelledObject
from catoptra_protocol.labels.masks import CocoImage, coco_from_images
from catoptra_protocol.labels.spherical_box import PixelSphere
from catoptra_protocol.optics.transforms import Pose
from helpers.labelled_rooms import CAMERAS

CAMERA = CAMERAS["fish-eye"]


def make_images() -> list[CocoImage]:
    ids = np.zeros((96, 96), dtype=np.uint16)
    ids[30:40, 50:60], ids[60:70, 20:40] = 1, 2
    objects = tuple(
        LabelledObject(number, name, name, number, Pose.identity(), np.ones(3))
        for number, name in ((1, "robot"), (2, "goal"))
    )
    truth = GroundTruth({"ids": ids, "valid": np.ones((96, 96), np.uint8)}, objects)
    sphere = PixelSphere(CAMERA, np.eye(3))
    found = annotate_objects(truth, CAMERA, Pose.identity(), sphere)
    records = [one.to_json() for one in found]
    return [CocoImage("a.png", 96, 96, records), CocoImage("b.png", 96, 96, records[:1])]


def test_numbers_are_consistent() -> None:
    coco = coco_from_images(make_images())
    assert [one["id"] for one in coco["annotations"]] == [1, 2, 3]
    assert [one["image_id"] for one in coco["annotations"]] == [1, 1, 2]
    assert [one["name"] for one in coco["categories"]] == ["goal", "robot"]
    names = {one["id"]: one["name"] for one in coco["categories"]}
    assert [names[one["category_id"]] for one in coco["annotations"]] == ["robot", "goal", "robot"]


# pycocotools hands arrays to NumPy by an interface of NumPy 1.
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_pycocotools_reads_the_file(tmp_path: Path) -> None:
    module = pytest.importorskip("pycocotools.coco")
    path = tmp_path / "instances.json"
    path.write_text(json.dumps(coco_from_images(make_images())))
    coco = module.COCO(str(path))
    assert len(coco.getImgIds()) == 2
    masks = [coco.annToMask(one) for one in coco.loadAnns(coco.getAnnIds(imgIds=[1]))]
    assert [int(mask.sum()) for mask in masks] == [100, 200]
