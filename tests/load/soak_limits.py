"""Limits of the soak: what attackers may cost the honest clients, as requirements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from helpers.requirement_results import RequirementResult
from load.soak import LoadResult

# Threads that asyncio starts when several pictures are encoded at a time, with two processors.
_POOL_THREADS = 5.0


@dataclass(frozen=True, slots=True)
class SoakLimits:
    """Limits of a run under attack, relative to the control run."""

    max_late_fraction: float = 0.05
    """Reports more than 20 % late, beyond the control run's fraction."""
    max_extra_gap_s: float = 1.0
    """Longest interval between reports, beyond the control run's."""
    min_rate_fraction: float = 0.15
    """Of the control run's rate, each client: seven have pictures drawn instead of three, in equal
    shares, on processors that the attackers use too, with their robots in view."""
    max_newcomer_s: float = 3.0
    """From the connection of a newcomer to its first reply."""
    max_growth: float = 0.05
    """Of memory, descriptors and threads after the first minute."""
    fill: Mapping[str, float] = field(default_factory=dict)
    """Further growth by name, of bounded caches and of ports that a short run does not fill, beside
    the threads of asyncio's pool."""
    max_stop_s: float = 1.0
    """From SIGTERM to the end of the process."""

    def relax(self, factor: float, *, fill: Mapping[str, float]) -> SoakLimits:
        """Limits wider by a factor, for a short run on a busy machine."""
        return SoakLimits(
            factor * self.max_late_fraction,
            factor * self.max_extra_gap_s,
            self.min_rate_fraction / factor,
            factor * self.max_newcomer_s,
            factor * self.max_growth,
            fill,
            factor * self.max_stop_s,
        )


def evaluate_soak(
    control: LoadResult, attacked: LoadResult, limits: SoakLimits, *, num_attacks: int
) -> list[RequirementResult]:
    """Requirements of the soak with the measured values."""
    return [
        _evaluate_attackers(attacked, num_attacks),
        *_evaluate_reports(control, attacked, limits),
        *(_evaluate_rate(control, attacked, limits, viewer) for viewer in control.rates_hz),
        RequirementResult(
            f"a newcomer to control or image port has a reply within {limits.max_newcomer_s:g} s",
            f"longest {attacked.newcomer_s:.2f} s, control {control.newcomer_s:.2f} s",
            attacked.newcomer_s <= limits.max_newcomer_s,
        ),
        *(
            _evaluate_growth(attacked, limits, name, unit)
            for name, unit in (("resident_mb", " MB"), ("descriptors", ""), ("threads", ""))
        ),
        _evaluate_stop(attacked, limits),
        RequirementResult(
            "no honest client receives an error or is disconnected",
            "; ".join(attacked.faults) or "none",
            not attacked.faults,
        ),
    ]


def evaluate_lockstep(
    control: LoadResult, attacked: LoadResult, limits: SoakLimits, *, num_attacks: int
) -> list[RequirementResult]:
    """Requirements of the soak under lockstep, where an honest robot takes step after step."""
    return [
        _evaluate_attackers(attacked, num_attacks),
        RequirementResult(
            f"under lockstep no step takes {limits.max_extra_gap_s:g} s longer than in the control "
            "run",
            f"longest {attacked.longest_gap_s:.2f} s, control {control.longest_gap_s:.2f} s",
            attacked.longest_gap_s <= control.longest_gap_s + limits.max_extra_gap_s,
        ),
        _evaluate_stop(attacked, limits),
    ]


def _evaluate_stop(attacked: LoadResult, limits: SoakLimits) -> RequirementResult:
    return RequirementResult(
        f"the server ends within {limits.max_stop_s:g} s of SIGTERM, under attack",
        f"{attacked.stop_s:.2f} s",
        attacked.stop_s <= limits.max_stop_s,
    )


def _evaluate_attackers(attacked: LoadResult, num_attacks: int) -> RequirementResult:
    load = attacked.attackers
    # An attack that could not start would let every other requirement hold.
    return RequirementResult(
        f"{num_attacks} attackers run, on one processor at most",
        f"{load.num_processes} run, {load.processor_s / attacked.duration_s:.2f} processors",
        load.num_processes == num_attacks and 0.0 < load.processor_s <= 1.05 * attacked.duration_s,
    )


def _evaluate_reports(
    control: LoadResult, attacked: LoadResult, limits: SoakLimits
) -> list[RequirementResult]:
    return [
        RequirementResult(
            f"at most {limits.max_late_fraction:.0%} of the reports are over 20 % late, "
            "beyond the control run",
            f"{attacked.late_fraction:.1%}, control {control.late_fraction:.1%}",
            attacked.late_fraction <= control.late_fraction + limits.max_late_fraction,
        ),
        RequirementResult(
            f"no report is over {limits.max_extra_gap_s:g} s later than in the control run",
            f"longest interval {attacked.longest_gap_s:.2f} s, control {control.longest_gap_s:.2f}",
            attacked.longest_gap_s <= control.longest_gap_s + limits.max_extra_gap_s,
        ),
    ]


def _evaluate_rate(
    control: LoadResult, attacked: LoadResult, limits: SoakLimits, viewer: str
) -> RequirementResult:
    rate_hz, control_hz = attacked.rates_hz[viewer], control.rates_hz[viewer]
    return RequirementResult(
        f"the viewer of the {viewer} keeps {limits.min_rate_fraction:.0%} of its rate",
        f"{rate_hz:.1f} frames/s, control {control_hz:.1f}: {rate_hz / control_hz:.0%}",
        rate_hz >= limits.min_rate_fraction * control_hz,
    )


def _evaluate_growth(
    attacked: LoadResult, limits: SoakLimits, name: str, unit: str
) -> RequirementResult:
    settled, final = getattr(attacked.settled, name), getattr(attacked.final, name)
    fill = limits.fill.get(name, _POOL_THREADS if name == "threads" else 0.0)
    allowance = f" and {fill:g}{unit}" if fill else ""
    return RequirementResult(
        f"{name} grows at most {limits.max_growth:.0%}{allowance} after the first minute",
        f"{settled:.1f} to {final:.1f}{unit}: {final / settled - 1.0:+.1%}",
        final <= (1.0 + limits.max_growth) * settled + fill,
    )
