"""A camera's calibration files in a folder, with the report about them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from catoptra_protocol.calibration.calibration_report import write_report
from catoptra_protocol.calibration.exports import (
    DEFAULT_MAX_RESIDUAL_PX,
    EXPORTS,
    ExportedFile,
    export_camera,
    turn_for_export,
)
from catoptra_protocol.calibration.ray_table import (
    TABLE_NAME,
    bytes_from_ray_table,
    make_ray_table,
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture

REPORT_NAME = "CALIBRATION.md"


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
        for one in EXPORTS
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
    report = write_report(
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
