"""A camera's calibration files in a folder, and CALIBRATION.md about them.

The report says what each exported file states, how good it is, and has points to check by hand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from catoptra_protocol.calibration.exports import (
    DEFAULT_MAX_RESIDUAL_PX,
    ExportedFile,
    RefusedFile,
    export_camera,
    turn_for_export,
)
from catoptra_protocol.calibration.formats import FORMATS
from catoptra_protocol.calibration.model_fits import compute_residual, fit_f_theta
from catoptra_protocol.calibration.ray_table import (
    FIELDS,
    FRAME,
    TABLE_NAME,
    bytes_from_ray_table,
    make_ray_table,
)
from catoptra_protocol.calibration.templates import describe_fields, fields_for_readers
from catoptra_protocol.command_line import CommandParser, parse_float_within
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture, describe_limit

_AXES = """\
```
     (0, 0) +--------------------> u, x {x}
            |
            |    (cx, cy) + z: away from you, along the optical axis into the scene
            |
            v v, y
```"""
# Angles of the worked points, as shares of the rim where that is nearer than the last.
_POINTS_DEG, _SHARES, _POINT_SHARE = (30.0, 90.0), (0.4, 0.8), 0.999
_POINT_AZIMUTH_RAD = math.radians(20.0)


def _write_report(
    camera: OmniCamera,
    results: Sequence[ExportedFile | RefusedFile],
    *,
    name: str,
    picture: Picture,
    robot_from_mirror: Floats | None = None,
) -> str:
    """Text of the report in Markdown.

    Args:
        camera: The camera.
        results: Result of each export.
        name: Name of the camera.
        picture: Hand of the pictures that the files describe.
        robot_from_mirror: (3, 3) rotation from the mirror frame to the robot's, if there is one.
    """
    described = turn_for_export(camera, picture)
    sections = (
        f"# Calibration of {name}",
        _describe_picture(camera, described, picture),
        _describe_frame(described, picture, robot_from_mirror),
        _list_files([one for one in results if isinstance(one, ExportedFile)]),
        _list_refusals(described, [one for one in results if isinstance(one, RefusedFile)]),
        _list_points(described),
    )
    return "\n\n".join(section for section in sections if section) + "\n"


def _describe_picture(camera: OmniCamera, described: OmniCamera, picture: Picture) -> str:
    u, v = described.centre_px
    lines = [
        f"All files are of the **{picture.value}** pictures of this camera, "
        f"{camera.width_px} x {camera.height_px} px. The server delivers "
        f"{camera.picture.value} ones"
        + (
            "."
            if camera.picture is picture
            else f": ask for `picture={picture.value}`, or turn each picture round left to right."
        ),
    ]
    if picture is Picture.MIRRORED:
        lines.append(
            "A mirrored picture has no right-handed frame: poses found with these files are those "
            "of a mirrored world, in which no printed tag is readable."
        )
    lines.append(
        f"The optical axis is at ({u:.6f}, {v:.6f}) where the first pixel's centre is (0.5, 0.5), "
        f"which is ({u - 0.5:.6f}, {v - 0.5:.6f}) where that is (0, 0)."
    )
    rim_deg = math.degrees(camera.rim_rad)
    lines.append(
        f"The camera shows directions up to {rim_deg:.3f} deg from the axis; its model reaches "
        f"{describe_limit(camera.projection)}."
    )
    return "\n\n".join(lines)


def _describe_frame(
    described: OmniCamera, picture: Picture, robot_from_mirror: Floats | None
) -> str:
    hand = "right" if picture is Picture.FLIPPED else "right in the picture, left in the world"
    text = (
        "## Frame\n\nThe frame below: x to the image's right, y down, z along the optical axis.\n\n"
        + _AXES.format(x=f"({hand})")
    )
    text += f"\n\n{_list_conventions()}"
    if robot_from_mirror is None:
        return text
    axes = robot_from_mirror @ _mirror_from_camera(described, picture)
    rows = "\n".join(
        f"| {axis} | {_format_vector(axes[:, index])} |" for index, axis in enumerate("xyz")
    )
    return (
        f"{text}\n\nIn the frame of the camera's carrier (x ahead, y right, z down):\n\n"
        f"| axis | direction |\n|---|---|\n{rows}"
    )


def _list_conventions() -> str:
    """Frame, pixel centre and fields of each format."""
    rows = [
        f"| {each.name} | {each.program} | {each.frame} | {each.first_pixel:g} | "
        f"{describe_fields(fields_for_readers(each.template))} | {each.reader} |"
        for each in FORMATS
    ]
    head = (
        "Files are tested by the programs themselves where the last column says `own`, else by a "
        "transcription of the parser that it names, with the fields that this requires.\n\n"
        "| format | program | frame | first pixel's centre | fields | read in tests by |\n"
        "|---|---|---|---|---|---|"
    )
    return "\n".join((head, *rows, f"| ray table | | {FRAME} | 0.5 | {FIELDS} | |"))


def _mirror_from_camera(described: OmniCamera, picture: Picture) -> Floats:
    """(3, 3) whose columns are the axes right, down, forward of a picture in the mirror frame."""
    ca = math.cos(described.image_up_azimuth_rad)
    sa = math.sin(described.image_up_azimuth_rad)
    sign = 1.0 if picture is Picture.FLIPPED else -1.0
    return np.array([[-sa * sign, -ca, 0.0], [ca * sign, -sa, 0.0], [0.0, 0.0, 1.0]])


def _list_files(files: Sequence[ExportedFile]) -> str:
    rows = [
        f"| {file.export.file_name} | {file.export.model.words}, {file.export.program} | "
        f"{file.residual.max_px:.2g} | "
        f"{file.residual.rms_px:.2g} | {file.residual.max_deg:.2g} | {file.residual.rms_deg:.2g} | "
        f"{file.export.domain} | {describe_limit(file.camera.projection)} |".replace(
            "|X|", "norm(X)"
        )
        for file in files
    ]
    head = (
        "## Files\n\nResiduals are differences from the camera's own model over its whole image, "
        "at 100 489 positions.\n\n"
        "| file | model | max px | rms px | max deg | rms deg | domain by its readers | "
        "domain of this file |\n|---|---|---|---|---|---|---|---|"
    )
    table = f"{TABLE_NAME} has the ray of each pixel's centre itself."
    if not rows:
        return f"## Files\n\nNo model describes this camera. {table}"
    return "\n".join((head, *rows)) + f"\n\n{table}"


def _list_refusals(described: OmniCamera, refused: Sequence[RefusedFile]) -> str:
    rows = [f"* {one.export.model.words} ({one.export.name}): {one.reason}" for one in refused]
    if described.is_central:
        rows.append(_describe_f_theta(described))
    return "## Not written\n\n" + "\n".join(rows) if rows else ""


def _describe_f_theta(described: OmniCamera) -> str:
    """Residual of NVIDIA's model, of whose files the pixel centre is not published."""
    try:
        model = fit_f_theta(described)
    except DomainError as error:
        return f"* NVIDIA's f-theta of degree 4: {error}"
    residual = compute_residual(described, model)
    return (
        f"* NVIDIA's f-theta of degree 4: off by up to {residual.max_px:.2g} px; its pixel centre "
        "is not published, so that no file is written"
    )


