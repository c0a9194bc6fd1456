"""Plots of the study's numbers: time against error, frame rates, localization."""

from __future__ import annotations

from pathlib import Path

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import CostResults
from catoptra_studies.accuracy_cost.plots.localization_plot import (
    LOCALIZATION_HEIGHT_PX,
    draw_localization,
)
from catoptra_studies.accuracy_cost.plots.pareto_plot import (
    PARETO_HEIGHT_PX,
    draw_pareto,
)
from catoptra_studies.camera_figures.frame_rates import (
    FRAME_RATES_HEIGHT_PX,
    draw_frame_rate_panels,
)


def write_result_plots(results: CostResults, folder: Path) -> None:
    """Write pareto.png, and frame_rates.png and localization.png where these were measured."""
    with plot_style.open_page(folder / "pareto.png", PARETO_HEIGHT_PX) as page:
        draw_pareto(page, results.levels)
    if results.frame_rates:
        with plot_style.open_page(folder / "frame_rates.png", FRAME_RATES_HEIGHT_PX) as page:
            draw_frame_rate_panels(page, results.frame_rates)
    if results.localization:
        with plot_style.open_page(folder / "localization.png", LOCALIZATION_HEIGHT_PX) as page:
            draw_localization(page, results.localization)
