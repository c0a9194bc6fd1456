"""Masks of all objects of an image: run lengths, boxes of pixels, outlines; COCO files.

COCO's run lengths count column by column, first pixels outside, then inside, in turn; its string of
them has six bits a character (github.com/cocodataset/cocoapi, common/maskApi.c). A COCO file of
instances (cocodataset.org/#format-data) has run lengths as segmentations, since polygons of COCO
have no holes. Keys of our own begin with `catoptra_`; readers of COCO keep unknown keys.

All objects of an image are found at once, in arrays of runs and of corners, an image of 360 px in
2 ms; one object after the other took 47.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools
from catoptra_protocol.slotted_dataclass import dataclass

Ids = npt.NDArray[np.uint16]
_Ints = npt.NDArray[np.int64]
Polygon = _Ints
"""(n, 2) corners (column, row), without repetition."""
# Six bits hold 5 of a number: run lengths of 2^31 and their differences have 7 characters.
_MAX_CHARACTERS = 7


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMask:
    """Pixels of one object."""

    number: int
    height_px: int
    width_px: int
    area_px: int
    """Number of pixels."""
    box_px: tuple[int, int, int, int]
    """Left column, top row, width and height of the box around all pixels."""
    run_lengths: list[int]
    """Uncompressed run lengths of COCO."""
    counts: str
    """COCO's string of the run lengths."""

    def to_array(self) -> Bools:
        """(h, w) mask."""
        inside = np.arange(len(self.run_lengths)) % 2 == 1
        flat = np.repeat(inside, self.run_lengths)
        flat = np.pad(flat, (0, self.height_px * self.width_px - len(flat)))
        return flat.reshape(self.width_px, self.height_px).T