def _list_points(described: OmniCamera) -> str:
    """Three directions with their pixels, to be checked with any reader."""
    limit_deg = _POINT_SHARE * math.degrees(described.rim_rad)
    angles_deg = [
        min(angle, limit_deg * share) for angle, share in zip(_POINTS_DEG, _SHARES, strict=True)
    ]
    rows = []
    mirror_from_camera = _mirror_from_camera(described, Picture.FLIPPED)
    for angle_deg in (*angles_deg, limit_deg):
        theta = math.radians(angle_deg)
        ray = np.array(
            (
                math.sin(theta) * math.cos(_POINT_AZIMUTH_RAD),
                math.sin(theta) * math.sin(_POINT_AZIMUTH_RAD),
                math.cos(theta),
            )
        )
        pixel, _ = described.pixel_from_direction(mirror_from_camera @ ray)
        rows.append(
            f"| {angle_deg:.3f} | {_format_vector(ray, digits=9)} | "
            f"{pixel[0] - 0.5:.6f}, {pixel[1] - 0.5:.6f} | {pixel[0]:.6f}, {pixel[1]:.6f} |"
        )
    head = (
        "## Worked points\n\n| angle from z, deg | direction (x, y, z) | pixel, first centre 0 | "
        "first centre 0.5 |\n|---|---|---|---|"
    )
    return "\n".join((head, *rows))


