"""Masks of all objects of an image: run lengths, boxes of pixels, outlines; COCO files.

COCO's run lengths count column by column, first pixels outside, then inside, in turn; its string of
them has six bits a character (github.com/cocodataset/cocoapi, common/maskApi.c). A COCO file of
instances (cocodataset.org/#format-data) has run lengths as segmentations, since polygons of COCO
have no holes. Keys of our own begin with `catoptra_`; readers of COCO keep unknown keys.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools
from catoptra_protocol.slotted_dataclass import dataclass

Ids = npt.NDArray[np.uint16]
Polygon = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMask:
    """Pixels of one object."""

    number: int
    height_px: int
    width_px: int
    positions: npt.NDArray[np.int64]
    """(n,) pixels, column * height_px + row, ascending."""

    @property
    def rows(self) -> npt.NDArray[np.int64]:
        """(n,) row of each pixel."""
        return self.positions % self.height_px

    @property
    def columns(self) -> npt.NDArray[np.int64]:
        """(n,) column of each pixel."""
        return self.positions // self.height_px

    @property
    def area_px(self) -> int:
        """Number of pixels."""
        return len(self.positions)

    @property
    def box_px(self) -> tuple[int, int, int, int]:
        """Left column, top row, width and height of the box around all pixels."""
        rows, columns = self.rows, self.columns
        left, top = int(columns.min()), int(rows.min())
        return left, top, int(columns.max()) + 1 - left, int(rows.max()) + 1 - top

    @property
    def run_lengths(self) -> list[int]:
        """Uncompressed run lengths of COCO."""
        positions = self.positions
        breaks = np.flatnonzero(np.diff(positions) != 1)
        begins = positions[np.concatenate(([0], breaks + 1))]
        ends = positions[np.concatenate((breaks, [len(positions) - 1]))] + 1
        edges = np.column_stack((begins, ends)).reshape(-1)
        lengths = np.diff(edges, prepend=0).tolist()
        rest = self.height_px * self.width_px - int(edges[-1])
        return [*lengths, rest] if rest else lengths

    def to_array(self) -> Bools:
        """(h, w) mask."""
        flat = np.zeros(self.height_px * self.width_px, dtype=np.bool_)
        flat[self.positions] = True
        return flat.reshape(self.width_px, self.height_px).T


def find_masks(ids: Ids) -> tuple[ObjectMask, ...]:
    """Masks of all objects of an image, by ascending number; of (h, w) ids, 0 for nothing."""
    height_px, width_px = ids.shape
    flat = ids.T.reshape(-1)
    order = np.argsort(flat, kind="stable")
    numbers, begins = np.unique(flat[order], return_index=True)
    bounds = [*begins.tolist(), len(flat)]
    return tuple(
        ObjectMask(int(number), height_px, width_px, order[begin:end])
        for number, (begin, end) in zip(numbers, pairwise(bounds), strict=True)
        if number != 0
    )


def find_objects_at_border(ids: Ids, valid: Bools) -> frozenset[int]:
    """Numbers of the objects that reach the border of the image or of its valid part."""
    padded = np.pad(valid, 1)
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return frozenset(np.unique(ids[valid & ~inner]).tolist()) - {0}


def string_from_run_lengths(lengths: Sequence[int]) -> str:
    """COCO's string of run lengths: differences to the last but one, low bits first."""
    characters = []
    for index, length in enumerate(lengths):
        rest = length - lengths[index - 2] if index > 2 else length
        has_more = True
        while has_more:
            bits, rest = rest & 0x1F, rest >> 5
            has_more = rest != (-1 if bits & 0x10 else 0)
            characters.append(chr(48 + bits + 0x20 * has_more))
    return "".join(characters)


def trace_outlines(mask: ObjectMask) -> tuple[Polygon, ...]:
    """Outlines of a mask along the edges of its pixels: corners (column, row), without repetition.

    Outer outlines and those of holes, each with the mask on its right hand (v down); by the
    even-odd rule they fill exactly the mask's pixels.
    """
    left, top, width, height = mask.box_px
    inside = np.zeros((height + 2, width + 2), dtype=np.int8)
    inside[mask.rows - top + 1, mask.columns - left + 1] = 1
    # Directed edges of one pixel: to the right above a pixel, down on its right, and so on.
    across, down = np.diff(inside, axis=0), np.diff(inside, axis=1)
    steps: defaultdict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for row, column in np.argwhere(across[:, 1:-1] > 0).tolist():
        steps[column, row].append((column + 1, row))
    for row, column in np.argwhere(across[:, 1:-1] < 0).tolist():
        steps[column + 1, row].append((column, row))
    for row, column in np.argwhere(down[1:-1] > 0).tolist():
        steps[column, row + 1].append((column, row))
    for row, column in np.argwhere(down[1:-1] < 0).tolist():
        steps[column, row].append((column, row + 1))
    outlines = []
    while steps:
        outlines.append(_follow(steps, next(iter(steps))))
    return tuple(
        tuple((column + left, row + top) for column, row in outline) for outline in outlines
    )


def _follow(
    steps: defaultdict[tuple[int, int], list[tuple[int, int]]], begin: tuple[int, int]
) -> list[tuple[int, int]]:
    """Corners of the outline through a point; removes its steps."""
    points = [begin]
    while True:
        here = points[-1]
        choices = steps[here]
        there = choices[0]
        if len(choices) > 1 and len(points) > 1:
            # Two outlines touch here: the right turn keeps to the same pixel.
            before = points[-2]
            right = (here[0] - (here[1] - before[1]), here[1] + (here[0] - before[0]))
            there = next(one for one in choices if one == right)
        choices.remove(there)
        if not choices:
            del steps[here]
        if there == begin:
            break
        points.append(there)
    count = len(points)
    return [
        point
        for index, point in enumerate(points)
        if not _is_straight(points[index - 1], point, points[(index + 1) % count])
    ]


def _is_straight(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> bool:
    return (b[0] - a[0]) * (c[1] - b[1]) == (b[1] - a[1]) * (c[0] - b[0])


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
