"""COST.md: the report of accuracy against cost, made of cost.json alone."""

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
from catoptra_studies.accuracy_cost.pareto import MIN_GAIN
from catoptra_studies.accuracy_cost.polygon_table import is_within_tolerance
from catoptra_studies.reports import format_number, markdown_table, wrap_paragraph

_GLOSSARY = """\
| column | meaning |
|---|---|
| ms | median time of a frame with read-back, all levels rendered in turn |
| processor ms | the same of all processors together; for comparison where the machine was shared |
| bound px | limit of the displacement: nothing is shown farther off (`planning/error_bound.py`) |
| rms px | the same over the image, root mean square |
| RMSE, PSNR, SSIM | of greys, against {samples} x {samples} exact rays a pixel, at {poses} poses |
"""
_LEVEL_NAME_NOTE = """
The name of a level gives the renderer, the surface, and the samples along both sides of a pixel.
Faces have a texel a pixel by default; `x 0.5` and `x 2` scale the plan's size. `uv` and `position`
name the quantity interpolated over a polygon. The lines of a robot file that select a level are in
`out/cost/cost.json`, plots of all this in `out/cost`.
"""


def format_cost_report(results: CostResults) -> str:
    """The whole report as Markdown."""
    # The front first: it answers which level to choose, all later sections explain why.
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
    """Table of the key levels for the README, with localization where robots were driven."""
    localization = results.localization
    rows_by_level = {row.level: row for row in localization.rows} if localization else {}
    header = ["level", "ms", "bound px", "RMSE", "SSIM"]
    header += ["beacons found", "bearing", "filter's error"] if rows_by_level else []
    rows = []
    for level in _sort_by_error(level for level in results.levels if level.is_key):
        row = [
            level.name,
            f"{level.wall_ms:.1f}",
            format_number(level.bound_max_px, 2),
            format_number(level.rmse, 2),
            f"{level.ssim:.3f}",
        ]
        if localized := rows_by_level.get(level.name):
            row += [
                f"{localized.detection_rate:.0%}",
                f"{localized.bearing_rms_deg:.2g}°",
                f"{localized.consistent_ekf_mean_m:.3f} m",
            ]
        # A key level without drives, as after a run that was interrupted.
        elif rows_by_level:
            row += ["-", "-", "-"]
        rows.append(row)
    return markdown_table(header, rows)


def _format_header(conditions: StudyConditions) -> str:
    # Said first, since a reader may compare a quick run with the committed report.
    quick = "It was a quick run: expect more noise." if conditions.is_quick else ""
    size = f"{conditions.size_px} x {conditions.size_px} px"
    machine = wrap_paragraph(
        f"Written by `make cost` on {conditions.date}; do not edit. Measured on "
        f"{conditions.machine}: compare rows with each other, not with another machine's. {quick}"
    )
    subject = wrap_paragraph(
        f"{conditions.robot} in {conditions.world}, {size}, {conditions.num_rounds} frames of each "
        f"level. Renderers: {'; '.join(conditions.renderers)}."
    )
    glossary = _GLOSSARY.format(samples=conditions.reference_samples, poses=conditions.num_poses)
    note = wrap_paragraph(_LEVEL_NAME_NOTE)
    return f"# What accuracy costs in time\n\n{machine}\n\n{subject}\n\n{glossary}\n{note}"


def _format_pareto_front(results: CostResults) -> str:
    front = sorted(
        (level for level in results.levels if level.is_on_pareto_front),
        key=lambda level: level.wall_ms,
    )
    rows = [
        [
            level.name,
            f"{level.wall_ms:.1f}",
            format_number(level.bound_max_px),
            format_number(level.rmse, 2),
            f"{level.psnr_db:.1f}",
            f"{level.ssim:.4f}",
            _compare_levels(before, level),
        ]
        # Each level beside the next faster one of the front; the first has none.
        for before, level in zip([None, *front[:-1]], front, strict=True)
    ]
    header = ("level", "ms", "bound px", "RMSE", "PSNR dB", "SSIM", "against the row above")
    meshes = [level.name for level in front if level.num_polygons]
    # The paper's question, decided by the data: whether a mesh is ever worth its time.
    conclusion = (
        f"Mirror meshes on it: {', '.join(meshes)}."
        if meshes
        else "No mirror mesh is on it: an exact mirror is always both faster and better."
    )
    return f"""\
## The Pareto front of time and image error

A slower level is listed only if it takes at least {MIN_GAIN:.0%} off the RMSE before it.

{markdown_table(header, rows)}

{wrap_paragraph(conclusion)}

`pareto.png`, `levels.png`."""


