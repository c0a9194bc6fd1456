"""Eight seconds of all attacks at once beside an honest robot and clients of its camera.

A file of its own, so that its control run and its attack share the machine with the same tests.
"""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from load.attacks import ATTACKS, SOAK_ARGUMENTS
from load.soak import run_load
from load.soak_limits import SoakLimits, evaluate_soak

_CONTROL_S = 3.0
# Seconds of planning are too much of this short run: `make soak` has those attacks, too.
ATTACK_NAMES = tuple(name for name, attack in ATTACKS.items() if not attack.is_planned)
_ATTACK_S = 8.0
# In eight seconds caches and ports fill up: views to 256 MiB, 64 connections to each TCP port, 128
# to the page and 288 to the stream, which take two descriptors each.
_FILL = {"resident_mb": 300.0, "descriptors": 900.0, "threads": 16.0}
# Beside other tests viewers keep less than `make soak` states. Here: they are served.
_MIN_RATE_FRACTION = 0.01
# Without an attack; 45 on two idle processors.
_MIN_CONTROL_HZ = 5.0
# Other tests take the processors meanwhile: five times the limits of `make soak`. Beside whole runs
# of other tests 17 to 20 % of the reports were late.
_LIMITS = replace(SoakLimits().relax(5.0, fill=_FILL), min_rate_fraction=_MIN_RATE_FRACTION)


def test_reports_under_attack_are_in_time_and_viewers_are_served(tmp_path: Path) -> None:
    control = asyncio.run(run_load(tmp_path / "control", _CONTROL_S, *SOAK_ARGUMENTS))
    if min(control.rates_hz.values()) < _MIN_CONTROL_HZ:
        pytest.skip(f"the machine is too busy to attack a server on: {control.rates_hz}")
    attacked = asyncio.run(
        run_load(tmp_path / "attacked", _ATTACK_S, *SOAK_ARGUMENTS, attacks=ATTACK_NAMES)
    )
    results = evaluate_soak(control, attacked, _LIMITS, num_attacks=len(ATTACK_NAMES))
    missed = [f"{r.requirement}: {r.measurement}" for r in results if not r.is_met]
    assert not missed, "\n".join(missed)
