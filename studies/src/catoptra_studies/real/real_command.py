"""The command `catoptra-studies real`: photographs against their twins, as a report and as tables.

    catoptra-studies real FOLDER --camera-file kaidan_360 --board 11x7 --square 0.03

The report is one HTML file; `--page` writes the same tables into a marked block of a document, with
a picture beside it, and `--fitted` a camera file with the fitted numbers.
"""

from __future__ import annotations

import argparse
import html
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from catoptra_protocol.command_line import CommandParser
from catoptra_server.config.camera_file import read_camera_file
from catoptra_server.config.known_names import find_configuration
from catoptra_studies.commands import (
    add_output,
    make_parser,
    open_progress,
    parse_study,
    print_line,
)
from catoptra_studies.plot_style import BLUE, ORANGE, PAGE_WIDTH_IN, TEAL, Axes, open_chart
from catoptra_studies.real.gap_table import CLEAN, Estimate, GapRow, Sample
from catoptra_studies.real.photographs import Board, rms, write_jpeg
from catoptra_studies.real.real_study import (
    ALL,
    EFFECTS,
    FITTED,
    NUM_STEPS,
    StudyOptions,
    StudyResult,
    run_study,
)
from catoptra_studies.real.twin import VERTEX_M, write_mirror_camera
from catoptra_studies.reports import (
    ReportFigure,
    figure_elements,
    html_table,
    markdown_table,
    replace_block,
    replace_non_finite,
    wrap_paragraph,
    write_json,
)

_BLOCK = "real"
_PAGE_QUALITY = 85
_ANGLE_BINS_DEG = (50, 70, 90, 105, 122)
# Corners and edges, beside noise, light and colours: a table of all is too wide to read.
_NUM_GEOMETRIC = 5
_KINDS = (("photographs", BLUE), (CLEAN, ORANGE), (FITTED, TEAL))


def main(arguments: Sequence[str]) -> int:
    """Run the command."""
    parsed = parse_study(_build_parser(), arguments)
    options = StudyOptions(
        parsed.folder,
        find_configuration("cameras", parsed.camera_file),
        Board(parsed.board[0], parsed.board[1], parsed.square),
        parsed.out,
        effects=tuple(parsed.effects),
        num_processes=parsed.workers,
    )
    with open_progress() as progress:
        result = run_study(options, on_step=progress.add_task("photographs and twins", NUM_STEPS))
    report = _write_report(parsed.out, result, options)
    if parsed.page:
        _write_page(parsed.page, result, options)
    if parsed.fitted:
        _write_fitted_camera(parsed.fitted, result, options)
    print_line(_describe_check(result, options))
    print_line(f"written: {report}")
    return 0


def _build_parser() -> CommandParser:
    parser = make_parser(
        "real", "Compare photographs of a board through a real camera with pictures of its twin."
    )
    add = parser.add_argument
    add("folder", type=Path, metavar="FOLDER", help="photographs of one camera, JPEG or PNG")
    add_output(parser, "out/real", "folder for report.html, real.json, and the twins' files")
    add("--camera-file", default="kaidan_360", metavar="FILE", help="camera ini, or a bundled name")
    add("--board", type=_parse_board, default=(11, 7), metavar="11x7",
        help="inner corners of the chessboard")  # fmt: skip
    add("--square", type=_parse_square, default=0.03, metavar="M", help="side of its squares")
    add("--effects", nargs="+", choices=EFFECTS, default=EFFECTS, metavar="EFFECT",
        help=f"effects to force on alone: {', '.join(EFFECTS)}")  # fmt: skip
    add("--workers", type=int, choices=range(1, 65), default=2, metavar="N",
        help="processes that draw")  # fmt: skip
    add("--page", type=Path, metavar="FILE", help="document whose marked block gets the tables")
    add("--fitted", type=Path, metavar="FILE", help="camera file to write with fitted numbers")
    return parser


def _parse_board(text: str) -> tuple[int, int]:
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError:
        columns = rows = 0
    if not (3 <= columns <= 64 and 3 <= rows <= 64):
        raise argparse.ArgumentTypeError(f"a board is COLUMNSxROWS of inner corners, not {text!r}")
    return columns, rows


def _parse_square(text: str) -> float:
    try:
        side_m = float(text)
    except ValueError:
        side_m = math.nan
    if not 1e-4 <= side_m <= 10.0:
        raise argparse.ArgumentTypeError(f"a square's side is 0.0001 to 10 metres, not {text!r}")
    return side_m


