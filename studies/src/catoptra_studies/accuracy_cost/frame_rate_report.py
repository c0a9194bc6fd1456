"""The report's part on Figure 10: does the frame rate depend on the polygons, and why (not)."""

from __future__ import annotations

from collections.abc import Iterator

from catoptra_studies.accuracy_cost.cost_results import CostResults, FrameRate, LevelCost
from catoptra_studies.accuracy_cost.frame_rates import NO_CAMERA, SCANNER, frame_time_spread
from catoptra_studies.reports.markdown import markdown_table, wrap_bullet

# "Does not depend": the paper shows bars of equal height, read to about this share.
MAX_SPREAD = 0.10


def format_frame_rates(results: CostResults) -> str:
    """Return the table and what follows from it; nothing if it was not measured."""
    if not results.frame_rates:
        return ""
    columns = _columns(results)
    loads = list(dict.fromkeys(row.payload for row in results.frame_rates))
    found = {(row.world, row.renderer, row.payload): row for row in results.frame_rates}
    rows = [
        [load, *(_format_frame_rate(found.get((*column, load))) for column in columns)]
        for load in loads
    ]
    head = ("a robot with", *(f"{world}, {renderer}" for world, renderer in columns))
    told = "\n".join(
        wrap_bullet(line) for line in (*_conclusions(results), *_explanations(results))
    )
    return f"""\
## The paper's Figure 10: frames a second

A frame of the whole: an ordinary view of 640 x 480 px, as USARSim's screen showed, and what the
robot carries. Mirrors by their polygons, one sample a pixel as the paper had.

{markdown_table(head, rows)}

{told}

`frame_rates.png`."""


def _columns(results: CostResults) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row.world, row.renderer) for row in results.frame_rates))


def _format_frame_rate(row: FrameRate | None) -> str:
    return f"{row.fps:.0f} ({row.wall_ms:.1f} ms)" if row else "-"


def _conclusions(results: CostResults) -> Iterator[str]:
    """Yield what each column says of the polygons and of the scanner."""
    for column in _columns(results):
        rows = tuple(row for row in results.frame_rates if (row.world, row.renderer) == column)
        paper = frame_time_spread(tuple(r for r in rows if r.num_polygons <= 1024), min_polygons=16)
        every = frame_time_spread(rows, min_polygons=16)
        whole = frame_time_spread(rows, min_polygons=256)
        by_load = {row.payload: row for row in rows}
        alone, camera, scanner = (by_load[name].wall_ms for name in (NO_CAMERA, "1024", SCANNER))
        yield (
            f"{' '.join(column)}: over the paper's 16 to 1024 polygons a frame's processor time "
            f"differs by {paper:.0%}, up to 4096 by {every:.0%}; from 256 to 4096, where the mesh "
            f"fills the mirror, by {whole:.0%}: {_conclusion(every, whole)}. The camera with 1024 "
            f"polygons takes {camera - alone:.1f} ms, the scanner {max(scanner - alone, 0.0):.1f}."
        )


def _conclusion(spread_all: float, spread_covered: float) -> str:
    if spread_all <= MAX_SPREAD:
        return f"**it does not depend, within {MAX_SPREAD:.0%}, as the paper found**"
    if spread_covered <= MAX_SPREAD:
        return f"**within {MAX_SPREAD:.0%}, but for the part of the mirror that is left empty**"
    return f"**it depends by more than {MAX_SPREAD:.0%}**"


def _explanations(results: CostResults) -> Iterator[str]:
    """Yield where the time goes, of the ladder's own meshes."""
    meshes = [step for step in results.levels if step.num_polygons and step.is_key]
    if meshes:
        yield _explain_faces(meshes)
        yield _explain_mirror(meshes)
        yield from _explain_per_pixel(results, meshes[-1])
    yield (
        "The paper's scanner cost a frame as much as its camera; here its 181 beams are one call "
        "to Embree, and cost next to nothing."
    )


def _explain_faces(meshes: list[LevelCost]) -> str:
    faces = [step.stage_ms["faces"] for step in meshes]
    return (
        "Why it does not depend: the faces of the cube, which show the scene, know nothing of the "
        f"mirror's polygons ({min(faces):.1f} to {max(faces):.1f} ms at every count of the ladder "
        "above), and the same pixels of the mirror are looked up, however many polygons they "
        "belong to. What a sample sees through its polygon never changes, so both renderers find "
        "it out once, before the first frame: trace its ray, raster its place in the atlas "
        "(`tests/measurements/polygon_counts.py`)."
    )


def _explain_mirror(meshes: list[LevelCost]) -> str:
    samples = meshes[0].samples
    told = ", ".join(f"{step.num_polygons}: {step.stage_ms['mirror']:.1f}" for step in meshes)
    return (
        "What is left: 16 polygons leave 37 % of the mirror empty, 64 leave 10 %. The mirror "
        f"itself takes, at {samples} x {samples} samples, ({told}) ms by polygons."
    )


def _explain_per_pixel(results: CostResults, finest: LevelCost) -> Iterator[str]:
    """Yield how the exact law compares with the finest mesh at as many samples."""
    for step in results.levels:
        is_like = step.renderer == finest.renderer and step.samples == finest.samples
        if step.is_key and is_like and not step.num_polygons:
            yield (
                f"The exact law in every pixel needs no mesh: {step.stage_ms['mirror']:.1f} ms for "
                f"the mirror and {step.wall_ms:.1f} ms a frame, where {finest.num_polygons} polygons take "
                f"{finest.stage_ms['mirror']:.1f} and {finest.wall_ms:.1f} ms, and are not exact."
            )
