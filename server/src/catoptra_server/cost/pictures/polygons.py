"""The paper's Figure 8 with error maps: the frame through four meshes, and how far each is off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from catoptra_protocol.optics.camera import OmniCamera, pixel_centres
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.cost.error_map import error_colours
from catoptra_server.cost.ladder import Step
from catoptra_server.cost.pictures.legend import draw_scale
from catoptra_server.cost.subject import Subject
from catoptra_server.figures import style
from catoptra_server.figures.polygon_measure import displacement_px
from catoptra_server.figures.subject import PAPER_SIZE_PX
from catoptra_server.plan.render_plan import RendererKind, RenderWish
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace.polygon_rays import polygon_directions
from catoptra_server.scene.mirror_mesh import PolygonSplit, split_for

COUNTS = (16, 64, 256, 1024)
WIDTH_PX, HEIGHT_PX = 1520, 910
_TOP_PX = 56
SCALE_PX = (0.1, 100.0)


def draw(page: style.Page, camera: OmniCamera, frames: Mapping[int, Image]) -> None:
    """Draw frames, by polygons, above displacement maps, all of the paper's size."""
    for index, count in enumerate(COUNTS):
        left = 10 + index * (PAPER_SIZE_PX + 20)
        error = displacement(camera, split_for(count))
        rms = float(np.sqrt(np.nanmean(np.square(error))))
        style.words(page, left, _TOP_PX - 10, f"{count} polygons", va="bottom", fontweight="bold")
        style.words(page, left + PAPER_SIZE_PX, _TOP_PX - 10, f"{rms:.3g} px rms", ha="right",
                    va="bottom", fontsize=7, color=style.QUIET)  # fmt: skip
        style.picture(page, frames[count], left, _TOP_PX, PAPER_SIZE_PX)
        colours = error_colours(np.nan_to_num(error), *SCALE_PX)
        colours[np.isnan(error)] = 226
        style.picture(page, colours, left, _TOP_PX + PAPER_SIZE_PX + 14, PAPER_SIZE_PX)
    draw_scale(
        page, SCALE_PX, left=820, top=HEIGHT_PX - 84, width=480, marks=(0.1, 1, 10, 100),
        title="below: displacement, px; grey: nothing is shown",
    )  # fmt: skip


def frame(subject: Subject, split: PolygonSplit) -> Image:
    """Return the first exposure's frame through a mesh, 2 x 2 exact rays a pixel."""
    view = subject.prepare(Step("", RendererKind.TRACE, RenderWish(split, 2)))
    try:
        return view.draw(subject.exposures[0]).rgb
    finally:
        view.close()


def displacement(camera: OmniCamera, split: PolygonSplit) -> Floats:
    """Return (h, w) px from where each pixel's content belongs; NaN where no polygon is."""
    pixels = pixel_centres(camera)[:, :, 0]
    directions, covered = polygon_directions(camera, split, pixels)
    error_px, known = displacement_px(camera, pixels, directions)
    return np.where(covered & known, error_px, np.nan)
