"""`--sheet`: a page with samples of a data set, all channels in false colours, boxes drawn.

One HTML file without scripts; pictures are PNG files inside, so that the page can be sent around.
"""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.elementary import arctan2, hypot
from catoptra_protocol.shards import CHANNEL_FILES, METADATA, PICTURE, StoredSample, iterate_samples
from catoptra_server.datasets.dataset_folder import decode_array, read_manifest
from catoptra_server.datasets.png_files import encode_png
from catoptra_server.datasets.shards import write_whole
from catoptra_server.runtime.random_sources import RandomSource

_Pixels = npt.NDArray[np.uint8]
SHEET_NAME = "sheet.html"
NUM_SAMPLES = 24
# Turns of the golden ratio: neighbouring numbers get far colours.
_GOLDEN = 0.6180339887498949
# A range of this many metres has half the brightness.
_HALF_RANGE_M = 2.0
# Pictures are shown this wide; larger ones are halved to at most twice that.
_SHOWN_PX = 180
_MAX_OBJECTS = 12
_STYLE = (
    "body{font:13px sans-serif;margin:1em;background:#fff;color:#222}"
    "section{margin:0 0 1.5em}h2{font-size:14px;margin:0 0 .3em}"
    "figure{display:inline-block;margin:0 .4em .4em 0;vertical-align:top}"
    "figcaption{color:#555}"
    f"img{{width:{_SHOWN_PX}px;image-rendering:auto;background:#eee}}"
    "p{margin:.2em 0;color:#555;max-width:80em}"
)


def write_sheet(folder: Path) -> Path:
    """Write the page of a whole data set, and return the path.

    Raises:
        CatoptraError: There is no whole data set, or a file is damaged.
    """
    manifest = read_manifest(folder)
    sections = [_describe_sample(one) for one in _choose_samples(folder, manifest)]
    path = folder / SHEET_NAME
    write_whole(path, [_make_page(str(manifest["name"]), manifest["samples"], sections).encode()])
    return path


def _choose_samples(folder: Path, manifest: dict[str, Any]) -> Iterator[StoredSample]:
    """Yield the samples of the page; shards without any are not read."""
    wanted = _choose_indices(manifest["samples"])
    first = 0
    for shard in manifest["shards"]:
        own = {index - first for index in wanted if first <= index < first + shard["samples"]}
        if own:
            stored = iterate_samples(folder / shard["path"])
            yield from (sample for number, sample in enumerate(stored) if number in own)
        first += shard["samples"]


