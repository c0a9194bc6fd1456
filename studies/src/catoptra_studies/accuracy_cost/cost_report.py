"""COST.md: what accuracy costs in time, told from cost.json. Says what was measured, not hoped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from catoptra_studies.accuracy_cost.cost_results import (
    CostResults,
    LevelCost,
    PolygonRow,
    StudyConditions,
)
from catoptra_studies.accuracy_cost.frame_rate_report import format_frame_rates
from catoptra_studies.accuracy_cost.localization_report import format_localization
from catoptra_studies.reports.markdown import format_number, markdown_table, wrap_paragraph
from catoptra_studies.accuracy_cost.pareto import MIN_GAIN
from catoptra_studies.accuracy_cost.polygon_table import is_within_tolerance

_GLOSSARY = """\
| word | means |
|---|---|
| ms | median time of a frame with read-back, all steps drawn in turns |
| processor ms | the same of all processors together; compare these where others used the machine |
| bound px | no place of a frame is farther from where the camera law puts it (`planning/error_bound`) |
| rms px | the same over the image, root mean square |
| RMSE, PSNR, SSIM | of greys, against {samples} x {samples} exact rays a pixel, at {poses} places |
"""
_LEVEL_NAME_NOTE = """
A step's name says who draws, how, and the samples along both sides of a pixel. Faces, where not
told, have a texel a pixel; `x 0.5` and `x 2` are the plan's size scaled. `uv` and `position` say
what is interpolated over a polygon. The lines of a robot file that ask for a step stand in
`out/cost/cost.json`, pictures of all this in `out/cost`.
"""


def format_cost_report(results: CostResults) -> str:
    """Return the whole report."""
    parts = [
        _format_header(results.conditions),
        _format_pareto_front(results),
        _format_levels(results),
        _format_polygons(results),
        format_frame_rates(results),
        format_localization(results),
    ]
    return "\n\n".join(part.strip() for part in parts if part) + "\n"


def format_summary_table(results: CostResults) -> str:
    """Return the key steps alone, with what their frames are worth to a robot: for the README."""
    rows_by_step = (
        {row.level: row for row in results.localization.rows} if results.localization else {}
    )
    head = ["step", "ms", "bound px", "RMSE", "SSIM"]
    head += ["beacons found", "bearing", "filter's error"] if rows_by_step else []
    rows = []
    for step in _sort_by_error(step for step in results.levels if step.is_key):
        row = [step.name, f"{step.wall_ms:.1f}", format_number(step.bound_max_px, 2), format_number(step.rmse, 2),
               f"{step.ssim:.3f}"]  # fmt: skip
        if found := rows_by_step.get(step.name):
            row += [f"{found.detection_rate:.0%}", f"{found.bearing_rms_deg:.2g}°",
                    f"{found.consistent_ekf_mean_m:.3f} m"]  # fmt: skip
        elif rows_by_step:
            row += ["-", "-", "-"]
        rows.append(row)
    return markdown_table(head, rows)


def _format_header(conditions: StudyConditions) -> str:
    quick = "It was a quick look: expect more noise." if conditions.is_quick else ""
    size = f"{conditions.size_px} x {conditions.size_px} px"
    machine = wrap_paragraph(
        f"Written by `make cost` on {conditions.date}; do not edit. Measured on "
        f"{conditions.machine}: compare rows with each other, not with another machine's. {quick}"
    )
    what = wrap_paragraph(
        f"{conditions.robot} in {conditions.world}, {size}, {conditions.num_rounds} frames of each "
        f"step. Renderers: {'; '.join(conditions.renderers)}."
    )
    words = _GLOSSARY.format(samples=conditions.reference_samples, poses=conditions.num_poses)
    return f"# What accuracy costs in time\n\n{machine}\n\n{what}\n\n{words}\n{wrap_paragraph(_LEVEL_NAME_NOTE)}"


def _format_pareto_front(results: CostResults) -> str:
    front = sorted(
        (step for step in results.levels if step.is_on_pareto_front), key=lambda s: s.wall_ms
    )
    rows = []
    for before, step in zip([None, *front[:-1]], front, strict=True):
        buys = "" if before is None else (
            f"{step.wall_ms / before.wall_ms - 1.0:+.0%} time, {step.rmse / before.rmse - 1.0:+.0%} RMSE"
        )  # fmt: skip
        rows.append([step.name, f"{step.wall_ms:.1f}", format_number(step.bound_max_px), format_number(step.rmse, 2),
                     f"{step.psnr_db:.1f}", f"{step.ssim:.4f}", buys])  # fmt: skip
    head = ("step", "ms", "bound px", "RMSE", "PSNR dB", "SSIM", "against the row above")
    polygons = [step.name for step in front if step.num_polygons]
    told = (
        "No polygon mirror is on it: there is always an exact mirror both faster and better."
        if not polygons
        else f"Polygon mirrors on it: {', '.join(polygons)}."
    )
    return f"""\
