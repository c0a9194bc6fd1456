"""Generated mutations change one field; the checks of a tour notice them and pass without them."""

from __future__ import annotations

from pathlib import Path

import pytest

from conformance.control_field_matrix import (
    MIN_NOTICED,
    find_mutations,
    judge_mutations,
    record_own_tour,
)
from conformance.control_field_mutations import generate_line_mutations, mutate_lines
from conformance.control_tour_checks import TOUR_CHECKS, VISIT_CHECKS, find_contradiction
from conformance.field_mutations import Fault, FieldMutation, NumericField, Quantity

ODOMETRY = "SEN {Type Odometry} {Name Odometry} {Pose 0.5000,0.2500,-1.0000}"
GPS = "SEN {Type GPS} {Name GPS} {Latitude 39,30.0000,N} {Longitude 77,12.0000,W} {Fix 1}"
SONAR = "SEN {Time 1.0000} {Type Sonar} {Name F1 Range 1.0000} {Name F2 Range 2.0000}"
# A part of the matrix of `make mutations`.
STRIDE = 24


@pytest.mark.parametrize(
    ("line", "name", "expected"),
    [
        (ODOMETRY, "SEN Odometry Pose.2 sign", ODOMETRY.replace("-1.0", "1.0")),
        (ODOMETRY, "SEN Odometry Pose.0 exchanged", ODOMETRY.replace("0.5000,0.25", "0.2500,0.50")),
        (ODOMETRY, "SEN Odometry Pose.1 absent", ODOMETRY.replace("0.2500,", "")),
        (ODOMETRY, "SEN Odometry Pose.2 unit", ODOMETRY.replace("-1.0000", "-57.2958")),
        (GPS, "SEN GPS Latitude sign", GPS.replace("N}", "S}")),
        (
            SONAR,
            "SEN Sonar Range x 1.1",
            SONAR.replace("Range 1.0", "Range 1.1").replace("2.0", "2.2"),
        ),
        (SONAR, "SEN Sonar Range exchanged", f"{SONAR[:46]}2{SONAR[47:69]}1{SONAR[70:]}"),
        (SONAR, "SEN Sonar Time absent", SONAR.replace(" {Time 1.0000}", "")),
    ],
)
def test_mutation_when_applied_to_a_line_changes_its_field_alone(
    line: str, name: str, expected: str
) -> None:
    mutations = {one.name: one for one in generate_line_mutations([line])}
    assert mutate_lines(mutations[name])(line) == expected


@pytest.mark.parametrize(
    ("fault", "expected"),
    [(Fault.LAG, [1.0, 1.0, 2.0]), (Fault.FROZEN, [1.0, 1.0, 1.0])],
    ids=lambda value: str(value),
)
def test_mutation_when_it_remembers_sends_an_earlier_value(
    fault: Fault, expected: list[float]
) -> None:
    field = NumericField("frame", "time_s", Quantity.DURATION)
    change = FieldMutation(field, fault).make_change()
    assert [change({"time_s": (x,)})["time_s"][0] for x in (1.0, 2.0, 3.0)] == expected


@pytest.mark.parametrize("dialect", ["ut2004", "udk"])
def test_tour_of_our_server_passes_and_mutations_of_it_are_noticed(
    tmp_path: Path, dialect: str
) -> None:
    tour = record_own_tour(tmp_path, dialect)
    assert find_contradiction(tour, {**TOUR_CHECKS, **VISIT_CHECKS}) == ""
    mutations = find_mutations(tour)
    judged = judge_mutations(tour, mutations[::STRIDE])
    unnoticed = [name for name, reason in judged.items() if not reason]
    # Of a part, 95 % of the whole may be fewer.
    assert len(unnoticed) <= 2.0 * (1.0 - MIN_NOTICED) * len(judged), unnoticed
