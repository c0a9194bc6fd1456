"""The experiment's pictures and numbers, put together into summary.json and the report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from catoptra_client.experiment.claims import paper_claims
from catoptra_client.experiment.ensemble import summary, typical
from catoptra_client.experiment.measurements import measurement_figures
from catoptra_client.experiment.pictures.classifier_view import draw_classifier_view
from catoptra_client.experiment.pictures.errors import draw_ensemble, draw_errors
from catoptra_client.experiment.pictures.overview import draw_overview
from catoptra_client.experiment.pictures.trajectories import draw_trajectories
from catoptra_client.experiment.report import Picture, write_report
from catoptra_client.experiment.session import Plan, SetupResult, Snapshot
from catoptra_client.experiment.setups import FILTERS, PAPER_FILTER


def write_results(
    plan: Plan,
    results: Sequence[SetupResult],
    camera_pictures: Sequence[Picture],
    *,
    snapshot: Snapshot | None,
    camera_numbers: dict[str, Any],
    timing_s: dict[str, float],
    subtitle: str,
) -> Path:
    """Write summary.json and report.html; return the report's path."""
    numbers = summarise(plan, results)
    drives = draw_drives(plan, results)
    if snapshot is not None:
        _draw_overview(plan, results, snapshot)
    document = {**numbers, "camera": camera_numbers, "timing_s": timing_s}
    text = json.dumps(document, indent=2, allow_nan=False)
    (plan.output / "summary.json").write_text(text + "\n", encoding="utf-8")
    return write_report(
        plan.output,
        subtitle=subtitle,
        runs=plan.runs,
        claims=paper_claims(numbers["setups"]),
        camera=camera_pictures,
        landmarks=[] if snapshot is None else [_draw_classifier(plan, snapshot)],
        drive=drives,
        summary=numbers,
        timing="Time used: " + ", ".join(f"{k} {v:.0f} s" for k, v in timing_s.items()) + ".",
    )


def summarise(plan: Plan, results: Sequence[SetupResult]) -> dict[str, Any]:
    """Return everything that summary.json holds of the drives."""
    setups = {
        result.setup.name: {
            "title": result.setup.title,
            "landmarks": result.setup.sighting.value,
            "measurements": measurement_figures(result.recordings, plan.landmarks),
            "filters": {
                f.name: {"title": f.title, **summary(result.traces[f.name])} for f in FILTERS
            },
        }
        for result in results
    }
    claims = [asdict(claim) for claim in paper_claims(setups)]
    return {"seed": plan.seed, "runs": plan.runs, "setups": setups, "claims": claims}


def draw_drives(plan: Plan, results: Sequence[SetupResult]) -> list[Picture]:
    """Draw trajectories and errors of the typical run of each set-up, and the ensembles."""
    chosen = []
    for result in results:
        traces = result.traces[PAPER_FILTER.name]
        index = typical(traces)
        chosen.append((result, result.recordings[index], traces[index]))
    maps = [(f"{r.setup.name}, run {t.seed}", recording, t) for r, recording, t in chosen]
    draw_trajectories(plan.output / "trajectories.png", maps, plan.landmarks)
    draw_errors(
        plan.output / "errors.png", [(f"{r.setup.name}, run {t.seed}", t) for r, _, t in chosen]
    )
    draw_ensemble(
        plan.output / "ensemble.png",
        [(f"{r.setup.name}, {plan.runs} runs", r.traces[PAPER_FILTER.name]) for r in results],
    )
    return [
        Picture(
            "trajectories.png",
            "Self-localisation on the field (the paper's Figure 12)",
            "The run whose largest error is the median one. The open circle is the start.",
            "Maps of the true path, the path by odometry alone and the filter's estimate",
        ),
        Picture(
            "errors.png",
            "Distance between true and estimated place (the paper's Figure 13)",
            "The bars count the landmarks that the validation gate accepted (up) and rejected "
            "(down) in each step. In the real set-up the filter starts too certain: it trusts its "
            "odometry and rejects, until the turn at the first corner (step 24) widens its belief.",
            "Position error over the steps for odometry and filter",
        ),
        Picture(
            "ensemble.png",
            "The same over all seeds",
            "Median and the band from 5 % to 95 % of the runs, the paper's filter.",
            "Bands of position error over the steps for all runs",
        ),
    ]


def _draw_classifier(plan: Plan, snapshot: Snapshot) -> Picture:
    draw_classifier_view(
        plan.output / "classifier.png", snapshot.frame, snapshot.detector, snapshot.view
    )
    return Picture(
        "classifier.png",
        "What the classifier sees",
        "A frame as it came over TCP, its cylinder, and the pixels whose likelihood ratio passes "
        "the threshold of Eq. 3. Two stacked colours make a beacon; its place in the cylinder "
        "gives bearing and range.",
        "Omnidirectional frame, unwarped cylinder and colour labels with detected landmarks",
    )


def _draw_overview(plan: Plan, results: Sequence[SetupResult], snapshot: Snapshot) -> None:
    """Draw the one picture that tells the story: frame, bearings, path."""
    result = results[0]
    traces = result.traces[PAPER_FILTER.name]
    index = typical(traces)
    draw_overview(
        plan.output / "overview.png",
        snapshot.frame,
        snapshot.detector,
        view=snapshot.view,
        drive=(result.recordings[index], traces[index]),
    )
