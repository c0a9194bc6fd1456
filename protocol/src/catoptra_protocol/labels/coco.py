"""Annotations as a COCO file of instances (cocodataset.org/#format-data).

Segmentations are run lengths, since polygons of COCO have no holes. Keys of our own begin with
`catoptra_`; readers of COCO keep what they do not know.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class CocoImage:
    """One image of a file."""

    file_name: str
    width_px: int
    height_px: int
    objects: Sequence[dict[str, Any]]
    """Records of `ObjectAnnotation.to_json`."""


def coco_from_images(images: Sequence[CocoImage]) -> dict[str, Any]:
    """Content of a COCO file; images are numbered from 1 in their order, annotations likewise."""
    annotations: list[dict[str, Any]] = []
    names = sorted({one["class"] for image in images for one in image.objects})
    categories = {name: number for number, name in enumerate(names, 1)}
    for image_id, image in enumerate(images, 1):
        for one in image.objects:
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": image_id,
                    "category_id": categories[one["class"]],
                    "segmentation": one["mask"],
                    "area": one["area_px"],
                    "bbox": one["box_px"],
                    "iscrowd": 0,
                    "catoptra_object": one["id"],
                    "catoptra_name": one["name"],
                    "catoptra_spherical_box": one["spherical_box"],
                    "catoptra_occluded_fraction": one["occluded_fraction"],
                }
            )
    return {
        "images": [
            {
                "id": number,
                "file_name": image.file_name,
                "width": image.width_px,
                "height": image.height_px,
            }
            for number, image in enumerate(images, 1)
        ],
        "annotations": annotations,
        "categories": [
            {"id": number, "name": name, "supercategory": ""} for name, number in categories.items()
        ],
    }
