"""The page's rows pass; rows notice a sample of the generated mutants of stream and page."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from conformance.check import ServerUnderTest
from conformance.page_checks import PAGE_CHECKS
from conformance.stream_checks import STREAM_CHECKS
from conformance.stream_field_matrix import (
    play_document_mutants,
    play_field_mutants,
    record_checks,
    serve_with_page,
    summarize,
)
from conformance.stream_message_mutations import FieldMutant, generate_mutants, is_changed
from conformance.stream_replay import Exchange
from conformance.suite import Outcome, play_check

# `make mutations` plays all.
SAMPLED_CHECKS = ("stream_cameras", "stream_notes", "stream_spawn", "stream_bound")
SAMPLE_EVERY = 9


@pytest.fixture(scope="module")
def page_server() -> Iterator[ServerUnderTest]:
    with serve_with_page() as server:
        yield server


def exchanges_of(*replies: dict[str, object]) -> list[Exchange]:
    """Recording of these replies."""
    return [Exchange(1, {"id": 1}, 0.0, 0.1, reply, []) for reply in replies]


def test_our_server_passes_each_row_of_the_page(page_server: ServerUnderTest) -> None:
    results = [play_check(check, page_server) for check in PAGE_CHECKS]
    assert [one for one in results if one.outcome is not Outcome.PASSED] == []


def test_mutants_of_recorded_checks_are_noticed(page_server: ServerUnderTest) -> None:
    checks = [check for check in STREAM_CHECKS if check.name in SAMPLED_CHECKS]
    recordings = record_checks(page_server, checks)
    results = play_field_mutants(page_server, recordings, every=SAMPLE_EVERY)
    assert len(results) > 20
    assert sum(bool(one.noticed_by) for one in results) >= 0.7 * len(results), summarize(results)


def test_mutants_of_documents_are_noticed(page_server: ServerUnderTest) -> None:
    results = play_document_mutants(page_server, every=13)
    assert len(results) > 3
    assert sum(bool(one.noticed_by) for one in results) >= 0.7 * len(results), summarize(results)


def test_mutants_when_generated_change_one_field_each() -> None:
    first = {"kind": "pixel", "theta_rad": 1.0, "range_m": 2.0, "list": [{"on": True}]}
    recording = exchanges_of(first, {**first, "theta_rad": 1.5})
    mutants = generate_mutants(recording)
    by_name = {str(one): one for one in mutants}
    assert len(by_name) == len(mutants)
    expected = {
        "pixel theta_rad: sign": [-1.0, -1.5],
        "pixel theta_rad: unit": [pytest.approx(57.29578), pytest.approx(85.94367)],
        "pixel theta_rad: frozen": [1.0, 1.0],
        "pixel theta_rad: exchanged with range_m": [2.0, 2.0],
        "pixel theta_rad: absent": [None, None],
    }
    for name, values in expected.items():
        changed = by_name[name].apply(recording)
        assert [one.reply.get("theta_rad") for one in changed] == values
        assert is_changed(recording, changed)
    negated = by_name["pixel list.*.on: negated"].apply(recording)
    assert negated[0].reply["list"] == [{"on": False}]


def test_mutant_of_a_constant_when_frozen_changes_nothing() -> None:
    recording = exchanges_of({"kind": "ok", "id": 3}, {"kind": "ok", "id": 3})
    frozen = FieldMutant("ok", ("id",), "frozen")
    assert not is_changed(recording, frozen.apply(recording))