def _choose_indices(num_samples: int) -> list[int]:
    """Indices of at most NUM_SAMPLES samples, one from each of as many equal parts, ascending."""
    count = min(NUM_SAMPLES, num_samples)
    ends = [number * num_samples // count for number in range(count + 1)]
    # At random within a part: an even step would meet the same cameras of a recipe over and over.
    generator = RandomSource.from_names(0, "contact sheet").generator(0)
    return [int(generator.integers(low, high)) for low, high in pairwise(ends)]


def _describe_sample(sample: StoredSample) -> str:
    """Section of a sample."""
    try:
        metadata = json.loads(sample.files[METADATA])
        pictures = dict(_list_pictures(sample, metadata))
        text = ", ".join(
            (
                str(metadata["world"]),
                str(metadata["camera"]),
                f"sequence {metadata['sequence']}, t = {metadata['time_s']:.2f} s",
                f"light x {metadata['brightness']:.2f}",
            )
        )
    except (KeyError, ValueError) as error:
        raise CatoptraError(f"sample {sample.key} cannot be read: {error}") from error
    figures = "".join(_make_figure(name, pixels) for name, pixels in pictures.items())
    objects = _describe_objects(metadata.get("objects", ()))
    return (
        f"<section><h2>{html.escape(sample.key)}: {html.escape(text)}</h2>{figures}"
        f"<p>{html.escape(objects)}</p></section>"
    )


def _list_pictures(sample: StoredSample, metadata: dict[str, Any]) -> Iterator[tuple[str, _Pixels]]:
    """Yield name and pixels of picture, boxes and channels."""
    rgb = decode_array(PICTURE, sample.files[PICTURE])
    yield "picture", rgb
    if metadata.get("objects"):
        yield "boxes", _draw_boxes(rgb, metadata["objects"])
    for name, suffix in CHANNEL_FILES.items():
        if suffix in sample.files:
            yield name, _colour_channel(name, decode_array(suffix, sample.files[suffix]))


def _describe_objects(objects: Sequence[dict[str, Any]]) -> str:
    largest = sorted(objects, key=lambda one: -one["area_px"])
    texts = [f"{one['name']} ({one['class']}, {one['area_px']} px)" for one in largest]
    more = f" and {len(texts) - _MAX_OBJECTS} more" if len(texts) > _MAX_OBJECTS else ""
    return ", ".join(texts[:_MAX_OBJECTS]) + more


def _make_figure(name: str, pixels: _Pixels) -> str:
    while pixels.shape[1] > 2 * _SHOWN_PX:
        pixels = pixels[::2, ::2]
    content = base64.b64encode(encode_png(np.ascontiguousarray(pixels))).decode()
    return (
        f'<figure><img alt="{name}" src="data:image/png;base64,{content}">'
        f"<figcaption>{name}</figcaption></figure>"
    )


def _make_page(name: str, num_samples: int, sections: Sequence[str]) -> str:
    title = html.escape(f"{name}: {len(sections)} of {num_samples} samples")
    return (
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{title}</h1>"
        "<p>range: near is bright; normal: x, y, z as red, green, blue; point: position modulo one "
        "metre; ids and classes: one colour each; flow: direction as hue, length as brightness; "
        "black: nothing, or unknown.</p>"
        f"{''.join(sections)}</body></html>\n"
    )


def _draw_boxes(rgb: _Pixels, objects: Sequence[dict[str, Any]]) -> _Pixels:
    """Picture with the box of each object, in the colour that the object has in `ids`."""
    picture = rgb.copy()
    height, width = picture.shape[:2]
    for one in objects:
        x, y, box_width, box_height = one["box_px"]
        right, bottom = min(x + box_width, width) - 1, min(y + box_height, height) - 1
        colour = _colour_of_number(one["id"])
        picture[[y, bottom], x : right + 1] = colour
        picture[y : bottom + 1, [x, right]] = colour
    return picture


def _colour_channel(name: str, array: npt.NDArray[Any]) -> _Pixels:
    """(h, w, 3) picture of a channel; black where there is nothing."""
    match name:
        case "range":
            grey = np.where(np.isfinite(array), 1.0 / (1.0 + array / _HALF_RANGE_M), 0.0)
            return _to_pixels(np.repeat(grey[..., None], 3, axis=-1))
        case "normal":
            # Nothing is a zero normal, which would be grey.
            is_surface = np.any(array != 0.0, axis=-1, keepdims=True)
            return _to_pixels(np.where(is_surface, 0.5 + 0.5 * array.astype(float), 0.0))
        case "point":
            return _to_pixels(np.nan_to_num(array.astype(float) % 1.0, nan=0.0))
        case "flow":
            return _colour_flow(array)
        case "ids" | "classes":
            return _colour_numbers(array)
        case "agreement":
            return _to_pixels(np.repeat(array[..., None] / 255.0, 3, axis=-1))
        case _:
            return _to_pixels(np.repeat(array[..., None].astype(float), 3, axis=-1))


def _colour_of_number(number: int) -> tuple[int, int, int]:
    """Colour of an object or class; black of 0, which is nothing."""
    red, green, blue = _colour_numbers(np.array([number])).reshape(3).tolist()
    return red, green, blue


def _colour_numbers(array: npt.NDArray[Any]) -> _Pixels:
    hue = array.astype(float) * _GOLDEN % 1.0
    colours = _rgb_from_hue(hue, np.ones_like(hue))
    return np.where((array == 0)[..., None], np.uint8(0), colours).astype(np.uint8)


def _colour_flow(array: npt.NDArray[Any]) -> _Pixels:
    is_known = np.isfinite(array).all(axis=-1)
    u, v = (np.where(is_known, array[..., axis], 0.0).astype(float) for axis in (0, 1))
    length = hypot(u, v)
    # The longest of most pixels is full brightness: single ones at the rim are far longer.
    limit = float(np.percentile(length[is_known], 95.0)) if is_known.any() else 1.0
    brightness = np.minimum(length / (limit or 1.0), 1.0)
    hue = arctan2(v, u) / (2.0 * math.pi) % 1.0
    # _Pixels that stand still are grey, unlike those without a flow.
    grey = np.where(is_known, 40, 0).astype(np.uint8)[..., None]
    return np.maximum(_rgb_from_hue(hue, brightness), grey)


def _rgb_from_hue(hue: npt.NDArray[Any], value: npt.NDArray[Any]) -> _Pixels:
    """(..., 3) colours of hues in turns, fully saturated."""
    offsets = np.array((0.0, 2.0 / 3.0, 1.0 / 3.0))
    ramps = np.abs(((hue[..., None] + offsets) % 1.0) * 6.0 - 3.0) - 1.0
    return _to_pixels(np.clip(ramps, 0.0, 1.0) * value[..., None])


def _to_pixels(colours: npt.NDArray[Any]) -> _Pixels:
    return np.asarray(np.round(255.0 * np.clip(colours, 0.0, 1.0)), dtype=np.uint8)
