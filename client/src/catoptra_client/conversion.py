"""`catoptra-client convert`: a calibration file in other formats, with what is lost; no server.

Without `--to` it says what every format would lose. A file is written with a picture of the
difference from the camera that was read, over its whole image.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from catoptra_client.frame_pictures import write_image
from catoptra_protocol.calibration.calibration_files import read_calibration
from catoptra_protocol.calibration.exports import (
    DEFAULT_MAX_RESIDUAL_PX,
    ExportedFile,
    RefusedFile,
    export_camera,
)
from catoptra_protocol.calibration.formats import FORMATS, CalibrationFormat, find_format
from catoptra_protocol.calibration.model_fits import draw_difference
from catoptra_protocol.command_line import CommandParser, parse_float_within
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.limits import MAX_IMAGE_SIDE_PX
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import describe_limit


def convert(words: Sequence[str]) -> int:
    """Run the command."""
    parser = CommandParser(
        "catoptra-client convert",
        "Read a calibration file, and write it in a format of another program.",
    )
    add = parser.add_argument
    add("file", type=Path, metavar="FILE", help="calibration file of any known program")
    add("--to", metavar="FORMAT",
        help="format to write (default: none, list what each would lose)")  # fmt: skip
    add("--out", type=Path, default=Path(), metavar="DIR", help="folder of the written file")
    add("--camera", default="", metavar="NAME",
        help="camera of a file with several, such as cam1 (default: the first)")  # fmt: skip
    add("--size", type=_parse_size, metavar="WxH",
        help="width and height of the images, for a file that states none")  # fmt: skip
    add("--field-of-view", metavar="DEG",
        type=partial(parse_float_within, name="a field of view", last=360.0, unit=" deg"),
        help="widest angle to describe (default: the image's)")  # fmt: skip
    add("--max-residual-px", type=partial(parse_float_within, name="a residual"), metavar="PX",
        default=DEFAULT_MAX_RESIDUAL_PX,
        help="largest difference, anywhere in the image")  # fmt: skip
    parsed = parser.parse_args(words)
    to = None if parsed.to is None else find_format(parsed.to)
    name, camera = read_calibration(parsed.file, camera=parsed.camera, size_px=parsed.size)
    camera = _narrow(camera, parsed.field_of_view)
    print(f"{parsed.file}: {name}, {type(camera.projection).__name__}, "
          f"{camera.width_px} x {camera.height_px} px, {_describe_domain(camera)}")  # fmt: skip
    if to is not None:
        print(_write(camera, to, parsed))
        return 0
    for each in FORMATS:
        result = _export(camera, each, parsed)
        print(
            f"{each.name}: no, {result.reason}"
            if isinstance(result, RefusedFile)
            else f"{each.name}: within {result.residual.max_px:.2g} px; readers: {each.domain}"
        )
    return 0


def _export(
    camera: OmniCamera, to: CalibrationFormat, parsed: argparse.Namespace
) -> ExportedFile | RefusedFile:
    """The camera in a format, as far from the axis as its readers go."""
    narrowed = replace(camera, rim_rad=min(camera.rim_rad, to.max_angle_rad))
    return export_camera(
        narrowed, to, name=parsed.file.stem, picture=camera.picture,
        max_residual_px=parsed.max_residual_px,
    )  # fmt: skip


def _parse_size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    sides = (int(found[1]), int(found[2])) if found else (0, 0)
    if not (1 <= min(sides) and max(sides) <= MAX_IMAGE_SIDE_PX):
        expected = f"WxH, such as 640x480, of at most {MAX_IMAGE_SIDE_PX} px"
        raise argparse.ArgumentTypeError(f"{text!r} is no size: {expected}")
    return sides


def _narrow(camera: OmniCamera, field_deg: float | None) -> OmniCamera:
    """The camera up to a field of view."""
    if field_deg is None:
        return camera
    rim_rad = math.radians(0.5 * field_deg)
    if not 0.0 < rim_rad <= camera.rim_rad:
        widest_deg = math.degrees(2.0 * camera.rim_rad)
        raise CatoptraError(
            f"--field-of-view {field_deg:g}: the file's image shows 0 to {widest_deg:.3f} deg"
        )
    return replace(camera, rim_rad=rim_rad)


def _describe_domain(camera: OmniCamera) -> str:
    return (
        f"up to {math.degrees(camera.rim_rad):.3f} deg from the axis of the model's "
        f"{describe_limit(camera.projection)}"
    )


def _write(camera: OmniCamera, to: CalibrationFormat, parsed: argparse.Namespace) -> str:
    """Write a file and the picture; lines about both.

    Raises:
        CatoptraError: The format does not describe the camera well enough.
    """
    result = _export(camera, to, parsed)
    if isinstance(result, RefusedFile):
        raise CatoptraError(f"not written: {to.name}: {result.reason}")
    parsed.out.mkdir(parents=True, exist_ok=True)
    path = parsed.out / to.file_name
    if path.exists() and path.samefile(parsed.file):
        raise CatoptraError(f"{path} is the file to convert: --out DIR writes elsewhere")
    path.write_text(result.text, encoding="utf-8")
    residual = result.residual
    picture = path.with_name(f"{to.name}_difference.png")
    write_image(picture, draw_difference(camera, result.camera, residual.max_px))
    left_out = ""
    if camera.rim_rad > to.max_angle_rad:
        left_out = f", which leave out what lies beyond {math.degrees(to.max_angle_rad):g} deg"
    return (
        f"{path}: {to.name}, "
        f"within {residual.max_px:.2g} px (rms {residual.rms_px:.2g}) and "
        f"{residual.max_deg:.2g} deg, {_describe_domain(result.camera)}; "
        f"readers: {to.domain}{left_out}\n"
        f"{picture}: the difference, yellow at {residual.max_px:.2g} px"
    )
