"""The work of the study, nothing printed: a server a rung, films, two classifiers, figures.

One classifier has learnt from clean pictures, as the paper's; the other anew from pictures like
those that it is shown. Where the first fails and the second does not, pictures are different;
where both do, they are worse.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from catoptra_client.experiment.degraded.film import Film, detector_for, filmed, sightings
from catoptra_client.experiment.degraded.ladders import Ladder, clean_text, robot_text
from catoptra_client.experiment.degraded.measures import Figures, figures
from catoptra_client.experiment.degraded.sample import Sample, sample
from catoptra_client.experiment.session import Plan, server_for
from catoptra_client.experiment.training_frames import labelled_frames
from catoptra_client.landmarks import ColourClassifier, train

# What a classifier has learnt from.
FROM_CLEAN = "clean"
FROM_SAME = "same"
# A server draws while another's frame is looked at: two fill two cores.
_AT_ONCE = 2

Advance = Callable[[], None]


@dataclass(frozen=True, slots=True, eq=False)
class RungResult:
    """What came of a rung, by what the classifier had learnt from; the sample is FROM_CLEAN's."""

    label: str
    figures: Mapping[str, Figures]
    sample: Sample


@dataclass(frozen=True, slots=True, eq=False)
class LadderResult:
    """What came of a ladder."""

    ladder: Ladder
    clean: RungResult
    rungs: tuple[RungResult, ...]


def drives(plan: Plan, ladders: Sequence[Ladder]) -> int:
    """Return how many drives a study takes."""
    return plan.runs * (1 + sum(len(ladder.rungs) for ladder in ladders))


def run_study(
    plan: Plan, ladders: Sequence[Ladder], *, robots: Path, on_drive: Advance
) -> tuple[LadderResult, ...]:
    """Return the ladders' results; the plan's first set-up says which way to drive."""
    learnt, clean = _clean(plan, clean_text(robots), on_drive)
    with ThreadPoolExecutor(_AT_ONCE) as pool:

        def begun(ladder: Ladder, number: int) -> Future[RungResult]:
            rung = ladder.rungs[number]
            return pool.submit(
                _rung,
                plan,
                robot_text(ladder, rung, robots),
                name=f"{ladder.slug}_{number + 1}",
                label=rung.label,
                learnt=learnt,
                on_drive=on_drive,
            )

        begun_all = [[begun(one, n) for n in range(len(one.rungs))] for one in ladders]
        try:
            return tuple(
                LadderResult(ladder, clean, tuple(rung.result() for rung in rungs))
                for ladder, rungs in zip(ladders, begun_all, strict=True)
            )
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)  # else all others are measured first
            raise


def _clean(plan: Plan, robot: str, on_drive: Advance) -> tuple[ColourClassifier, RungResult]:
    """Return the classifier that learns from clean pictures, and how it does in them."""
    classifier, films = _films(plan, robot, "clean", on_drive)
    return classifier, _result(plan, films, "clean", {FROM_CLEAN: classifier})


def _rung(
    plan: Plan,
    robot: str,
    *,
    name: str,
    label: str,
    learnt: ColourClassifier,
    on_drive: Advance,
) -> RungResult:
    anew, films = _films(plan, robot, name, on_drive)
    return _result(plan, films, label, {FROM_CLEAN: learnt, FROM_SAME: anew})


def _films(
    plan: Plan, robot: str, name: str, on_drive: Advance
) -> tuple[ColourClassifier, tuple[Film, ...]]:
    """Return a classifier trained from a server's pictures, and a film of each seed on it."""
    file = plan.output.resolve() / f"{name}.ini"
    file.write_text(robot, encoding="utf-8")
    setup = replace(plan.setups[0], name=name, robot_file=str(file))
    with server_for(plan, setup) as address:
        frames = labelled_frames(
            address,
            landmarks=plan.landmarks,
            count=plan.training_frames,
            seed=plan.seed + 1,
            on_frame=lambda: None,
        )
        classifier = train(frames)
        films = []
        for run in range(plan.runs):
            films.append(filmed(setup, run, address, on_step=lambda: None))
            on_drive()
    return classifier, tuple(films)


def _result(
    plan: Plan, films: Sequence[Film], label: str, classifiers: Mapping[str, ColourClassifier]
) -> RungResult:
    landmarks = plan.landmarks
    found = {
        learnt: [sightings(f, detector_for(f, classifier, landmarks)) for f in films]
        for learnt, classifier in classifiers.items()
    }
    numbers = {
        learnt: figures(films, seen, setup=plan.setups[0], landmarks=landmarks)
        for learnt, seen in found.items()
    }
    return RungResult(label, numbers, sample(films[0], found[FROM_CLEAN][0]))
