"""Annotations of a small image: complete, and JSON without a number that is none."""

from __future__ import annotations

import json

import numpy as np

from catoptra_protocol.labels.annotations import annotate_objects
from catoptra_protocol.labels.channels import GroundTruth, LabelledObject
from catoptra_protocol.labels.masks import mask_from_run_lengths, run_lengths_from_string
from catoptra_protocol.labels.spherical_box import PixelSphere
from catoptra_protocol.optics.transforms import Pose
from helpers.labelled_rooms import CAMERAS

CAMERA = CAMERAS["fish-eye"]
IDS = np.zeros((96, 96), dtype=np.uint16)
IDS[30:40, 50:60] = 2
IDS[48, 95] = 7
VALID = np.ones((96, 96), dtype=np.uint8)
OBJECTS = tuple(
    LabelledObject(number, name, "object", 1, Pose.from_rpy(place), np.full(3, 0.1))
    for number, name, place in (
        (2, "crate", (0.5, 0.5, 0.4)),
        (7, "post", (0.0, 0.0, -9.0)),
        (8, "unseen", (1.0, 0.0, 0.0)),
    )
)


def test_each_object_in_view_has_an_annotation() -> None:
    truth = GroundTruth({"ids": IDS, "valid": VALID}, OBJECTS)
    sphere = PixelSphere(CAMERA, np.eye(3))
    found = annotate_objects(truth, CAMERA, Pose.identity(), sphere, {2: 0.25})
    assert [one.labelled.name for one in found] == ["crate", "post"]
    assert [one.is_truncated for one in found] == [False, True]
    assert [one.occluded_fraction for one in found] == [0.25, None]
    record = json.loads(json.dumps(found[0].to_json(), allow_nan=False))
    assert (record["area_px"], record["box_px"]) == (100, [50, 30, 10, 10])
    lengths = run_lengths_from_string(record["mask"]["counts"])
    np.testing.assert_array_equal(mask_from_run_lengths(lengths, 96, 96), IDS == 2)
    assert record["polygons"] == [[[50, 30], [60, 30], [60, 40], [50, 40]]]
    assert sum(corner is not None for corner in record["box_3d"]["corners_px"]) == 8
    # Straight above: outside the domain of a camera that hangs.
    above = found[1].to_json()["box_3d"]["corners_px"]
    assert above == 8 * [None]