## The front: what is never beaten in time and picture at once

A slower step stands here only if it takes at least {MIN_GAIN:.0%} off the RMSE before it.

{markdown_table(head, rows)}

{wrap_paragraph(told)}

`pareto.png`, `steps.png`."""


def _format_levels(results: CostResults) -> str:
    rows = [
        [step.name, f"{step.wall_ms:.1f}", f"{step.cpu_ms:.1f}", _format_stages(step),
         format_number(step.bound_max_px), format_number(step.bound_rms_px), format_number(step.rmse, 2),
         f"{step.psnr_db:.1f}", f"{step.ssim:.4f}"]
        for step in _sort_by_error(results.levels)
    ]  # fmt: skip
    head = (
        "step",
        "ms",
        "processor ms",
        "stages, ms",
        "bound px",
        "rms px",
        "RMSE",
        "PSNR dB",
        "SSIM",
    )
    return f"## Every step, best picture first\n\n{markdown_table(head, rows)}"


def _sort_by_error(levels: Iterable[LevelCost]) -> list[LevelCost]:
    return sorted(levels, key=lambda step: step.rmse)


def _format_stages(level: LevelCost) -> str:
    return ", ".join(f"{name} {ms:.1f}" for name, ms in level.stage_ms.items())


def _format_polygons(results: CostResults) -> str:
    rows = [
        [f"{row.num_polygons} = {row.sectors} x {row.rings}, {row.interpolation}", f"{row.coverage:.3f}",
         format_number(row.rms_px), format_number(row.reference_rms_px), format_number(row.max_px),
         format_number(row.reference_max_px), "yes" if is_within_tolerance(row) else "no"]
        for row in results.polygon_rows
    ]  # fmt: skip
    if not any(row.reference_rms_px for row in results.polygon_rows):
        rows = [row[:3] + row[4:5] for row in rows]
        return "## Polygons: displacement at 360 px\n\n" + markdown_table(
            ("polygons", "covered", "rms px", "largest px"), rows
        )
    head = ("polygons", "covered", "rms px", "reference", "largest px", "reference", "agrees")
    return f"""\
## Polygons: displacement at 360 px, the paper's size

{markdown_table(head, rows)}

{wrap_paragraph(_describe_agreement(results.polygon_rows))}

`polygons.png`, `detail.png`: the paper's Figures 8 and 9."""


def _describe_agreement(rows: Sequence[PolygonRow]) -> str:
    """Return how many rows agree with the reference, and why others may not."""
    others = [
        f"{row.sectors} x {row.rings} {row.interpolation}"
        for row in rows
        if not is_within_tolerance(row)
    ]
    exceptions = (
        f"Not so {', '.join(others)}: such large polygons reach far beyond the plane of any one "
        "face, and what is shown there is that choice."
    )
    return (
        f"{len(rows) - len(others)} of {len(rows)} agree with the reference, a table computed "
        "apart from this program in float64 and confirmed by OpenGL in float32: to 3 % in rms and "
        "5 % in the largest for positions, to 15 % for UV, where a mesh's maker is free to choose "
        f"faces and diagonals. {exceptions if others else ''} Four times the polygons, a quarter "
        "of the error."
    )
