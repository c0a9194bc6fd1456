"""COST.md: the report of accuracy against cost, made of cost.json alone.

The front comes first and answers which level to choose. The section on the paper's Figure 10 says
whether the frame rate depends on the polygons, and why; that on localization, which level suffices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from catoptra_studies.accuracy_cost.cost_results import (
    MIN_GAIN,
    CostResults,
    LevelCost,
    LocalizationAccuracy,
    PolygonRow,
    StudyConditions,
)
from catoptra_studies.camera_figures.frame_rates import (
    NO_CAMERA,
    SCANNER,
    FrameRate,
    frame_time_spread,
    group_conditions,
)
from catoptra_studies.reports import format_number, markdown_table, wrap_paragraph

_GLOSSARY = """\
| column | meaning |
|---|---|
| ms | median time of a frame with read-back, all levels rendered in turn |
| processor ms | the same of all processors together; for comparison where the machine was shared |
| bound px | limit of displacement: nothing is shown farther off (`frames/plan/error_bound.py`) |
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
    # The front answers which level to choose, all later sections explain why.
    parts = [
        _format_header(results.conditions),
        _format_pareto_front(results),
        _format_levels(results),
        _format_polygons(results),
        _format_frame_rates(results),
        _format_localization(results),
    ]
    return "\n\n".join(part.strip() for part in parts if part) + "\n"


# Medians over the drives of a drive's mean position error.
_FILTER_COLUMNS = ("paper's filter, mean error", "consistent filter, mean error")


def format_summary_table(results: CostResults) -> str:
    """Table of the key levels for the README, with localization where robots were driven."""
    localization = results.localization
    rows_by_level = {row.level: row for row in localization.rows} if localization else {}
    header = ["level", "ms", "bound px", "RMSE", "SSIM"]
    header += ["beacons found", "bearing", *_FILTER_COLUMNS] if rows_by_level else []
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
                f"{localized.ekf_mean_m:.3f} m",
                f"{localized.consistent_ekf_mean_m:.3f} m",
            ]
        # A key level without drives, as after a run that was interrupted.
        elif rows_by_level:
            row += ["-", "-", "-", "-"]
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
    columns = ("level", "ms", "bound px", "RMSE", "PSNR dB", "SSIM")
    rows = [
        [*_level_cells(level, columns), _compare_levels(before, level)]
        # Each level against the next faster one of the front; the first has no such level.
        for before, level in zip([None, *front[:-1]], front, strict=True)
    ]
    meshes = [level.name for level in front if level.num_polygons]
    # The paper's question, decided by the data: whether a mesh is ever worth the time.
    conclusion = (
        f"Mirror meshes on it: {', '.join(meshes)}."
        if meshes
        else "No mirror mesh is on it: an exact mirror is always both faster and better."
    )
    return f"""\
## The Pareto front of time and image error

A slower level is listed only if it takes at least {MIN_GAIN:.0%} off the RMSE before it.

{markdown_table((*columns, "against the row above"), rows)}

{wrap_paragraph(conclusion)}

`pareto.png`, `levels.png`."""


def _compare_levels(before: LevelCost | None, level: LevelCost) -> str:
    if before is None:
        return ""
    time, error = level.wall_ms / before.wall_ms - 1.0, level.rmse / before.rmse - 1.0
    return f"{time:+.0%} time, {error:+.0%} RMSE"


# Cells of a level by the heads of the columns.
_LEVEL_CELLS: Mapping[str, Callable[[LevelCost], str]] = {
    "level": lambda level: level.name,
    "ms": lambda level: f"{level.wall_ms:.1f}",
    "processor ms": lambda level: f"{level.cpu_ms:.1f}",
    "stages, ms": lambda level: ", ".join(f"{key} {ms:.1f}" for key, ms in level.stage_ms.items()),
    "bound px": lambda level: format_number(level.bound_max_px),
    "rms px": lambda level: format_number(level.bound_rms_px),
    "RMSE": lambda level: format_number(level.rmse, 2),
    "PSNR dB": lambda level: f"{level.psnr_db:.1f}",
    "SSIM": lambda level: f"{level.ssim:.4f}",
}


def _level_cells(level: LevelCost, columns: Iterable[str]) -> list[str]:
    return [_LEVEL_CELLS[column](level) for column in columns]


def _format_levels(results: CostResults) -> str:
    rows = [_level_cells(level, _LEVEL_CELLS) for level in _sort_by_error(results.levels)]
    return f"## Every level, best image first\n\n{markdown_table([*_LEVEL_CELLS], rows)}"


def _sort_by_error(levels: Iterable[LevelCost]) -> list[LevelCost]:
    # Not by time, which changes from run to run: a stable order keeps two reports comparable.
    return sorted(levels, key=lambda level: level.rmse)


