"""Figures and numbers of the experiment, put together into summary.json and the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from catoptra_studies.experiment.drive_log import DriveLog
from catoptra_studies.experiment.experiment_report import write_html_report
from catoptra_studies.experiment.experiment_runner import (
    DetectorSnapshot,
    ExperimentConfig,
    SetupResult,
)
from catoptra_studies.experiment.experiment_setups import FILTERS, PAPER_FILTER
from catoptra_studies.experiment.figure_source import CameraFigures, FrameComparison
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.experiment.metrics import (
    compute_measurement_metrics,
    median_run_index,
    summarize_runs,
)
from catoptra_studies.experiment.paper_claims import Claim, evaluate_claims, list_differences
from catoptra_studies.experiment.report_figures import (
    draw_classifier_output,
    draw_error_ensemble,
    draw_frame_pair,
    draw_overview,
    draw_position_errors,
    draw_trajectories,
)
from catoptra_studies.reports import ReportFigure, write_json


def write_experiment_results(
    config: ExperimentConfig,
    results: Sequence[SetupResult],
    camera_figures: CameraFigures,
    *,
    snapshot: DetectorSnapshot | None,
    comparison: FrameComparison | None,
    timing_s: dict[str, float],
    subtitle: str,
) -> tuple[Path, list[Claim]]:
    """Write all figures of the drives, summary.json and report.html.

    Args:
        config: Configuration of the experiment; figures of the camera are in the output folder.
        results: Drives of each set-up.
        camera_figures: Figures of the camera, with their numbers.
        snapshot: Frame for the figures of the detector; None where no set-up detects landmarks.
        comparison: Frames for Figure 11; None without a server to capture them.
        timing_s: Seconds used by each part.
        subtitle: Line below the report's title.

    Returns:
        Path of the report, and the claims with their evaluation.
    """
    summary = summarize_experiment(config, results)
    drive_figures = _draw_drive_figures(config, results)
    if snapshot is not None:
        # Frame, bearings and path in one figure, for the README. Of the simulated set-up where both
        # were driven: landmarks there come from frames like this one.
        draw_overview(config.output_folder / "overview.png", snapshot, *_median_run(results[0]))
    # Times in objects of their own: two runs with equal seeds differ there alone.
    document = {
        **summary,
        "camera_metrics": camera_figures.metrics,
        "camera_timings": camera_figures.timings,
        "timing_s": timing_s,
    }
    # A metric without values is None; nan is a bug, and raises.
    write_json(config.output_folder / "summary.json", document)
    claims = evaluate_claims(summary["setups"])
    report = write_html_report(
        config.output_folder,
        subtitle=subtitle,
        num_runs=config.num_runs,
        claims=claims,
        differences=list_differences(summary["setups"]),
        camera_figures=camera_figures.figures,
        landmark_figures=[
            *([] if comparison is None else [_draw_comparison(config, comparison)]),
            *([] if snapshot is None else [_draw_classifier(config, snapshot)]),
        ],
        drive_figures=drive_figures,
        summary=summary,
        timing="Time used: " + ", ".join(f"{k} {v:.0f} s" for k, v in timing_s.items()) + ".",
    )
    return report, claims


def summarize_experiment(
    config: ExperimentConfig, results: Sequence[SetupResult]
) -> dict[str, Any]:
    """Everything that summary.json has about the drives."""
    # Numbers, strings and lists alone: this dictionary is the JSON file.
    setups = {
        result.setup.name: {
            "title": result.setup.title,
            "landmarks": result.setup.measurement_source.value,
            "measurements": compute_measurement_metrics(result.drive_logs, config.landmarks),
            "filters": {
                settings.name: {
                    "title": settings.title,
                    **summarize_runs(result.filter_runs[settings.name]),
                }
                for settings in FILTERS
            },
        }
        for result in results
    }
    return {
        "seed": config.seed,
        "num_runs": config.num_runs,
        "setups": setups,
        "claims": [
            {
                "key": claim.key,
                "text": claim.text,
                "criterion": claim.criterion,
                "satisfying_runs": claim.runs.num_satisfying,
                "runs": claim.runs.num_runs,
                "interval": list(claim.runs.interval),
                "verdict": claim.verdict,
            }
            for claim in evaluate_claims(setups)
        ],
        "differences": [asdict(difference) for difference in list_differences(setups)],
    }


def _draw_drive_figures(
    config: ExperimentConfig, results: Sequence[SetupResult]
) -> list[ReportFigure]:
    """Draw trajectories and errors of the median run of each set-up, and the ensembles."""
    # The same run in both figures, so that a bend of the path can be found in the errors. The
    # paper's filter, since Figures 12 and 13 show no other.
    chosen = []
    for result in results:
        drive_log, filter_run = _median_run(result)
        chosen.append((f"{_setup_title(result)}, run {filter_run.run}", drive_log, filter_run))
    draw_trajectories(config.output_folder / "trajectories.png", chosen, config.landmarks)
    draw_position_errors(
        config.output_folder / "errors.png", [(title, run) for title, _, run in chosen]
    )
    ensembles = [
        (f"{_setup_title(result)}, {config.num_runs} runs", result.filter_runs[PAPER_FILTER.name])
        for result in results
    ]
    draw_error_ensemble(config.output_folder / "ensemble.png", ensembles)
    return [
        ReportFigure(
            "trajectories.png",
            "Self-localization on the field (the paper's Figure 12)",
            "The run whose largest error is the median one, by the paper's filter. Seen from "
            "above; arrows show the direction of travel.",
            "Maps of the true path, the path by odometry alone and the filter's estimate",
        ),
        ReportFigure(
            "errors.png",
            "Distance between true and estimated position (the paper's Figure 13)",
            "Errors of odometry alone and of the paper's filter. The bars count the landmarks "
            "that its gate accepted (up) and rejected (down) in each step. In real the filter "
            "starts too certain; in some runs it then rejects most landmarks and relies on "
            "odometry, until the turn at the first corner (steps 24 and 25) widens its covariance.",
            "Position error over the steps for odometry and filter",
        ),
        ReportFigure(
            "ensemble.png",
            "The same over all runs",
            "Medians, and bands from 5 % to 95 % of the runs, in each step for itself: of odometry "
            "alone and of the paper's filter.",
            "Bands of position error over the steps for all runs",
        ),
    ]


def _median_run(result: SetupResult) -> tuple[DriveLog, FilterRun]:
    """Drive and filter of the run to show."""
    filter_runs = result.filter_runs[PAPER_FILTER.name]
    index = median_run_index(filter_runs)
    return result.drive_logs[index], filter_runs[index]


def _setup_title(result: SetupResult) -> str:
    # Nobody who sees the picture alone may take it for a real robot.
    return {"sim": "sim", "real": "real (simulated)"}[result.setup.name]


def _draw_comparison(config: ExperimentConfig, comparison: FrameComparison) -> ReportFigure:
    path = config.output_folder / "frames.png"
    panels = (
        ("with the degradations of a real camera", comparison.degraded_rgb),
        ("simulated set-up", comparison.clean_rgb),
    )
    draw_frame_pair(path, panels)
    return ReportFigure(
        path.name,
        "Omnidirectional frames, real and simulated (the paper's Figure 11)",
        "The paper's left image is a recorded one. Here both are simulated, of a robot that turns "
        "on the spot: left with the effects of robot p2at_omni_real, motion blur, defocus, "
        "vignetting and noise among them; right as the classifier gets them in sim. The drives of "
        "real use no frames, since their landmarks are measured by hand.",
        "Two round mirror images of the field, the left one darker towards the rim, blurred and "
        "noisy, the right one clean",
    )


def _draw_classifier(config: ExperimentConfig, snapshot: DetectorSnapshot) -> ReportFigure:
    path = config.output_folder / "classifier.png"
    draw_classifier_output(path, snapshot)
    return ReportFigure(
        path.name,
        "Stages of the colour classifier",
        "A frame as received over TCP, its cylinder, and the pixels whose likelihood ratio exceeds "
        "the threshold of Eq. 3. Two stacked colours make a beacon; its position in the cylinder "
        "gives bearing and range.",
        "Omnidirectional frame, unwarped cylinder and colour labels with detected landmarks",
    )
