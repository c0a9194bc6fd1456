"""The pictures of the study: those of its numbers alone, and those that need frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from catoptra_server.cost.document import Document
from catoptra_server.cost.ladder import COUNTS
from catoptra_server.cost.pictures import detail, frame_rates, landmarks, pareto, polygons, steps
from catoptra_server.cost.step_costs import Drawn
from catoptra_server.cost.subject import Subject, camera_of_size
from catoptra_server.figures import style
from catoptra_server.figures.subject import PAPER_SIZE_PX
from catoptra_server.render.renderer import Image
from catoptra_server.scene.mirror_mesh import split_for

# Of the exact detail beside the meshes' 2 x 2: smooth to the eye.
_EXACT_SAMPLES = 4


def draw_numbers(document: Document, folder: Path) -> None:
    """Write pareto.png, and frame_rates.png and landmarks.png where these were measured."""
    with style.page(pareto.WIDTH_PX, pareto.HEIGHT_PX) as page:
        pareto.draw(page, document.steps)
        style.save(page, folder / "pareto.png")
    if document.frame_rates:
        with style.page(frame_rates.WIDTH_PX, frame_rates.HEIGHT_PX) as page:
            frame_rates.draw(page, document.frame_rates)
            style.save(page, folder / "frame_rates.png")
    if document.landmarks:
        with style.page(landmarks.WIDTH_PX, landmarks.HEIGHT_PX) as page:
            landmarks.draw(page, document)
            style.save(page, folder / "landmarks.png")


def draw_frames(subject: Subject, drawn: Sequence[Drawn], reference: Image, folder: Path) -> None:
    """Write steps.png, polygons.png and detail.png."""
    with style.page(steps.WIDTH_PX, steps.HEIGHT_PX) as page:
        steps.draw(page, drawn, reference, subject.camera.horizon_radius_px)
        style.save(page, folder / "steps.png")
    camera = camera_of_size(subject.camera, PAPER_SIZE_PX)
    paper_size = dataclasses.replace(subject, camera=camera, exposures=subject.exposures[:1])
    frames = {count: polygons.frame(paper_size, split_for(count)) for count in COUNTS}
    with style.page(polygons.WIDTH_PX, polygons.HEIGHT_PX) as page:
        polygons.draw(page, camera, frames)
        style.save(page, folder / "polygons.png")
    with style.page(detail.WIDTH_PX, detail.HEIGHT_PX) as page:
        (exact,) = paper_size.reference(_EXACT_SAMPLES)
        detail.draw(page, frames, exact, within_px=camera.horizon_radius_px)
        style.save(page, folder / "detail.png")
