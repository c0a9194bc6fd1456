"""The matrix of generated mutants of the stream: which checks notice each field's.

Each check is recorded once against our own server; a mutant is played against the recordings that
it concerns until a check notices it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from conformance.check import Check, ServerUnderTest
from conformance.server_setup import server_under_test
from conformance.stream_checks import STREAM_CHECKS
from conformance.stream_field_mutants import FieldMutant, generate_mutants, is_changed
from conformance.stream_replay import Exchange, record_check, replay_check
from conformance.suite import Outcome
from helpers.configs import OMNI_ROBOT, ROBOTS
from helpers.server_process import start_server

REAL_ROBOT = ROBOTS / "p2at_omni_real.ini"

Recording = tuple[Check, list[Exchange]]


@dataclass(frozen=True, slots=True)
class FieldResult:
    """Check that notices a mutant; empty if none does."""

    mutant: FieldMutant
    noticed_by: str
    reason: str


def record_checks(server: ServerUnderTest, checks: Sequence[Check]) -> list[Recording]:
    """Recordings of the checks that pass, against themselves too.

    Raises:
        AssertionError: A check fails.
    """
    recordings = []
    for check in checks:
        result, exchanges = record_check(check, server)
        assert result.outcome is not Outcome.FAILED, f"{check.name}: {result.reason}"
        if result.outcome is Outcome.PASSED:
            replayed = replay_check(check, server, exchanges)
            assert replayed.outcome is Outcome.PASSED, f"{check.name}: {replayed.reason}"
            recordings.append((check, exchanges))
    return recordings


def play_mutant(
    mutant: FieldMutant, server: ServerUnderTest, recordings: Sequence[Recording]
) -> FieldResult | None:
    """The first check that notices a mutant; None if it changes no recording."""
    is_equivalent = True
    for check, exchanges in recordings:
        mutated = mutant.apply(exchanges)
        if not is_changed(exchanges, mutated):
            continue
        is_equivalent = False
        result = replay_check(check, server, mutated)
        if result.outcome is Outcome.FAILED:
            return FieldResult(mutant, check.name, result.reason)
    return None if is_equivalent else FieldResult(mutant, "", "")


def play_stream_mutants(
    dialect: str = "ut2004", checks: Sequence[Check] = STREAM_CHECKS
) -> list[FieldResult]:
    """Results of all mutants of the checks' recordings in our own server.

    Args:
        dialect: `ut2004` or `udk`.
        checks: Checks of the stream.
    """
    recordings: list[Recording] = []
    for robot in (OMNI_ROBOT, REAL_ROBOT):
        with (
            tempfile.TemporaryDirectory() as folder,
            start_server(Path(folder), "--dialect", dialect, robot=robot) as running,
        ):
            server = server_under_test(running, spawn_pose="{Start Centre}", dialect=dialect)
            # The second robot is there for its effects.
            wanted = [one for one in checks if robot == OMNI_ROBOT or one.name == "stream_effects"]
            recordings += record_checks(server, wanted)
    recordings.sort(key=lambda one: len(one[1]))
    mutants = generate_mutants(one for _, exchanges in recordings for one in exchanges)
    results = (play_mutant(one, server, recordings) for one in mutants)
    return [one for one in results if one is not None]