def _format_polygons(results: CostResults) -> str:
    header = ["polygons", "covered", "rms px", "reference", "largest px", "reference", "agrees"]
    rows = [
        [
            f"{row.num_polygons} = {row.sectors} x {row.rings}, {row.interpolation}",
            f"{row.coverage:.3f}",
            format_number(row.rms_px),
            format_number(row.reference_rms_px),
            format_number(row.max_px),
            format_number(row.reference_max_px),
            "yes" if row.agrees_with_reference else "no",
        ]
        for row in results.polygon_rows
    ]
    if not any(row.reference_rms_px for row in results.polygon_rows):
        # Another mirror than the paper's, for which there is no independent table.
        for cells in (header, *rows):
            del cells[5:], cells[3]
        return f"## Mirror meshes: displacement at 360 px\n\n{markdown_table(header, rows)}"
    return f"""\
## Mirror meshes: displacement at 360 px, the paper's size

{markdown_table(header, rows)}

{wrap_paragraph(_describe_agreement(results.polygon_rows))}

`polygons.png`, `detail.png`: the paper's Figures 8 and 9."""


def _describe_agreement(rows: Sequence[PolygonRow]) -> str:
    """Sentences about the rows that agree with the table, and the reason why others may not."""
    # All that disagree are named, so that a new disagreement shows in the diff of the report.
    others = [
        f"{row.sectors} x {row.rings} {row.interpolation}"
        for row in rows
        if not row.agrees_with_reference
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


# The paper concludes from bars of equal height that the frame rate does not depend on the
# polygons; the bars can be read to about a tenth.
_MAX_SPREAD = 0.10


def _format_frame_rates(results: CostResults) -> str:
    """The section as Markdown; empty where no frame rate was measured."""
    if not results.frame_rates:
        return ""
    columns = _columns(results)
    # dict.fromkeys keeps the order of measuring, from no camera to the scanner.
    payloads = list(dict.fromkeys(row.payload for row in results.frame_rates))
    by_cell = {(row.world, row.renderer, row.payload): row for row in results.frame_rates}
    rows = [
        [payload, *(_format_frame_rate(by_cell.get((*column, payload))) for column in columns)]
        for payload in payloads
    ]
    header = ("robot with", *(f"{world}, {renderer}" for world, renderer in columns))
    loads = "; ".join(
        f"{stated} ({names})"
        for stated, names in group_conditions(
            (row.conditions, f"{row.world} {row.renderer}") for row in results.frame_rates
        ).items()
    )
    loads = f"Measured on {loads}. Elapsed and processor time:"
    sentences = (*_conclusions(results), *_explanations(results))
    bullets = "\n".join(wrap_paragraph(sentence, bullet="* ") for sentence in sentences)
    return f"""\
## The paper's Figure 10: frames a second

A frame consists of a perspective view of 640 x 480 px, as on USARSim's screen, and of the robot's
payload. Mirror meshes by their polygons, with one sample a pixel as in the paper. Its second map is
not available: corridors-and-rooms was written in its place.

{wrap_paragraph(loads)}

{markdown_table(header, rows)}

{bullets}

`frame_rates.png`."""


def _columns(results: CostResults) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row.world, row.renderer) for row in results.frame_rates))


def _format_frame_rate(row: FrameRate | None) -> str:
    return f"{row.fps:.0f} ({row.wall_ms:.1f}, {row.cpu_ms:.1f} ms)" if row else "-"


def _conclusions(results: CostResults) -> Iterator[str]:
    """Yield the dependence on polygons in each column, and the cost of camera and scanner."""
    for column in _columns(results):
        rows = tuple(row for row in results.frame_rates if (row.world, row.renderer) == column)
        paper_rows = tuple(row for row in rows if row.num_polygons <= 1024)
        spread_paper = frame_time_spread(paper_rows, min_polygons=16)
        spread_all = frame_time_spread(rows, min_polygons=16)
        # Fewer polygons leave part of the mirror's disc black, which saves time for another reason.
        spread_covered = frame_time_spread(rows, min_polygons=256)
        by_payload = {row.payload: row for row in rows}
        # 1024 polygons are the finest mesh of the paper's Figure 10.
        empty_ms, camera_ms, scanner_ms = (
            by_payload[payload].cpu_ms for payload in (NO_CAMERA, "1024", SCANNER)
        )
        yield (
            f"{' '.join(column)}: over the paper's 16 to 1024 polygons the processor time of a "
            f"frame differs by {spread_paper:.0%}, up to 4096 by {spread_all:.0%}; from 256 to "
            f"4096, where the mesh fills the mirror, by {spread_covered:.0%}: "
            f"{_conclusion(spread_all, spread_covered)}. The camera with 1024 polygons takes "
            f"{camera_ms - empty_ms:.1f} ms of it, "
            f"the scanner {max(scanner_ms - empty_ms, 0.0):.1f}."
        )


def _conclusion(spread_all: float, spread_covered: float) -> str:
    if spread_all <= _MAX_SPREAD:
        return f"**it does not depend, within {_MAX_SPREAD:.0%}, as the paper found**"
    if spread_covered <= _MAX_SPREAD:
        return f"**within {_MAX_SPREAD:.0%}, but for the part of the mirror that is left empty**"
    return f"**it depends by more than {_MAX_SPREAD:.0%}**"


