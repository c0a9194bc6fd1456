"""The decision experiment: every effect's decision beside its truth, in many situations.

Bundled worlds, places drawn by seed, motions of the shipped robot, the shipped real camera with its
thresholds. Two processes share the places; the result depends on the seed alone.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

from catoptra_studies.effects.decision_trial import TrialDecision, TrialWorld
from catoptra_studies.effects.situations import WORLDS

_NUM_PROCESSES = 2


@dataclass(frozen=True, slots=True)
class DecisionStudy:
    """Size of the experiment."""

    num_places: int
    """Places of each world; each in four motions."""
    worlds: tuple[str, ...] = WORLDS
    seed: int = 0
    width_px: int | None = None
    """Side of a square image; None for the camera's own size."""
    num_processes: int = field(default=_NUM_PROCESSES, compare=False)


def run_decision_study(
    study: DecisionStudy, *, on_place: Callable[[], None] = lambda: None
) -> tuple[TrialDecision, ...]:
    """Decisions and truths of all situations, by world, place, motion and optical order.

    Args:
        on_place: Called after each place.
    """
    tasks = [(study, world, number) for world in study.worlds for number in range(study.num_places)]
    if study.num_processes == 1:
        return _collect(map(run_place, tasks), on_place)
    # Spawned: a forked process would share the locks of a library's threads.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(study.num_processes, mp_context=context) as pool:
        try:
            return _collect(pool.map(run_place, tasks), on_place)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def run_place(task: tuple[DecisionStudy, str, int]) -> Sequence[TrialDecision]:
    """Decisions at one place of a world, in all motions."""
    study, world, number = task
    trial_world = _keep_world(study, world)
    places = trial_world.choose_places(study.num_places, seed=study.seed)
    return tuple(trial_world.run(places[number]))


def _collect(
    results: Iterable[Sequence[TrialDecision]], on_place: Callable[[], None]
) -> tuple[TrialDecision, ...]:
    decisions: list[TrialDecision] = []
    for result in results:
        decisions += result
        on_place()
    return tuple(decisions)


# The world that this process used last: tasks come world by world.
_kept: dict[tuple[str, int | None], TrialWorld] = {}


def _keep_world(study: DecisionStudy, world: str) -> TrialWorld:
    key = (world, study.width_px)
    if key not in _kept:
        for other in _kept.values():
            other.close()
        _kept.clear()
        _kept[key] = TrialWorld(world, width_px=study.width_px)
    return _kept[key]