def _describe_check(result: StudyResult, options: StudyOptions) -> str:
    """Sentences on boards, residuals and straightness."""
    boards, everything = len(result.validated), len(result.photographs.photographs)
    own = rms([pose.mean_square_px for pose in result.calibration.poses])
    other = rms([pose.mean_square_px for pose in result.validated])
    straight = math.sqrt(float(np.square(result.straightness_px).mean()))
    angle = np.degrees(result.corner_incidence_rad)
    return (
        f"Boards in {boards} of {everything} photographs, corners between {angle.min():.0f} and "
        f"{angle.max():.0f} degrees of incidence. Re-projection: {own:.3f} px rms by the camera "
        f"that was fitted to all, {other:.3f} px by one that was fitted to the other half. Rows of "
        f"corners are off a great circle by {straight:.3f} px rms. Corners of the clean twin are "
        f"off their projections by {result.twin_corner_rms_px:.3f} px rms. Camera "
        f"{options.camera_file.stem}, board of {options.board.columns} x {options.board.rows} "
        f"corners, {1e3 * options.board.square_m:g} mm; JPEG quality "
        f"{result.photographs.jpeg_quality or 'none'}."
    )


def _check_rows(result: StudyResult) -> list[list[str]]:
    """Residuals by incidence."""
    angle = np.degrees(result.corner_incidence_rad)
    off = np.concatenate([np.square(pose.residual_px).sum(axis=1) for pose in result.validated])
    rows = []
    for low, high in pairwise(_ANGLE_BINS_DEG):
        chosen = (angle >= low) & (angle < high)
        if chosen.any():
            straight = math.sqrt(np.square(result.straightness_px[chosen]).mean())
            validated = math.sqrt(off[chosen].mean())
            rows.append([f"{low} to {high}°", f"{int(chosen.sum())}", f"{validated:.2f}",
                         f"{straight:.2f}"])  # fmt: skip
    return rows


_CHECK_HEADER = ("incidence", "corners", "cross-validated, px rms", "off a straight row, px rms")
_TRANSFER_HEADER = ("trained on", "class", "hits", "false positives")


def _closed_tables(rows: Sequence[GapRow]) -> list[tuple[list[str], list[list[str]]]]:
    """Part of each gap that each effect closes: a line for an effect, a table for some columns."""
    groups = rows[:_NUM_GEOMETRIC], rows[_NUM_GEOMETRIC:]
    return [
        (
            ["effect", *(row.quantity for row in group)],
            [[name, *(str(row.closed[name]) for row in group)] for name in group[0].closed],
        )
        for group in groups
    ]


def _value_table(rows: Sequence[GapRow]) -> tuple[list[str], list[list[str]]]:
    kinds = ("photographs", CLEAN, ALL, FITTED)
    table = [
        [row.quantity, *(str(row.values[kind]) for kind in kinds), str(row.remainder[FITTED])]
        for row in rows
    ]
    return ["quantity", *kinds, "remainder"], table


def _transfer_table(result: StudyResult) -> list[list[str]]:
    kept = ("photographs", CLEAN, ALL, FITTED)
    return [[one.training, one.class_name, str(one.hits), str(one.false_positives)]
            for one in result.transfer if one.training in kept]  # fmt: skip


def _write_report(folder: Path, result: StudyResult, options: StudyOptions) -> Path:
    write_json(folder / "real.json", replace_non_finite(_as_json(result)))
    figures = _draw_figures(folder, result)
    _write_strip(folder, result)
    style = "body{font:15px sans-serif;max-width:1200px;margin:2em auto}td,th{padding:2px 8px;"
    style += "text-align:left;border-bottom:1px solid #ddd}table{font-size:12px}"
    parts = (
        f"<p>{html.escape(_describe_check(result, options))}</p>",
        html_table(_CHECK_HEADER, _check_rows(result)),
        "<h2>Values</h2>",
        html_table(*_value_table(result.rows)),
        "<h2>Part of the gap that each effect closes</h2>",
        *(html_table(*table) for table in _closed_tables(result.rows)),
        "<h2>Eq. 3 between board and room</h2>",
        html_table(_TRANSFER_HEADER, _transfer_table(result)),
        f"<h2>Fitted camera</h2><pre>{html.escape(chr(10).join(result.camera_lines))}</pre>",
        figure_elements(folder, figures),
    )
    path = folder / "report.html"
    path.write_text(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Photographs and twins</title>'
        f"<style>{style}</style><h1>Photographs and their twins</h1>{''.join(parts)}</html>\n",
        encoding="utf-8",
    )
    return path


