"""The experiment's pictures and numbers, put together into summary.json and the report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from catoptra_studies.experiment.ensemble import median_run_index, summarise_runs
from catoptra_studies.experiment.experiment_runner import (
    DetectorSnapshot,
    ExperimentConfig,
    SetupResult,
)
from catoptra_studies.experiment.experiment_setups import FILTERS, PAPER_FILTER
from catoptra_studies.experiment.experiment_report import ReportFigure, write_html_report
from catoptra_studies.experiment.measurement_metrics import compute_measurement_metrics
from catoptra_studies.experiment.paper_claims import evaluate_claims
from catoptra_studies.experiment.plots.classifier_plot import draw_classifier_output
from catoptra_studies.experiment.plots.error_plot import draw_error_ensemble, draw_position_errors
from catoptra_studies.experiment.plots.overview_plot import draw_overview
from catoptra_studies.experiment.plots.trajectory_plot import draw_trajectories


def write_experiment_results(
    config: ExperimentConfig,
    results: Sequence[SetupResult],
    camera_figures: Sequence[ReportFigure],
    *,
    snapshot: DetectorSnapshot | None,
    camera_metrics: dict[str, Any],
    timing_s: dict[str, float],
    subtitle: str,
) -> Path:
    """Write summary.json and report.html; return the report's path."""
    numbers = summarise_experiment(config, results)
    drives = draw_drive_figures(config, results)
    if snapshot is not None:
        _draw_overview(config, results, snapshot)
    document = {**numbers, "camera": camera_metrics, "timing_s": timing_s}
    text = json.dumps(document, indent=2, allow_nan=False)
    (config.output_folder / "summary.json").write_text(text + "\n", encoding="utf-8")
    return write_html_report(
        config.output_folder,
        subtitle=subtitle,
        num_runs=config.num_runs,
        claims=evaluate_claims(numbers["setups"]),
        camera_figures=camera_figures,
        landmark_figures=[] if snapshot is None else [_draw_classifier(config, snapshot)],
        drive_figures=drives,
        summary=numbers,
        timing="Time used: " + ", ".join(f"{k} {v:.0f} s" for k, v in timing_s.items()) + ".",
    )


def summarise_experiment(
    config: ExperimentConfig, results: Sequence[SetupResult]
) -> dict[str, Any]:
    """Return everything that summary.json holds of the drives."""
    setups = {
        result.setup.name: {
            "title": result.setup.title,
            "landmarks": result.setup.measurement_source.value,
            "measurements": compute_measurement_metrics(result.drive_logs, config.landmarks),
            "filters": {
                f.name: {"title": f.title, **summarise_runs(result.filter_runs[f.name])}
                for f in FILTERS
            },
        }
        for result in results
    }
    claims = [asdict(claim) for claim in evaluate_claims(setups)]
    return {"seed": config.seed, "runs": config.num_runs, "setups": setups, "claims": claims}


def draw_drive_figures(
    config: ExperimentConfig, results: Sequence[SetupResult]
) -> list[ReportFigure]:
    """Draw trajectories and errors of the typical run of each set-up, and the ensembles."""
    chosen = []
    for result in results:
        traces = result.filter_runs[PAPER_FILTER.name]
        index = median_run_index(traces)
        chosen.append((result, result.drive_logs[index], traces[index]))
    maps = [(f"{r.setup.name}, run {t.seed}", recording, t) for r, recording, t in chosen]
    draw_trajectories(config.output_folder / "trajectories.png", maps, config.landmarks)
    draw_position_errors(
        config.output_folder / "errors.png",
        [(f"{r.setup.name}, run {t.seed}", t) for r, _, t in chosen],
    )
    draw_error_ensemble(
        config.output_folder / "ensemble.png",
        [
            (f"{r.setup.name}, {config.num_runs} runs", r.filter_runs[PAPER_FILTER.name])
            for r in results
        ],
    )
    return [
        ReportFigure(
            "trajectories.png",
            "Self-localisation on the field (the paper's Figure 12)",
            "The run whose largest error is the median one. The open circle is the start.",
            "Maps of the true path, the path by odometry alone and the filter's estimate",
        ),
        ReportFigure(
            "errors.png",
            "Distance between true and estimated place (the paper's Figure 13)",
            "The bars count the landmarks that the validation gate accepted (up) and rejected "
            "(down) in each step. In the real set-up the filter starts too certain: it trusts its "
            "odometry and rejects, until the turn at the first corner (step 24) widens its belief.",
            "Position error over the steps for odometry and filter",
        ),
        ReportFigure(
            "ensemble.png",
            "The same over all seeds",
            "Median and the band from 5 % to 95 % of the runs, the paper's filter.",
            "Bands of position error over the steps for all runs",
        ),
    ]


def _draw_classifier(config: ExperimentConfig, snapshot: DetectorSnapshot) -> ReportFigure:
    draw_classifier_output(
        config.output_folder / "classifier.png", snapshot.rgb, snapshot.detector, snapshot.stages
    )
    return ReportFigure(
        "classifier.png",
        "What the classifier sees",
        "A frame as it came over TCP, its cylinder, and the pixels whose likelihood ratio passes "
        "the threshold of Eq. 3. Two stacked colours make a beacon; its place in the cylinder "
        "gives bearing and range.",
        "Omnidirectional frame, unwarped cylinder and colour labels with detected landmarks",
    )


def _draw_overview(
    config: ExperimentConfig, results: Sequence[SetupResult], snapshot: DetectorSnapshot
) -> None:
    """Draw the one picture that tells the story: frame, bearings, path."""
    result = results[0]
    traces = result.filter_runs[PAPER_FILTER.name]
    index = median_run_index(traces)
    draw_overview(
        config.output_folder / "overview.png",
        snapshot.rgb,
        snapshot.detector,
        stages=snapshot.stages,
        logged_run=(result.drive_logs[index], traces[index]),
    )
