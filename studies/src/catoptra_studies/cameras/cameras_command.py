"""The command `catoptra-studies cameras`: a gallery of camera models in one world.

Each camera has a picture with rings of equal angle, a plot of resolution by angle, and a row of
numbers that follow from the model alone; only the milliseconds are measured.
"""

from __future__ import annotations

import argparse
import html
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.optics.camera_rays import near_limit_m
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_studies.cameras.camera_metrics import (
    covered_sphere,
    min_angle_rad,
    resolution_curve,
    ring_pixels,
)
from catoptra_studies.cameras.camera_stage import (
    CameraStage,
    StagedCamera,
    add_camera_options,
    open_requested_stage,
)
from catoptra_studies.commands import add_output, make_parser, parse_study, print_line
from catoptra_studies.plot_style import (
    BLUE,
    ORANGE,
    RED,
    Image,
    Page,
    add_axes,
    add_text,
    label_box,
    open_page,
    show_image,
)
from catoptra_studies.reports import (
    Cell,
    ReportFigure,
    figure_element,
    format_number,
    html_table,
    write_json,
)

_RING_SPACING_DEG = 30
_IMAGE_PX = 640
# Across the radius the resolution is infinite at the antipode: plots end a degree before.
_MAX_PLOTTED_RAD = math.radians(179.0)
_MAX_SCALED_RAD = math.radians(150.0)
_RIM_MARGIN_RAD = math.radians(0.01)

_HEADER = (
    "camera", "covered sphere", "rim, deg", "domain, deg", "first fold, deg",
    "central beyond, m", "ms a frame",
)  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    """Draw the gallery."""
    parser = make_parser(
        "cameras",
        "Draw all camera models in one world, with circles of equal angle, covered sphere, "
        "resolution by angle, domain, first fold and milliseconds a frame.",
    )
    add_camera_options(parser, size_px=640)
    add_output(parser, "out/cameras", "folder for index.html, cameras.json and pictures")
    return _run(parse_study(parser, arguments))


def _run(parsed: argparse.Namespace) -> int:
    folder: Path = parsed.out
    with open_requested_stage(parsed) as (stage, on_camera):
        frame_ms = stage.time_frames(parsed.frames)
        rows = [_describe_camera(c, ms) for c, ms in zip(stage.cameras, frame_ms, strict=True)]
        for index, staged in enumerate(stage.cameras):
            with open_page(folder / f"{staged.file.name}.png", 740) as page:
                _draw_camera(page, staged, stage.render_frame(index))
            on_camera()
    write_json(folder / "cameras.json", rows)
    path = folder / "index.html"
    path.write_text(_format_page(folder, stage, rows), encoding="utf-8")
    print_line(f"written: {path}")
    return 0


def _describe_camera(staged: StagedCamera, frame_ms: float) -> dict[str, Any]:
    """Numbers of a camera, as for JSON: None stands for nothing or unknown."""
    camera, file = staged.camera, staged.file
    fold_rad, near_m = camera.fold_rad, near_limit_m(camera)
    return {
        "name": file.name,
        "title": file.title,
        "source": file.source,
        "licence": file.licence,
        "covered_sphere": covered_sphere(camera),
        "rim_deg": math.degrees(camera.rim_rad),
        # Where the domain of the model ends.
        "domain_deg": math.degrees(2.0 * math.atan(camera.projection.t_limit)),
        "first_fold_deg": None if math.isinf(fold_rad) else math.degrees(fold_rad),
        "central_beyond_m": None if math.isnan(near_m) else near_m,
        "frame_ms": frame_ms,
    }


def _draw_camera(page: Page, staged: StagedCamera, image: Image) -> None:
    camera = staged.camera
    width = round(_IMAGE_PX * min(1.0, image.shape[1] / image.shape[0]))
    axes = show_image(page, image, 20, 60, width)
    add_text(page, 20, 14, staged.file.title, fontsize=10, fontweight="bold")
    for degrees in range(_RING_SPACING_DEG, 180, _RING_SPACING_DEG):
        # On the rim itself rounding would make a dashed line.
        if math.radians(degrees) > camera.rim_rad - _RIM_MARGIN_RAD:
            break
        pixel = ring_pixels(camera, math.radians(degrees))
        colour = RED if degrees == 90 else ORANGE
        axes.plot(pixel[:, 0], pixel[:, 1], color=colour, linewidth=0.8)
        u, v = pixel[45]
        if math.isfinite(u):
            box = label_box(0.8)
            axes.text(u, v, f"{degrees}°", ha="center", va="center", fontsize=7, bbox=box)
    _draw_resolution(page, camera)


def _draw_resolution(page: Page, camera: OmniCamera) -> None:
    theta = np.linspace(min_angle_rad(camera), min(camera.rim_rad, _MAX_PLOTTED_RAD), 400)
    radial, tangential = resolution_curve(camera, theta)
    axes = add_axes(page, 780, 90, 700, 540)
    axes.plot(np.degrees(theta), radial, color=BLUE, label="along the image radius")
    axes.plot(np.degrees(theta), tangential, "--", color=ORANGE, label="across it")
    # Scales near an antipode would flatten all other parts of the curves.
    shown = theta <= _MAX_SCALED_RAD
    highest = 1.1 * float(np.maximum(radial, tangential)[shown].max())
    axes.set(xlim=(0, 180), ylim=(0, highest), xticks=range(0, 181, _RING_SPACING_DEG),
             xlabel="angle from the axis, degrees")  # fmt: skip
    axes.axvline(90.0, color=RED, linewidth=0.8)
    axes.set_title(f"px per degree, image of {camera.width_px} x {camera.height_px} px")
    axes.legend(loc="best")


def _format_page(folder: Path, stage: CameraStage, rows: list[dict[str, Any]]) -> str:
    cells = [[row["title"], *(Cell(text, "n") for text in _row_texts(row))] for row in rows]
    figures = [
        figure_element(folder, _figure(camera, row))
        for camera, row in zip(stage.cameras, rows, strict=True)
    ]
    style = "body{font:15px sans-serif;max-width:980px;margin:2em auto}td.n{text-align:right}"
    style += "td,th{padding:2px 8px;text-align:left}figure{margin:2em 0}"
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Cameras</title>'
        f"<style>{style}</style><h1>Cameras</h1><p>{html.escape(_INTRODUCTION)}</p>"
        f"{html_table(_HEADER, cells)}{''.join(figures)}</html>\n"
    )


_INTRODUCTION = (
    "All cameras at one place in one world, looking down, forward at the top. Circles are angles "
    f"from the axis, every {_RING_SPACING_DEG} degrees, red at 90. The domain is that of the "
    "formula; at its first fold the image radius turns back. Beyond the distance in the table the "
    "central approximation holds; 0 for central cameras. Milliseconds are processor time, medians."
)


def _row_texts(row: dict[str, Any]) -> list[str]:
    fold, near = row["first_fold_deg"], row["central_beyond_m"]
    return [
        f"{row['covered_sphere']:.1%}",
        format_number(row["rim_deg"], 4),
        format_number(row["domain_deg"], 4),
        "none" if fold is None else format_number(fold, 4),
        "unknown" if near is None else format_number(near),
        format_number(row["frame_ms"]),
    ]


def _figure(staged: StagedCamera, row: dict[str, Any]) -> ReportFigure:
    file = staged.file
    return ReportFigure(
        f"{file.name}.png",
        file.title,
        f"File {file.path.name}. Source: {file.source}. Licence: {file.licence}. It shows "
        f"{row['covered_sphere']:.1%} of the sphere.",
        f"Image of the camera {file.name} with circles of equal angle, and its resolution by angle",
    )