def _format_vector(vector: Floats, *, digits: int = 6) -> str:
    # + 0.0: no negative zero.
    return ", ".join(f"{round(float(value), digits) + 0.0:.{digits}f}" for value in vector)


REPORT_NAME = "CALIBRATION.md"


def add_calibration_options(parser: CommandParser) -> None:
    """Declare the options of a command that calls `write_calibration`."""
    add = parser.add_argument
    add("--out", required=True, type=Path, metavar="DIR", help="folder, made if absent")
    add("--picture", choices=[picture.value for picture in Picture],
        default=Picture.FLIPPED.value, help="hand of the pictures that the files describe; all "
        "formats are made for flipped ones")  # fmt: skip
    add("--max-residual-px", type=partial(parse_float_within, name="a residual"), metavar="PX",
        default=DEFAULT_MAX_RESIDUAL_PX,
        help="largest difference of a file from the camera, anywhere in the image")  # fmt: skip


def write_calibration(
    camera: OmniCamera,
    folder: Path,
    *,
    name: str,
    picture: Picture = Picture.FLIPPED,
    max_residual_px: float = DEFAULT_MAX_RESIDUAL_PX,
    robot_from_mirror: Floats | None = None,
) -> list[str]:
    """Write all files of a camera; a line about each, the refused ones included.

    Args:
        camera: The camera.
        folder: Folder, made if absent.
        name: Name of the camera in the files.
        picture: Hand of the pictures that the files describe.
        max_residual_px: Largest residual anywhere in the image.
        robot_from_mirror: (3, 3) rotation of the mirror frame on the robot, for the report.

    Raises:
        DomainError: An impossible residual.
        OSError: A file cannot be written.
    """
    if not 0.0 <= max_residual_px < math.inf:
        raise DomainError(f"a residual is 0 px or more, not {max_residual_px!r}")
    results = [
        export_camera(camera, one, name=name, picture=picture, max_residual_px=max_residual_px)
        for one in FORMATS
    ]
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for result in results:
        if isinstance(result, ExportedFile):
            path = folder / result.export.file_name
            path.write_text(result.text, encoding="utf-8")
            lines.append(f"{path}: within {result.residual.max_px:.2g} px")
        else:
            lines.append(f"not written: {result.export.name}: {result.reason}")
    lines.append(_write_table(camera, folder, picture))
    report = _write_report(
        camera, results, name=name, picture=picture, robot_from_mirror=robot_from_mirror
    )
    (folder / REPORT_NAME).write_text(report, encoding="utf-8")
    return [*lines, f"{folder / REPORT_NAME}: frame, residuals, domains, worked points"]


def _write_table(camera: OmniCamera, folder: Path, picture: Picture) -> str:
    """Write the ray table, which describes any camera; the line about it."""
    table = replace(make_ray_table(turn_for_export(camera, picture)), picture=picture)
    path = folder / TABLE_NAME
    path.write_bytes(bytes_from_ray_table(table, law=repr(camera.projection)))
    return f"{path}: the ray of each pixel's centre"
