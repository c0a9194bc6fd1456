"""Items of a reply in the lists of both dialects."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.usarsim.grammar import (
    Dialect,
    Message,
    items_from_message,
    messages_from_items,
    parse_message,
)

HEAD = (("Type", "Sonar"),)
F1 = (("Name", "F1"), ("Range", "4.5"))
F2 = (("Name", "F2"), ("Range", "2.0"))


def test_items_when_written_for_ut2004_share_a_line() -> None:
    (message,) = messages_from_items("SEN", HEAD, (F1, F2), Dialect.UT2004)
    assert str(message) == "SEN {Type Sonar} {Name F1 Range 4.5} {Name F2 Range 2.0}"


def test_items_when_written_for_udk_have_a_line_each() -> None:
    messages = messages_from_items("SEN", HEAD, (F1, F2), Dialect.UDK)
    assert messages == (Message("SEN", HEAD + F1), Message("SEN", HEAD + F2))


def test_items_when_empty_leave_the_head_or_no_line() -> None:
    assert messages_from_items("SEN", HEAD, (), Dialect.UT2004) == (Message("SEN", HEAD),)
    assert messages_from_items("SEN", HEAD, (), Dialect.UDK) == ()


@pytest.mark.parametrize("value", ["", "front left"])
def test_item_when_a_value_is_not_one_word_is_rejected(value: str) -> None:
    with pytest.raises(LocalProtocolError, match="one word"):
        messages_from_items("SEN", HEAD, ((("Name", value),),), Dialect.UT2004)


READ = [
    ("SEN {Type Sonar}", []),
    ("SEN {Time 1} {Type Sonar}", []),
    ("SEN {Type Sonar} {Name F1 Range 4.5} {Name F2 Range 2.0}", [F1, F2]),
    ("SEN {Type Sonar} {Name F1} {Range 4.5} {Name F2} {Range 2.0}", [F1, F2]),
    ("SEN {Type Sonar} {Name F1 Range}", [(("Name", "F1"),)]),
    ("SEN {Range 4.5} {Name F1}", [(("Range", "4.5"), ("Name", "F1"))]),
    ("SEN {Type Sonar} {Range 4.5}", [(("Type", "Sonar"), ("Range", "4.5"))]),
]


@pytest.mark.parametrize(("line", "items"), READ, ids=[line for line, _ in READ])
def test_items_when_read_are_found_in_either_form(
    line: str, items: list[tuple[tuple[str, str], ...]]
) -> None:
    assert [item.pairs for item in items_from_message(parse_message(line))] == items
