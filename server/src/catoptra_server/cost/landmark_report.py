"""The report's part on what accuracy is worth to a robot that finds landmarks and localises."""

from __future__ import annotations

from catoptra_server.cost.document import Document, Landmarks
from catoptra_server.cost.tables import markdown_table, paragraph


def landmark_section(document: Document) -> str:
    """Return the table; nothing where the client's side has not measured."""
    landmarks = document.landmarks
    if landmarks is None:
        return ""
    times = {step.name: step.ms for step in document.steps}
    rows = [
        [row.step, f"{times[row.step]:.1f}" if row.step in times else "-", f"{row.found_near:.0%}",
         f"{row.found:.0%}", f"{row.bearing_rms_deg:.2f}", f"{row.range_rms_m:.3f}",
         f"{row.ekf_mean_m:.3f}", f"{row.ekf_max_m:.2f}",
         f"{row.honest_ekf_mean_m:.3f}", f"{row.honest_ekf_max_m:.2f}"]
        for row in landmarks.rows
    ]  # fmt: skip
    head = ("step", "ms", "found to 1.5 m", "to 2.5 m", "bearing deg", "range m",
            "filter mean m", "max m", "honest mean m", "max m")  # fmt: skip
    return f"""\
## What it is worth: landmarks and localisation

{markdown_table(head, rows)}

{paragraph(_words(landmarks))}

{paragraph(_enough(landmarks))}

`landmarks.png`."""


def _words(landmarks: Landmarks) -> str:
    return (
        f"The key steps only, each through a server process of its own: {landmarks.runs} runs of "
        f"{landmarks.steps_a_run} steps round the field, the same seeds for all, frames over TCP, "
        "one colour classifier trained on frames of the best step. Found: the share of beacons "
        "within reach that were measured. Bearing and range: rms over all measurements. Filter: "
        "the position error of the paper's (P0 = 0) and of one that states its start and its "
        "noises honestly, medians over the runs of a run's mean and largest. Odometry alone: up to "
        f"{landmarks.odometry_max_m:.2f} m."
    )


def _enough(landmarks: Landmarks) -> str:
    """Return the coarsest step that localises as well as the best, to a centimetre."""
    best = min(row.honest_ekf_mean_m for row in landmarks.rows)
    enough = next(row for row in landmarks.rows if row.honest_ekf_mean_m <= best + 0.01)
    return (
        f"To localise within a centimetre of the best, {enough.step} is enough: the filter "
        f"averages over bearings that are {enough.bearing_rms_deg:.2g} deg off."
    )