def _compare_levels(before: LevelCost | None, level: LevelCost) -> str:
    if before is None:
        return ""
    time, error = level.wall_ms / before.wall_ms - 1.0, level.rmse / before.rmse - 1.0
    return f"{time:+.0%} time, {error:+.0%} RMSE"


def _format_levels(results: CostResults) -> str:
    rows = [
        [
            level.name,
            f"{level.wall_ms:.1f}",
            f"{level.cpu_ms:.1f}",
            _format_stages(level),
            format_number(level.bound_max_px),
            format_number(level.bound_rms_px),
            format_number(level.rmse, 2),
            f"{level.psnr_db:.1f}",
            f"{level.ssim:.4f}",
        ]
        for level in _sort_by_error(results.levels)
    ]
    header = (
        *("level", "ms", "processor ms", "stages, ms"),
        *("bound px", "rms px", "RMSE", "PSNR dB", "SSIM"),
    )
    return f"## Every level, best image first\n\n{markdown_table(header, rows)}"


def _sort_by_error(levels: Iterable[LevelCost]) -> list[LevelCost]:
    # Not by time, which changes from run to run: a stable order keeps two reports comparable.
    return sorted(levels, key=lambda level: level.rmse)


def _format_stages(level: LevelCost) -> str:
    return ", ".join(f"{name} {ms:.1f}" for name, ms in level.stage_ms.items())


def _format_polygons(results: CostResults) -> str:
    has_reference = any(row.reference_rms_px for row in results.polygon_rows)
    if not has_reference:
        # Another mirror than the paper's, for which there is no independent table.
        rows = [_polygon_cells(row) + _displacement_cells(row) for row in results.polygon_rows]
        return "## Mirror meshes: displacement at 360 px\n\n" + markdown_table(
            ("polygons", "covered", "rms px", "largest px"), rows
        )
    rows = [
        [
            *_polygon_cells(row),
            format_number(row.rms_px),
            format_number(row.reference_rms_px),
            format_number(row.max_px),
            format_number(row.reference_max_px),
            "yes" if is_within_tolerance(row) else "no",
        ]
        for row in results.polygon_rows
    ]
    header = ("polygons", "covered", "rms px", "reference", "largest px", "reference", "agrees")
    return f"""\
## Mirror meshes: displacement at 360 px, the paper's size

{markdown_table(header, rows)}

{wrap_paragraph(_describe_agreement(results.polygon_rows))}

`polygons.png`, `detail.png`: the paper's Figures 8 and 9."""


def _polygon_cells(row: PolygonRow) -> list[str]:
    name = f"{row.num_polygons} = {row.sectors} x {row.rings}, {row.interpolation}"
    return [name, f"{row.coverage:.3f}"]


def _displacement_cells(row: PolygonRow) -> list[str]:
    return [format_number(row.rms_px), format_number(row.max_px)]


def _describe_agreement(rows: Sequence[PolygonRow]) -> str:
    """Sentences about the rows that agree with the table, and the reason why others may not."""
    # All that disagree are named, so that a new disagreement shows in the diff of the report.
    others = [
        f"{row.sectors} x {row.rings} {row.interpolation}"
        for row in rows
        if not is_within_tolerance(row)
    ]
    exceptions = (
        f"Not so {', '.join(others)}: polygons that large reach far beyond the plane of any one "
        "face, and the image depends on that choice."
    )
    return (
        f"{len(rows) - len(others)} of {len(rows)} agree with the reference, a table computed "
        "independently of this program in float64 and confirmed by OpenGL in float32: to 3 % in "
        "rms and 5 % in the largest for positions, to 15 % for UV, where the maker of a mesh is "
        f"free to choose faces and diagonals. {exceptions if others else ''} Four times the "
        "polygons, a quarter of the error."
    )
