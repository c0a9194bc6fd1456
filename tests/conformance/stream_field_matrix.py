"""The matrix of generated mutants of stream and page: which checks notice each field's.

Run: make mutations, or, in tests/, `python -m conformance.stream_field_matrix`. Each check is
recorded once against our own server; a mutant is played against the recordings that it concerns,
until a check notices it. Documents of the page are changed on their way from a live server.
Exits with 0 if at least 95 % of the mutants of the stream are noticed, and 90 % of the page's.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from conformance.check import Check, ServerUnderTest
from conformance.page_checks import DOCUMENT_CHECKS, PAGE_CHECKS
from conformance.server_setup import server_under_test
from conformance.stream_checks import STREAM_CHECKS
from conformance.stream_message_mutations import FieldMutant, generate_mutants, is_changed
from conformance.stream_replay import Exchange, record_check, replay_check
from conformance.suite import Outcome, play_check
from helpers.configs import OMNI_ROBOT, ROBOTS
from helpers.live_page import read_page_link
from helpers.server_process import start_server

# A robot whose file names all effects: for their check alone, since its frames are large.
_REAL_ROBOT = ROBOTS / "p2at_omni_real.ini"
# Some numbers in the page's documents have no second source.
_NEEDED_PARTS = {"stream": 0.95, "page": 0.9}

Recording = tuple[Check, list[Exchange]]


@dataclass(frozen=True, slots=True)
class FieldResult:
    """Check that notices a mutant; empty if none does."""

    mutant: FieldMutant
    noticed_by: str
    reason: str


@contextmanager
def serve_with_page(dialect: str = "ut2004", robot: Path = OMNI_ROBOT) -> Iterator[ServerUnderTest]:
    """Our own server with its page, for the length of a block."""
    options = ("--dialect", dialect, "--view", "0")
    with (
        tempfile.TemporaryDirectory() as folder,
        start_server(Path(folder), *options, robot=robot) as running,
    ):
        server = server_under_test(running, spawn_pose="{Start Centre}", dialect=dialect)
        page = "127.0.0.1", int(read_page_link(running).rpartition(":")[2])
        yield replace(server, addresses={**server.addresses, "page": page})


def record_checks(server: ServerUnderTest, checks: Sequence[Check]) -> list[Recording]:
    """Recordings of the checks that pass, and pass when they are replayed.

    Raises:
        AssertionError: A check fails.
    """
    recordings = []
    for check in checks:
        result, exchanges = record_check(check, server)
        assert result.outcome is not Outcome.FAILED, f"{check.name}: {result.reason}"
        if result.outcome is Outcome.PASSED and exchanges:
            replayed = replay_check(check, server, exchanges)
            assert replayed.outcome is Outcome.PASSED, f"{check.name}: {replayed.reason}"
            recordings.append((check, exchanges))
    return recordings


def play_field_mutants(
    server: ServerUnderTest, recordings: Sequence[Recording], every: int = 1
) -> list[FieldResult]:
    """Results of the mutants of recordings.

    Args:
        server: The recorded server.
        recordings: Recordings of checks.
        every: Plays one of so many mutants.
    """
    short_first = sorted(recordings, key=lambda one: len(one[1]))
    mutants = generate_mutants(one for _, exchanges in short_first for one in exchanges)
    results = (_play_mutant(one, server, short_first) for one in mutants[::every])
    return [one for one in results if one is not None]


def play_document_mutants(server: ServerUnderTest, every: int = 1) -> list[FieldResult]:
    """Results of the mutants of the page's documents, from a live server."""
    documents: dict[str, Exchange] = {}

    def keep(path: str, document: dict[str, Any]) -> dict[str, Any]:
        documents[path] = _as_exchange(path, document)
        return document

    for check in DOCUMENT_CHECKS:
        result = play_check(check, replace(server, change_document=keep))
        assert result.outcome is Outcome.PASSED, f"{check.name}: {result.reason}"
    results = []
    for mutant in generate_mutants(documents.values())[::every]:
        before = [documents[mutant.kind]]
        if is_changed(before, mutant.apply(before)):
            results.append(_play_document_mutant(mutant, server))
    return results


def summarize(results: Sequence[FieldResult]) -> str:
    """Numbers of mutants by kind of message, and those that no check notices."""
    kinds = Counter(one.mutant.kind for one in results)
    missed = [one for one in results if not one.noticed_by]
    unnoticed = Counter(one.mutant.kind for one in missed)
    rows = [f"{kind}: {kinds[kind] - unnoticed[kind]} of {kinds[kind]}" for kind in kinds]
    return "\n".join([*rows, *(f"unnoticed: {one.mutant}" for one in missed)])


def main() -> int:
    """Play all mutants, in both dialects; exit status."""
    is_right = True
    for dialect, port in itertools.product(("ut2004", "udk"), ("stream", "page")):
        results = play_port(port, dialect)
        noticed = sum(bool(one.noticed_by) for one in results)
        print(f"{port}, {dialect}: {noticed} of {len(results)} mutants of fields are noticed")
        print(summarize(results))
        is_right &= noticed >= _NEEDED_PARTS[port] * len(results)
    return 0 if is_right else 1


def play_port(port: str, dialect: str) -> list[FieldResult]:
    """Results of all mutants of a port."""
    checks = {"stream": STREAM_CHECKS, "page": PAGE_CHECKS}[port]
    with serve_with_page(dialect, _REAL_ROBOT) as server:
        effects = [one for one in checks if one.name.endswith("_effects")]
        recordings = record_checks(server, effects)
    with serve_with_page(dialect) as server:
        recordings += record_checks(
            server, [one for one in checks if one not in (*effects, *DOCUMENT_CHECKS)]
        )
        documents = play_document_mutants(server) if port == "page" else []
    return [*play_field_mutants(server, recordings), *documents]


def _play_mutant(
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


def _play_document_mutant(mutant: FieldMutant, server: ServerUnderTest) -> FieldResult:
    def change(path: str, document: dict[str, Any]) -> dict[str, Any]:
        changed = mutant.apply([_as_exchange(path, document)])[0]
        return dict(changed.reply["document"])

    for check in DOCUMENT_CHECKS:
        result = play_check(check, replace(server, change_document=change))
        if result.outcome is Outcome.FAILED:
            return FieldResult(mutant, check.name, result.reason)
    return FieldResult(mutant, "", "")


def _as_exchange(path: str, document: dict[str, Any]) -> Exchange:
    return Exchange(0, {}, 0.0, 0.0, {"kind": path, "document": document}, [])


if __name__ == "__main__":
    sys.exit(main())