def _as_json(result: StudyResult) -> dict[str, object]:
    def numbers(one: Estimate) -> list[float]:
        return [one.value, one.low, one.high, one.count]

    return {
        "check": [math.sqrt(pose.mean_square_px) for pose in result.validated],
        "twin_corner_rms_px": result.twin_corner_rms_px,
        "rows": {
            row.quantity: {
                "values": {name: numbers(one) for name, one in row.values.items()},
                "remainder": {name: numbers(one) for name, one in row.remainder.items()},
                "closed": {name: numbers(one) for name, one in row.closed.items()},
            }
            for row in result.rows
        },
        "transfer": [
            [one.training, one.class_name, *numbers(one.hits), *numbers(one.false_positives)]
            for one in result.transfer
        ],
        "camera": list(result.camera_lines),
    }


def _draw_figures(folder: Path, result: StudyResult) -> tuple[ReportFigure, ...]:
    with open_chart(folder / "curves.png", figsize=(PAGE_WIDTH_IN, 2.8)) as figure:
        left, right = figure.subplots(1, 2)
        for name, colour in _KINDS:
            _draw_curves(left, right, result.samples[name], name, colour)
        left.set(xlabel="incidence, degrees", ylabel="10 to 90 %, px", title="Width of edges")
        right.set(xlabel="grey level", ylabel="grey levels", title="Noise of patches", ylim=(0, 8))
        left.legend()
    return (
        ReportFigure("curves.png", "Edges and noise", "Medians of photographs and of twins.",
                     "Edge width by incidence and noise by grey level"),
        ReportFigure("real-twin.jpg", "The first photograph and its twins", "As coded.",
                     "A photograph, its clean twin and its twin by the fitted camera"),
    )  # fmt: skip


def _draw_curves(
    left: Axes, right: Axes, samples: Sequence[Sample], name: str, colour: str
) -> None:
    measures = [one.measures for one in samples]
    angle = np.degrees(np.concatenate([one.edge_incidence_rad for one in measures]))
    width = np.concatenate([one.edge_widths_px for one in measures])
    level = np.concatenate([one.patch_levels for one in measures])
    noise = np.concatenate([one.patch_noise for one in measures])
    for axes, x, y, step in ((left, angle, width, 6.0), (right, level, noise, 8.0)):
        number = np.floor(x / step)
        kept = [n for n in np.unique(number) if (number == n).sum() >= 12]
        middles = [x[number == n].mean() for n in kept]
        medians = [np.median(y[number == n]) for n in kept]
        axes.plot(middles, medians, "o-", color=colour, label=name, ms=3)


def _write_strip(folder: Path, result: StudyResult) -> None:
    """The first photograph beside its clean twin and its twin by the fitted camera."""
    photograph = result.photographs.with_boards[0].rgb
    strip = np.concatenate((photograph, result.examples[CLEAN], result.examples[FITTED]), axis=1)
    write_jpeg(folder / "real-twin.jpg", strip, _PAGE_QUALITY)


def _write_page(path: Path, result: StudyResult, options: StudyOptions) -> None:
    """Write the tables into the marked block, and the pictures beside the document."""
    _write_strip(path.parent, result)
    parts = (
        wrap_paragraph(_describe_check(result, options)),
        markdown_table(_CHECK_HEADER, _check_rows(result)),
        wrap_paragraph(
            "Values with their 95 % intervals and the number of photographs; the remainder "
            "is the fitted camera's twin less the photographs, and 0 in its interval is no gap:"
        ),
        markdown_table(*_value_table(result.rows)),
        wrap_paragraph(
            "Part of each gap that an effect closes, forced on alone: 1 is all of it, 0 nothing, "
            "below 0 it leads away:"
        ),
        *(markdown_table(*table) for table in _closed_tables(result.rows)),
        wrap_paragraph(
            "Eq. 3 between black squares, white squares and room, trained on one half of each kind "
            "of pictures, judged on the photographs of the other half:"
        ),
        markdown_table(_TRANSFER_HEADER, _transfer_table(result)),
    )
    replace_block(path, _BLOCK, "\n\n".join(parts))


def _write_fitted_camera(path: Path, result: StudyResult, options: StudyOptions) -> None:
    focal_px = result.parameters.focal_px
    write_mirror_camera(
        path,
        result.calibration.camera,
        focal_px=focal_px,
        vertex_m=VERTEX_M,
        effects=result.camera_lines,
        origin=read_camera_file(options.camera_file),
    )
