"""Values of one key: operators, order, and the number of comparisons."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import SourceLocation
from catoptra_server.config.unreal_ini import Entry, EntryList

WHERE = SourceLocation("x.ini", 1)


def make_list(*lines: tuple[str, str]) -> EntryList:
    """List after lines of (operator, value)."""
    entries = EntryList()
    for operator, value in lines:
        entries.apply(Entry("K", value, operator, WHERE))
    return entries


@pytest.mark.parametrize(
    ("lines", "values"),
    [
        ([("", "1"), ("", "1")], ["1", "1"]),
        ([("", "1"), (".", "1")], ["1", "1"]),
        ([("+", "1"), ("+", "1"), ("+", "2")], ["1", "2"]),
        ([("", "1"), ("", "2"), ("", "1"), ("-", "1"), ("", "3")], ["2", "3"]),
        ([("", "1"), ("-", "1"), ("+", "1")], ["1"]),
        ([("-", "1"), ("", "1")], ["1"]),
        ([("", "1"), ("!", ""), ("", "2")], ["2"]),
    ],
)
def test_list_has_the_values_that_the_lines_leave(
    lines: list[tuple[str, str]], values: list[str]
) -> None:
    entries = make_list(*lines)
    assert [entry.value for entry in entries] == values
    assert (len(entries), entries.last.value) == (len(values), values[-1])


def test_list_when_emptied_is_false() -> None:
    assert not make_list(("", "1"), ("-", "1"))


class CountedText(str):
    """Text that counts comparisons."""

    num_comparisons = 0

    __hash__ = str.__hash__

    def __eq__(self, other: object) -> bool:
        CountedText.num_comparisons += 1
        return str.__eq__(self, other)


def test_list_of_2000_values_compares_each_a_few_times() -> None:
    CountedText.num_comparisons = 0
    added = [("+", CountedText(n)) for n in range(1000)]
    removed = [("-", CountedText(n)) for n in range(1000)]
    assert len(make_list(*added, *removed)) == 0
    # A list that is searched for every line compares a million times.
    assert CountedText.num_comparisons <= 4000
