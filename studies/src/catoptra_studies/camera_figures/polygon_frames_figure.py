"""The frame through four mirror meshes at the paper's 360 x 360 pixels: its Figure 8."""

from __future__ import annotations

from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FIGURE_SAMPLES, FigureCaption, FigureInputs
from catoptra_studies.camera_figures.polygon_displacement import PolygonError, measure_polygon_error
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS, PAPER_SIZE_PX

# Each rendered pixel becomes a block of 2 x 2: no resampling hides or adds a step in a line.
IMAGE_WIDTH_PX = 2 * PAPER_SIZE_PX
LEFT_PX, TOP_PX, STEP_X_PX, STEP_Y_PX = 20, 66, 760, 790


def draw_polygon_frames(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the four frames, each under its measured displacement."""
    subject = inputs.subject
    camera = subject.resize_camera(PAPER_SIZE_PX)
    # UV coordinates, the default of a tessellation, as in the paper.
    errors = [
        measure_polygon_error(camera, tessellation_from_polygon_count(count))
        for count in PAPER_POLYGON_COUNTS
    ]
    for index, error in enumerate(errors):
        left = LEFT_PX + STEP_X_PX * (index % 2)
        top = TOP_PX + STEP_Y_PX * (index // 2)
        image = subject.render_frame(PAPER_SIZE_PX, FIGURE_SAMPLES, surface=error.tessellation)
        plot_style.show_image(page, image, left, top, IMAGE_WIDTH_PX)
        _draw_heading(page, left, top, error)
    return _caption(errors)


def _draw_heading(page: plot_style.Page, left: int, top: int, error: PolygonError) -> None:
    name = f"{error.tessellation.num_polygons} polygons"
    plot_style.add_text(page, left, top - 12, name, va="bottom", fontweight="bold")
    numbers = f"{error.rms_px:.3g} px rms, {error.max_px:.3g} px at most"
    right = left + IMAGE_WIDTH_PX
    plot_style.add_text(
        page, right, top - 12, numbers, ha="right", va="bottom", color=plot_style.MUTED
    )


def _caption(errors: list[PolygonError]) -> FigureCaption:
    metrics = {}
    for error in errors:
        metrics[f"rms_px_{error.tessellation.num_polygons}"] = round(error.rms_px, 3)
        metrics[f"max_px_{error.tessellation.num_polygons}"] = round(error.max_px, 3)
    coarse, *_, fine = errors
    return FigureCaption(
        title="The same view through 16, 64, 256 and 1024 polygons",
        caption=(
            f"UV-mapped mirror meshes in {PAPER_SIZE_PX} × {PAPER_SIZE_PX} pixels, shown pixel "
            "by pixel. Texture coordinates are interpolated linearly over each polygon, which "
            f"displaces the image by {coarse.rms_px:.1f} px (rms) with "
            f"{coarse.tessellation.num_polygons} polygons and by {fine.rms_px:.2f} px with "
            f"{fine.tessellation.num_polygons}."
        ),
        alt=(
            "Four round mirror images of the same scene: with 16 polygons a broken square, with "
            "64 an octagon with bent lines, with 256 nearly right, with 1024 smooth."
        ),
        metrics=metrics,
    )
