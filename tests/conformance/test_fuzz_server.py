"""The live fuzzer: a few seconds of it, and how it judges. What is timed is left to `make fuzz`."""

from __future__ import annotations

from pathlib import Path

import pytest

from conformance.fuzz_clients import ReferenceClientLog
from conformance.fuzz_server import evaluate_memory, evaluate_reference_client, fuzz_server
from helpers.requirement_results import RequirementResult


def test_server_when_strangers_send_garbage_to_all_ports_lives_and_serves_its_guest(
    tmp_path: Path,
) -> None:
    lives, heard, memory, _, frames, _ = fuzz_server(tmp_path, seconds=3.0, seed=2)
    assert [one for one in (lives, heard, memory, frames) if not one.is_met] == []


def test_memory_when_it_grows_beyond_the_bound_does_not_hold() -> None:
    assert evaluate_memory([80.0, 100.0, 90.0]).is_met
    assert not evaluate_memory([80.0, 300.0, 90.0]).is_met


@pytest.fixture
def reference_log() -> ReferenceClientLog:
    """Return what a guest saw who had all it could wish for."""
    return ReferenceClientLog([0.2 * number for number in range(100)], 20, 20)


def passes(log: ReferenceClientLog) -> list[bool]:
    """Return whether cycle and frames hold."""
    verdicts: list[RequirementResult] = evaluate_reference_client(log)
    return [verdict.is_met for verdict in verdicts]


def test_guest_when_all_was_well_holds(guest: ReferenceClientLog) -> None:
    assert passes(guest) == [True, True]


def test_guest_when_its_status_came_late_does_not_hold(guest: ReferenceClientLog) -> None:
    guest.status_s = [t + 0.1 * (i % 10 == 0) for i, t in enumerate(guest.status_s)]
    assert passes(guest) == [False, True]


def test_guest_when_it_saw_a_fault_or_no_frames_does_not_hold(guest: ReferenceClientLog) -> None:
    guest.faults.append("frame 3 after 5")
    assert passes(guest) == [True, False]
    guest.faults.clear()
    guest.stream_frames = 0
    assert passes(guest) == [True, False]