def find_masks(ids: Ids) -> tuple[ObjectMask, ...]:
    """Masks of all objects of an image, by ascending number; of (h, w) ids, 0 for nothing."""
    height, width = ids.shape
    flat = ids.T.reshape(-1)
    begins = np.concatenate(([0], np.flatnonzero(np.diff(flat)) + 1))
    ends = np.append(begins[1:], flat.size)
    order = np.argsort(flat[begins], kind="stable")
    order = order[flat[begins[order]] != 0]
    if not order.size:
        return ()
    begins, ends, owners = begins[order], ends[order], flat[begins[order]]
    firsts = np.flatnonzero(np.diff(owners, prepend=0))
    areas = np.add.reduceat(ends - begins, firsts)
    left = begins[firsts] // height
    right = np.maximum.reduceat((ends - 1) // height, firsts)
    # A run that goes on in the next column meets the last row and the first one.
    goes_on = begins // height != (ends - 1) // height
    top = np.minimum.reduceat(np.where(goes_on, 0, begins % height), firsts)
    bottom = np.maximum.reduceat(np.where(goes_on, height - 1, (ends - 1) % height), firsts)
    boxes = np.column_stack((left, top, right + 1 - left, bottom + 1 - top)).tolist()
    lengths, bounds = _find_run_lengths(begins, ends, firsts, flat.size)
    texts = _encode_run_lengths(lengths, bounds)
    return tuple(
        ObjectMask(number, height, width, area, (box[0], box[1], box[2], box[3]), run, text)
        for number, area, box, run, text in zip(
            owners[firsts].tolist(),
            areas.tolist(),
            boxes,
            (lengths[begin:end].tolist() for begin, end in pairwise(bounds)),
            texts,
            strict=True,
        )
    )


def _find_run_lengths(
    begins: _Ints, ends: _Ints, firsts: _Ints, num_pixels: int
) -> tuple[_Ints, list[int]]:
    """Run lengths of objects one after the other, and the places where each one's begin.

    Args:
        begins: (n,) begins of runs, by object.
        ends: (n,) their ends.
        firsts: (m,) number of each object's first run.
        num_pixels: Pixels of the image.
    """
    before = np.concatenate(([0], ends[:-1]))
    before[firsts] = 0
    lasts = np.append(firsts[1:], len(begins))
    rest = num_pixels - ends[lasts - 1]
    lengths = np.column_stack((begins - before, ends - begins)).reshape(-1)
    lengths = np.insert(lengths, 2 * lasts, rest)
    bounds = np.concatenate(([0], 2 * lasts + np.arange(1, len(lasts) + 1)))
    # No rest, no run.
    is_kept = np.ones(len(lengths), dtype=np.bool_)
    is_kept[bounds[1:] - 1] = rest > 0
    return lengths[is_kept], np.concatenate(([0], np.cumsum(is_kept)[bounds[1:] - 1])).tolist()


def _encode_run_lengths(lengths: _Ints, bounds: Sequence[int]) -> Iterator[str]:
    """Yield COCO's string of each object: differences to the last but one, low bits first."""
    place = np.arange(len(lengths)) - np.repeat(bounds[:-1], np.diff(bounds))
    rest = np.where(place > 2, lengths - np.roll(lengths, 2), lengths)
    characters = np.zeros((len(lengths), _MAX_CHARACTERS), dtype=np.uint8)
    has_more = np.ones(len(lengths), dtype=np.bool_)
    for column in range(_MAX_CHARACTERS):
        bits, after = rest & 0x1F, rest >> 5
        goes_on = after != np.where(bits & 0x10, -1, 0)
        characters[:, column] = np.where(has_more, 48 + bits + 0x20 * goes_on, 0)
        has_more, rest = has_more & goes_on, after
        if not has_more.any():
            break
    text = characters[characters > 0].tobytes().decode("ascii")
    ends = np.concatenate(([0], np.cumsum((characters > 0).sum(axis=1))))[list(bounds)].tolist()
    return (text[begin:end] for begin, end in pairwise(ends))


def find_objects_at_border(ids: Ids, valid: Bools) -> frozenset[int]:
    """Numbers of the objects that reach the border of the image or of its valid part."""
    padded = np.pad(valid, 1)
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return frozenset(np.unique(ids[valid & ~inner]).tolist()) - {0}


def trace_outlines(ids: Ids) -> dict[int, list[Polygon]]:
    """Outlines of all objects along the edges of their pixels, by number.

    Outer outlines and those of holes, each with the object on its right hand (v down); by the
    even-odd rule they fill exactly the object's pixels. Pixels that touch at a corner alone have
    outlines of their own there.
    """
    owner, column, row, ahead, down, leaves_level = _find_corners(ids)
    # Along a line of edges the corners of one object are ends of edges, two by two. Of two at one
    # place the first ends an edge, the second begins one.
    height, width = ids.shape[0] + 1, ids.shape[1] + 1
    level = np.argsort(((owner * height + row) * width + column) * 2 + ahead)
    upright = np.argsort(((owner * width + column) * height + row) * 2 + down)
    following = np.zeros(len(owner), dtype=np.int64)
    for order, leaves in ((level, leaves_level), (upright, ~leaves_level)):
        others = order.reshape(-1, 2)[:, ::-1].reshape(-1)
        following[order[leaves[order]]] = others[leaves[order]]
    steps, is_new = following.tolist(), [True] * len(owner)
    visited: list[int] = []
    begins: list[int] = []
    for begin in level.tolist():
        if is_new[begin]:
            begins.append(len(visited))
        while is_new[begin]:
            is_new[begin] = False
            visited.append(begin)
            begin = steps[begin]
    points = np.column_stack((column, row))[visited]
    outlines: dict[int, list[Polygon]] = {}
    owners = owner[visited][begins].tolist() if begins else []
    for number, (start, end) in zip(owners, pairwise([*begins, len(visited)]), strict=True):
        outlines.setdefault(number, []).append(points[start:end])
    return outlines


def _find_corners(ids: Ids) -> tuple[npt.NDArray[Any], ...]:
    """Corners of all outlines: owner, column, row, whether the level edge lies ahead and the other
    one below, and whether the outline leaves along the level one."""
    padded = np.pad(ids, 1)
    quadrants = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
    differs = (quadrants[0] != quadrants[1]) | (quadrants[2] != quadrants[3])
    rows, columns = np.nonzero(differs | (quadrants[0] != quadrants[2]))
    around = [one[rows, columns] for one in quadrants]
    found = []
    for number, own in enumerate(around):
        beside, above, across = (around[number ^ step] for step in (1, 2, 3))
        is_ahead, is_down = bool(number & 1), bool(number & 2)
        # A pixel's corner that sticks out, and one in a corner of three other pixels.
        for owner, is_corner, is_outward in (
            (own, (own != beside) & (own != above), True),
            (across, (across == beside) & (across == above) & (across != own), False),
        ):
            at = np.flatnonzero(is_corner & (owner != 0))
            flags = np.array((is_ahead, is_down, (is_ahead == is_down) == is_outward))
            places = owner[at].astype(np.int64), columns[at], rows[at]
            found.append((*places, *np.repeat(flags[:, None], len(at), 1)))
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class CocoImage:
    """One image of a file."""

    file_name: str
    width_px: int
    height_px: int
    objects: Sequence[dict[str, Any]]
    """Records of `ObjectAnnotation.to_json`."""


def coco_from_images(
    images: Sequence[CocoImage], categories: Mapping[str, int] | None = None
) -> dict[str, Any]:
    """Content of a COCO file; images are numbered from 1 in their order, annotations likewise.

    Args:
        images: Images with their objects.
        categories: Numbers of all classes; None: those that occur, from 1 in their alphabet.
    """
    annotations: list[dict[str, Any]] = []
    if categories is None:
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
