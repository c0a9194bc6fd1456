"""The report's section on Figure 10: whether the frame rate depends on the polygons, and why."""

from __future__ import annotations

from collections.abc import Iterator

from catoptra_studies.accuracy_cost.cost_results import CostResults, LevelCost
from catoptra_studies.camera_figures.frame_rates import (
    NO_CAMERA,
    SCANNER,
    FrameRate,
    frame_time_spread,
)
from catoptra_studies.reports import markdown_table, wrap_bullet

# The paper concludes from bars of equal height that the frame rate does not depend on the
# polygons; its bars can be read to about a tenth.
MAX_SPREAD = 0.10


def format_frame_rates(results: CostResults) -> str:
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
    bullets = "\n".join(
        wrap_bullet(line) for line in (*_conclusions(results), *_explanations(results))
    )
    return f"""\
## The paper's Figure 10: frames a second

A frame consists of a perspective view of 640 x 480 px, as on USARSim's screen, and of the robot's
payload. Mirror meshes by their polygons, with one sample a pixel as in the paper.

{markdown_table(header, rows)}

{bullets}

`frame_rates.png`."""


def _columns(results: CostResults) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row.world, row.renderer) for row in results.frame_rates))


def _format_frame_rate(row: FrameRate | None) -> str:
    return f"{row.fps:.0f} ({row.wall_ms:.1f} ms)" if row else "-"


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
            by_payload[payload].wall_ms for payload in (NO_CAMERA, "1024", SCANNER)
        )
        yield (
            f"{' '.join(column)}: over the paper's 16 to 1024 polygons the processor time of a "
            f"frame differs by {spread_paper:.0%}, up to 4096 by {spread_all:.0%}; from 256 to "
            f"4096, where the mesh fills the mirror, by {spread_covered:.0%}: "
            f"{_conclusion(spread_all, spread_covered)}. The camera with 1024 polygons takes "
            f"{camera_ms - empty_ms:.1f} ms, the scanner {max(scanner_ms - empty_ms, 0.0):.1f}."
        )


def _conclusion(spread_all: float, spread_covered: float) -> str:
    if spread_all <= MAX_SPREAD:
        return f"**it does not depend, within {MAX_SPREAD:.0%}, as the paper found**"
    if spread_covered <= MAX_SPREAD:
        return f"**within {MAX_SPREAD:.0%}, but for the part of the mirror that is left empty**"
    return f"**it depends by more than {MAX_SPREAD:.0%}**"


def _explanations(results: CostResults) -> Iterator[str]:
    """Yield the share of each stage, from the sweep's own meshes."""
    meshes = [level for level in results.levels if level.num_polygons and level.is_key]
    # Without OpenGL there are no stages of raster to explain.
    if meshes:
        yield _explain_faces(meshes)
        yield _explain_mirror(meshes)
        yield from _explain_per_pixel(results, meshes[-1])
    yield (
        "The paper's scanner cost a frame as much as its camera; here its 181 beams are one call "
        "to Embree, and cost next to nothing."
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
    """Yield the exact model beside the finest mesh at as many samples."""
    for level in results.levels:
        is_like = level.renderer == finest.renderer and level.samples == finest.samples
        if level.is_key and is_like and not level.num_polygons:
            yield (
                "The camera model in every pixel needs no mesh: "
                f"{level.stage_ms['mirror']:.1f} ms for the mirror and {level.wall_ms:.1f} ms a "
                f"frame, where {finest.num_polygons} polygons take "
                f"{finest.stage_ms['mirror']:.1f} and {finest.wall_ms:.1f} ms, and are not exact."
            )
