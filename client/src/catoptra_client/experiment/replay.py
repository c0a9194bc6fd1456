"""A filter run over a recorded drive: beliefs, acceptances, errors. Pure functions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_client.experiment.recording import Recording, Seen, Step, true_positions
from catoptra_client.experiment.setups import FilterSettings, Setup
from catoptra_client.localization import (
    Belief,
    Control,
    FilterHealth,
    LandmarkMap,
    RangeBearing,
    Recovery,
    Update,
    control_from_odometry,
    observe,
    position_of,
    predict,
    recovered,
    update,
)
from catoptra_client.localization.motion import moved

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """What came of a drive: one row a step, the start included.

    estimate, odometry: (n, 3) poses. estimate_error_m, odometry_error_m: (n,) distances from the
    truth. seen, accepted: (n,) numbers of landmarks. streak: (n,) rejecting steps in a row.
    windowed_nis: (n,) of the latest compared measurements, per degree of freedom; 1 is healthy.
    """

    settings: str
    seed: int
    estimate: Floats
    odometry: Floats
    estimate_error_m: Floats
    odometry_error_m: Floats
    seen: npt.NDArray[np.int64]
    accepted: npt.NDArray[np.int64]
    streak: npt.NDArray[np.int64]
    windowed_nis: Floats


def replay(
    recording: Recording, setup: Setup, settings: FilterSettings, known: LandmarkMap
) -> Trace:
    """Return the trace of a filter over a recording."""
    state = _State(_start(recording, setup, settings), FilterHealth())
    odometry = [state.belief.mean]
    estimates, counts, health = [state.belief.mean], [(0, 0)], [state.health]
    for previous, step in zip(recording.steps, recording.steps[1:], strict=False):
        control = control_from_odometry(previous.odometry, step.odometry)
        odometry.append(moved(odometry[-1], control))
        state, updates = _filter_step(state, control, step, settings, known)
        estimates.append(state.belief.mean)
        counts.append((len(updates), sum(update.accepted for update in updates)))
        health.append(state.health)
    truth = true_positions(recording)
    seen, accepted = np.array(counts).T
    return Trace(
        settings=settings.name,
        seed=recording.seed,
        estimate=np.array(estimates),
        odometry=np.array(odometry),
        estimate_error_m=np.linalg.norm(np.array(estimates)[:, :2] - truth, axis=1),
        odometry_error_m=np.linalg.norm(np.array(odometry)[:, :2] - truth, axis=1),
        seen=seen,
        accepted=accepted,
        streak=np.array([h.rejection_streak for h in health]),
        windowed_nis=np.array([h.windowed_nis for h in health]),
    )


@dataclass(frozen=True, slots=True)
class _State:
    belief: Belief
    health: FilterHealth


def _start(recording: Recording, setup: Setup, settings: FilterSettings) -> Belief:
    """Return the believed start: the true place with the set-up's heading error, and P0."""
    truth = recording.steps[0].truth
    mean = np.array([truth.x_m, truth.y_m, truth.yaw_rad + setup.heading_error_rad])
    position, heading = settings.start_sigma_m**2, settings.start_sigma_rad**2
    return Belief(mean, np.diag([position, position, heading]))


def _filter_step(
    state: _State, control: Control, step: Step, settings: FilterSettings, known: LandmarkMap
) -> tuple[_State, list[Update]]:
    """Predict, take in every landmark that was seen, look after the filter's health."""
    belief = predict(state.belief, control, noise=settings.motion)
    updates: list[Update] = []
    for seen in step.seen:
        updates.append(
            update(
                belief,
                _measurement(seen, settings),
                landmark=position_of(known, seen.name),
                gate=settings.gate,
            )
        )
        belief = updates[-1].belief
    health = observe(state.health, updates)
    if settings.recovers:
        belief, health = recovered(belief, health, recovery=Recovery())
    return _State(belief, health), updates


def _measurement(seen: Seen, settings: FilterSettings) -> RangeBearing:
    covariance = np.diag([settings.range_sigma_m**2, settings.bearing_sigma_rad**2])
    return RangeBearing(seen.range_m, seen.bearing_rad, covariance)


def first_acceptance_after_drought(trace: Trace, *, drought_steps: int = 5) -> int | None:
    """Return the first accepting step after so many seeing steps without; None if none."""
    streak = 0
    for step, (seen, accepted) in enumerate(zip(trace.seen, trace.accepted, strict=True)):
        if accepted and streak >= drought_steps:
            return step
        if seen:
            streak = 0 if accepted else streak + 1
    return None


def acceptance_share(trace: Trace, first: int, last: int) -> float | None:
    """Return the share of seen landmarks that were accepted in steps first..last.

    None if no landmark was seen in them.
    """
    seen = int(trace.seen[first : last + 1].sum())
    return int(trace.accepted[first : last + 1].sum()) / seen if seen else None
