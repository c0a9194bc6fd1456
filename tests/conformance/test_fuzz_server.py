"""The fuzzer of a live server: a few seconds, and its evaluation. Timing is left to `make fuzz`."""

from __future__ import annotations

from pathlib import Path

import pytest

from conformance.fuzz_clients import ReferenceClientLog
from conformance.fuzz_server import evaluate_memory, evaluate_reference_client, fuzz_server
from helpers.requirement_results import RequirementResult


def test_server_when_clients_send_malformed_input_runs_and_serves_the_reference_client(
    tmp_path: Path,
) -> None:
    runs, reached, memory, _, frames, _ = fuzz_server(tmp_path, seconds=3.0, seed=2)
    assert [one for one in (runs, reached, memory, frames) if not one.is_met] == []


def test_memory_when_its_growth_exceeds_the_bound_fails() -> None:
    assert evaluate_memory([80.0, 100.0, 90.0]).is_met
    assert not evaluate_memory([80.0, 300.0, 90.0]).is_met


@pytest.fixture
def reference_log() -> ReferenceClientLog:
    """Log of an undisturbed reference client."""
    return ReferenceClientLog([0.2 * number for number in range(100)], 20, 20)


def passes(log: ReferenceClientLog) -> list[bool]:
    """Whether cycle and frames meet their requirements."""
    results: list[RequirementResult] = evaluate_reference_client(log)
    return [result.is_met for result in results]


def test_reference_client_when_undisturbed_passes(reference_log: ReferenceClientLog) -> None:
    assert passes(reference_log) == [True, True]


def test_reference_client_when_its_status_is_late_fails(reference_log: ReferenceClientLog) -> None:
    times_s = reference_log.status_s
    reference_log.status_s = [t + 0.1 * (i % 10 == 0) for i, t in enumerate(times_s)]
    assert passes(reference_log) == [False, True]


def test_reference_client_with_a_fault_or_without_frames_fails(
    reference_log: ReferenceClientLog,
) -> None:
    reference_log.faults.append("frame 3 after 5")
    assert passes(reference_log) == [True, False]
    reference_log.faults.clear()
    reference_log.stream_frames = 0
    assert passes(reference_log) == [True, False]
