"""Requirements of the soak: met by an undisturbed run, each missed by a run with one fault."""

from __future__ import annotations

from dataclasses import replace

import pytest

from load.attacker_process import AttackerLoad
from load.process_sample import ProcessSample
from load.soak import LoadResult
from load.soak_limits import SoakLimits, evaluate_lockstep, evaluate_soak

_SAMPLE = ProcessSample(0.0, 100.0, 20.0, 10.0)
UNDISTURBED = LoadResult(
    duration_s=60.0,
    late_fraction=0.0,
    longest_gap_s=0.22,
    rates_hz={"image port": 20.0, "stream": 18.0},
    newcomer_s=0.2,
    settled=_SAMPLE,
    final=_SAMPLE,
    stop_s=0.2,
    faults=(),
    attackers=AttackerLoad(3, 50.0),
    samples=(),
)


STRICT = SoakLimits()


def find_missed(attacked: LoadResult, limits: SoakLimits = STRICT) -> list[str]:
    """Requirements that a run under three attacks misses."""
    results = evaluate_soak(UNDISTURBED, attacked, limits, num_attacks=3)
    return [result.requirement for result in results if not result.is_met]


def test_undisturbed_run_misses_nothing() -> None:
    assert not find_missed(UNDISTURBED)


@pytest.mark.parametrize(
    ("fault", "requirement"),
    [
        ({"late_fraction": 0.06}, "of the reports are over 20 % late"),
        ({"longest_gap_s": 1.3}, "no report is over 1 s later"),
        ({"rates_hz": {"image port": 2.9, "stream": 18.0}}, "viewer of the image port"),
        ({"rates_hz": {"image port": 20.0, "stream": 2.6}}, "viewer of the stream"),
        ({"newcomer_s": 3.1}, "a newcomer to control or image port"),
        ({"final": replace(_SAMPLE, resident_mb=106.0)}, "resident_mb grows"),
        ({"final": replace(_SAMPLE, descriptors=22.0)}, "descriptors grows"),
        ({"final": replace(_SAMPLE, threads=16.0)}, "threads grows"),
        ({"stop_s": 1.1}, "within 1 s of SIGTERM"),
        ({"stop_s": float("inf")}, "within 1 s of SIGTERM"),
        ({"faults": ("robot: gone",)}, "no honest client"),
        ({"attackers": AttackerLoad(2, 50.0)}, "3 attackers run"),
        ({"attackers": AttackerLoad(3, 0.0)}, "3 attackers run"),
        ({"attackers": AttackerLoad(3, 90.0)}, "3 attackers run"),
    ],
)
def test_run_with_a_fault_misses_its_requirement(
    fault: dict[str, object], requirement: str
) -> None:
    (missed,) = find_missed(replace(UNDISTURBED, **fault))
    assert requirement in missed


def test_limits_when_relaxed_admit_three_times_the_disturbance() -> None:
    disturbed = replace(
        UNDISTURBED,
        late_fraction=0.14,
        longest_gap_s=3.1,
        newcomer_s=5.9,
        rates_hz={"image port": 1.1, "stream": 1.0},
        final=replace(_SAMPLE, resident_mb=114.0),
        stop_s=2.9,
    )
    assert not find_missed(disturbed, STRICT.relax(3.0, fill={}))


def test_growth_within_the_fill_of_a_short_run_is_admitted() -> None:
    grown = replace(UNDISTURBED, final=replace(_SAMPLE, resident_mb=160.0))
    assert not find_missed(grown, STRICT.relax(3.0, fill={"resident_mb": 50.0}))
    assert find_missed(grown, STRICT.relax(3.0, fill={"resident_mb": 40.0}))


@pytest.mark.parametrize("fault", [{"longest_gap_s": 1.3}, {"stop_s": 1.1}])
def test_lockstep_run_with_a_fault_misses_its_requirement(fault: dict[str, object]) -> None:
    attacked = replace(UNDISTURBED, **fault)
    results = evaluate_lockstep(UNDISTURBED, attacked, STRICT, num_attacks=3)
    assert [result.is_met for result in results].count(False) == 1
