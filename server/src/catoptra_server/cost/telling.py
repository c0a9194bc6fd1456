"""The pictures of the study: those of its numbers alone, and those that need frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from catoptra_server.cost.document import CostResults
from catoptra_server.cost.ladder import POLYGON_COUNTS
from catoptra_server.cost.pictures import detail, frame_rates, landmarks, pareto, polygons, steps
from catoptra_server.cost.step_costs import MeasuredLevel
from catoptra_server.cost.subject import StudySubject, resize_camera
from catoptra_server.figures import style
from catoptra_server.figures.subject import PAPER_SIZE_PX
from catoptra_server.render.renderer import Image
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count

# Of the exact detail beside the meshes' 2 x 2: smooth to the eye.
_EXACT_SAMPLES = 4


def write_result_plots(results: CostResults, folder: Path) -> None:
    """Write pareto.png, and frame_rates.png and landmarks.png where these were measured."""
    with style.open_page(pareto.WIDTH_PX, pareto.HEIGHT_PX) as page:
        pareto.draw(page, results.levels)
        style.save_page(page, folder / "pareto.png")
    if results.frame_rates:
        with style.open_page(frame_rates.WIDTH_PX, frame_rates.HEIGHT_PX) as page:
            frame_rates.draw(page, results.frame_rates)
            style.save_page(page, folder / "frame_rates.png")
    if results.localization:
        with style.open_page(landmarks.WIDTH_PX, landmarks.HEIGHT_PX) as page:
            landmarks.draw(page, results)
            style.save_page(page, folder / "landmarks.png")


def write_frame_plots(subject: StudySubject, levels: Sequence[MeasuredLevel], reference: Image, folder: Path) -> None:
    """Write steps.png, polygons.png and detail.png."""
    with style.open_page(steps.WIDTH_PX, steps.HEIGHT_PX) as page:
        steps.draw(page, levels, reference, subject.camera.horizon_radius_px)
        style.save_page(page, folder / "steps.png")
    camera = resize_camera(subject.camera, PAPER_SIZE_PX)
    paper_size = dataclasses.replace(subject, camera=camera, camera_states=subject.camera_states[:1])
    frames = {count: polygons.render_polygon_frame(paper_size, tessellation_from_polygon_count(count)) for count in POLYGON_COUNTS}
    with style.open_page(polygons.WIDTH_PX, polygons.HEIGHT_PX) as page:
        polygons.draw(page, camera, frames)
        style.save_page(page, folder / "polygons.png")
    with style.open_page(detail.WIDTH_PX, detail.HEIGHT_PX) as page:
        (exact,) = paper_size.render_reference(_EXACT_SAMPLES)
        detail.draw(page, frames, exact, max_radius_px=camera.horizon_radius_px)
        style.save_page(page, folder / "detail.png")
