"""Names that a user may have meant."""

from __future__ import annotations

import pytest

from catoptra_protocol.names import list_names, suggest_name


@pytest.mark.parametrize(
    ("name", "suggestion"),
    [
        ("Polygon", "Polygons"),
        ("polygons ", "Polygons"),
        ("MetresPerUnits", "MetresPerUnit"),
        ("MetersPerUnit", "MetresPerUnit"),
        ("Rim", ""),
        ("bDebug", ""),
    ],
)
def test_suggestion_is_the_most_similar_known_name(name: str, suggestion: str) -> None:
    assert suggest_name(name, ["K", "C", "Polygons", "MetresPerUnit", "RimAngle"]) == suggestion


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("field", "field_tour, mixed; did you mean field_tour?"),
        ("FIELD_TUOR", "field_tour, mixed; did you mean field_tour?"),
        ("x", "field_tour, mixed"),
        ("feild_tour", "field_tour, mixed; did you mean field_tour?"),
        ("", "field_tour, mixed"),
    ],
)
def test_list_has_all_names_and_the_nearest(name: str, text: str) -> None:
    assert list_names(name, ["field_tour", "mixed", "mixed"]) == text


def test_list_of_one_name_does_not_repeat_it() -> None:
    assert list_names("Center", ["Centre"]) == "Centre"


def test_list_of_no_names_says_so() -> None:
    assert list_names("x", []) == "none"


def test_list_of_many_names_is_short_and_still_has_the_nearest() -> None:
    text = list_names("nmae77", (f"name{index}" for index in range(100)))
    assert text.endswith("name49 and 50 more; did you mean name77?")