def _explanations(results: CostResults) -> Iterator[str]:
    """Yield the share of each stage, from the sweep's own meshes."""
    meshes = [level for level in results.levels if level.num_polygons and level.is_key]
    # Without OpenGL there are no stages of raster to explain.
    if meshes:
        yield _explain_faces(meshes)
        yield _explain_mirror(meshes)
        yield from _explain_per_pixel(results, meshes[-1])
    yield (
        "The paper's scanner cost a frame as much as its camera; here its 181 beams are one call, "
        "and cost next to nothing."
    )


def _explain_faces(meshes: list[LevelCost]) -> str:
    faces_ms = [level.stage_ms["faces"] for level in meshes]
    return (
        "Why it does not depend: the faces of the cube, which show the scene, are independent of "
        f"the mirror's polygons ({min(faces_ms):.1f} to {max(faces_ms):.1f} ms at every count of "
        "the levels above), and the same pixels of the mirror are looked up, however many polygons "
        "they belong to. The direction of a sample through its polygon never changes, so both "
        "renderers compute it once, before the first frame: trace as a ray, raster as coordinates "
        "in the atlas (`tests/measurements/polygon_counts.py`)."
    )


def _explain_mirror(meshes: list[LevelCost]) -> str:
    samples = meshes[0].samples
    times = ", ".join(f"{level.num_polygons}: {level.stage_ms['mirror']:.1f}" for level in meshes)
    return (
        "What is left: 16 polygons leave 37 % of the mirror empty, 64 leave 10 %. The mirror "
        f"itself takes, at {samples} x {samples} samples, ({times}) ms by polygons."
    )


def _explain_per_pixel(results: CostResults, finest: LevelCost) -> Iterator[str]:
    """Yield the exact model against the finest mesh at as many samples."""
    for level in results.levels:
        is_like = level.renderer == finest.renderer and level.samples == finest.samples
        if level.is_key and is_like and not level.num_polygons:
            yield (
                "The camera model in every pixel needs no mesh: "
                f"{level.stage_ms['mirror']:.1f} ms for the mirror and {level.wall_ms:.1f} ms a "
                f"frame, where {finest.num_polygons} polygons take "
                f"{finest.stage_ms['mirror']:.1f} and {finest.wall_ms:.1f} ms, and are not exact."
            )


def _format_localization(results: CostResults) -> str:
    """The section as Markdown; empty where no robot was driven."""
    localization = results.localization
    if localization is None:
        return ""
    # Times come from the levels: the drives run in real processes and measure no times.
    times_ms = {level.name: level.wall_ms for level in results.levels}
    rows = [
        [
            row.level,
            f"{times_ms[row.level]:.1f}" if row.level in times_ms else "-",
            f"{row.near_detection_rate:.0%}",
            f"{row.detection_rate:.0%}",
            f"{row.bearing_rms_deg:.2f}",
            f"{row.range_rms_m:.3f}",
            f"{row.ekf_mean_m:.3f}",
            f"{row.ekf_max_m:.2f}",
            f"{row.consistent_ekf_mean_m:.3f}",
            f"{row.consistent_ekf_max_m:.2f}",
        ]
        for row in localization.rows
    ]
    header = (
        *("level", "ms", "found to 1.5 m", "to 2.5 m", "bearing deg", "range m"),
        *("filter mean m", "max m", "consistent mean m", "max m"),
    )
    return f"""\
## Landmarks and localization

{markdown_table(header, rows)}

{wrap_paragraph(_describe_conditions(localization))}

{wrap_paragraph(_describe_sufficient_level(localization))}

`localization.png`."""


def _describe_conditions(localization: LocalizationAccuracy) -> str:
    return (
        "The key levels only, each through a server process of its own: "
        f"{localization.num_runs} runs of {localization.steps_per_run} steps round the field, the "
        "same seeds for all, frames over TCP, one colour classifier trained on frames of the best "
        "level. Found: the fraction of beacons within reach that were measured. Bearing and "
        "range: rms over all measurements. Filter: the position error of the paper's (P0 = 0) and "
        "of a consistent one, whose covariances match the real errors of start and "
        "measurements, medians over the runs of a run's mean and largest. Odometry alone: up to "
        f"{localization.odometry_max_m:.2f} m."
    )


def _describe_sufficient_level(localization: LocalizationAccuracy) -> str:
    """Sentence about the coarsest level that localizes as well as the best, to a centimetre."""
    # The consistent filter decides: R is nearer the real errors of the measurements.
    best_m = min(row.consistent_ekf_mean_m for row in localization.rows)
    sufficient = next(
        row for row in localization.rows if row.consistent_ekf_mean_m <= best_m + 0.01
    )
    return (
        f"To localize within a centimetre of the best, {sufficient.level} is enough: the filter "
        f"averages over bearings that are {sufficient.bearing_rms_deg:.2g} deg off."
    )
