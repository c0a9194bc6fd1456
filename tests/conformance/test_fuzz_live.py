"""The live fuzzer: a few seconds of it, and how it judges. What is timed is left to `make fuzz`."""

from __future__ import annotations

from pathlib import Path

import pytest

from conformance.fuzz_live import fuzz_live, judged_guest, judged_memory
from conformance.fuzz_peers import Tally
from helpers.verdicts import Verdict


def test_server_when_strangers_send_garbage_to_all_ports_lives_and_serves_its_guest(
    tmp_path: Path,
) -> None:
    lives, heard, memory, _, frames, _ = fuzz_live(tmp_path, seconds=3.0, seed=2)
    assert [one for one in (lives, heard, memory, frames) if not one.holds] == []


def test_memory_when_it_grows_beyond_the_bound_does_not_hold() -> None:
    assert judged_memory([80.0, 100.0, 90.0]).holds
    assert not judged_memory([80.0, 300.0, 90.0]).holds


@pytest.fixture
def guest() -> Tally:
    """Return what a guest saw who had all it could wish for."""
    return Tally([0.2 * number for number in range(100)], 20, 20)


def holds(guest: Tally) -> list[bool]:
    """Return whether cycle and frames hold."""
    verdicts: list[Verdict] = judged_guest(guest)
    return [verdict.holds for verdict in verdicts]


def test_guest_when_all_was_well_holds(guest: Tally) -> None:
    assert holds(guest) == [True, True]


def test_guest_when_its_status_came_late_does_not_hold(guest: Tally) -> None:
    guest.status_s = [t + 0.1 * (i % 10 == 0) for i, t in enumerate(guest.status_s)]
    assert holds(guest) == [False, True]


def test_guest_when_it_saw_a_fault_or_no_frames_does_not_hold(guest: Tally) -> None:
    guest.faults.append("frame 3 after 5")
    assert holds(guest) == [True, False]
    guest.faults.clear()
    guest.stream_frames = 0
    assert holds(guest) == [True, False]
