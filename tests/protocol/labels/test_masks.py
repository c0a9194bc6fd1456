"""Masks of objects, and their records in COCO."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.labels import GroundTruth, LabelledObject
from catoptra_protocol.labels.annotations import annotate_objects
from catoptra_protocol.labels.masks import (
    CocoImage,
    coco_from_images,
    find_masks,
    find_objects_at_border,
    trace_outlines,
)
from catoptra_protocol.labels.spherical_box import PixelSphere
from catoptra_protocol.optics.transforms import Pose
from helpers.labelled_rooms import CAMERAS
from helpers.run_lengths import mask_from_string

RANDOM = np.random.default_rng(11)


def random_ids(height: int = 37, width: int = 53) -> np.ndarray:
    """Blobs of six objects, with holes, parts that touch at corners, and pixels of nothing."""
    coarse = RANDOM.integers(0, 7, (height // 3 + 1, width // 3 + 1))
    fine = np.kron(coarse, np.ones((3, 3), dtype=int))[:height, :width]
    speckled = np.where(RANDOM.random((height, width)) < 0.1, 0, fine)
    return speckled.astype(np.uint16)


def test_run_lengths_are_column_major_and_begin_outside() -> None:
    ids = np.array(((0, 1, 1), (1, 1, 0)), dtype=np.uint16)
    (mask,) = find_masks(ids)
    assert mask.run_lengths == [1, 4, 1]
    assert (mask.area_px, mask.box_px) == (4, (0, 0, 3, 2))
    (corner,) = find_masks(np.array(((2, 0), (0, 0)), dtype=np.uint16))
    assert (corner.number, corner.run_lengths) == (2, [0, 1, 3])


def test_masks_of_random_images_survive_every_form() -> None:
    for _ in range(20):
        ids = random_ids()
        masks = find_masks(ids)
        assert [mask.number for mask in masks] == sorted(set(np.unique(ids).tolist()) - {0})
        for mask in masks:
            expected = ids == mask.number
            np.testing.assert_array_equal(mask.to_array(), expected)
            np.testing.assert_array_equal(mask_from_string(mask.counts, *ids.shape), expected)
            rows, columns = np.nonzero(expected)
            left, top, width, height = mask.box_px
            assert (left, left + width) == (columns.min(), columns.max() + 1)
            assert (top, top + height) == (rows.min(), rows.max() + 1)


def test_outlines_fill_exactly_the_mask() -> None:
    for _ in range(20):
        ids = random_ids(19, 23)
        outlines = trace_outlines(ids)
        for mask in find_masks(ids):
            filled = np.zeros(ids.shape, dtype=int)
            for outline in outlines[mask.number]:
                # By the even-odd rule: edges left of a pixel's centre, row by row.
                closed = np.concatenate((outline, outline[:1]))
                for (u, v), (u_next, v_next) in pairwise(closed):
                    assert (u == u_next) != (v == v_next)
                    if u == u_next:
                        filled[min(v, v_next) : max(v, v_next), u:] += 1
            np.testing.assert_array_equal(filled % 2 == 1, mask.to_array())


def test_outlines_of_a_ring_have_a_hole() -> None:
    ids = np.ones((3, 3), dtype=np.uint16)
    ids[1, 1] = 0
    outlines = trace_outlines(ids)[1]
    assert sorted(len(outline) for outline in outlines) == [4, 4]
    assert {frozenset(map(tuple, outline.tolist())) for outline in outlines} == {
        frozenset(((0, 0), (3, 0), (3, 3), (0, 3))),
        frozenset(((1, 1), (2, 1), (2, 2), (1, 2))),
    }


def test_objects_at_the_end_of_the_image_or_of_its_domain_are_truncated() -> None:
    valid = np.ones((6, 8), dtype=bool)
    valid[:, :2] = False
    ids = np.zeros((6, 8), dtype=np.uint16)
    ids[2:4, 3:5] = 1
    ids[2, 2] = 2
    ids[5, 6] = 3
    assert find_objects_at_border(ids, valid) == {2, 3}


# pycocotools hands arrays to NumPy by an interface of NumPy 1.
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_pycocotools_reads_the_strings() -> None:
    mask_tools = pytest.importorskip("pycocotools.mask")
    for mask in find_masks(random_ids()):
        segmentation = {"size": [37, 53], "counts": mask.counts.encode()}
        np.testing.assert_array_equal(mask_tools.decode(segmentation), mask.to_array())
        assert mask_tools.area(segmentation) == mask.area_px
        assert mask_tools.toBbox(segmentation).tolist() == list(mask.box_px)


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
