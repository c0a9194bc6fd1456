"""Lines and messages of the control protocol, and its two dialects."""

from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_LINE_BLOCKS, MAX_LINE_BYTES
from catoptra_protocol.usarsim.grammar import (
    UDK_BLOCKS_WITHOUT_SPACE,
    Dialect,
    LineReader,
    Message,
    format_line,
    items_from_message,
    messages_from_items,
    parse_message,
    split_groups,
)

DETERMINISTIC = settings(derandomize=True, max_examples=200, deadline=None)

WORDS = st.text(st.characters(min_codepoint=33, max_codepoint=90), min_size=1, max_size=8)
NAMES = st.text(st.characters(codec="ascii", categories=["L", "N"]), max_size=6)
VALUES = st.text(
    st.characters(codec="latin-1", exclude_characters="{}", exclude_categories=["Cc"]), min_size=1
)


@pytest.mark.parametrize("end", [b"\r\n", b"\n", b"\r", b"\n\r", b"\r\n\n", b"\r\r\r"])
def test_line_reader_with_any_known_line_end_returns_each_line_once(end: bytes) -> None:
    reader = LineReader()
    assert reader.receive(b"DRIVE" + end + b"INIT" + end) == ["DRIVE", "INIT"]


@pytest.mark.parametrize("data", [b"", b"\r\n", b"\n\n\n", b"\r\r\n\n"])
def test_line_reader_ignores_blank_lines(data: bytes) -> None:
    assert LineReader().receive(data) == []


def test_line_reader_buffers_an_unfinished_line() -> None:
    reader = LineReader()
    assert reader.receive(b"DRIVE {Left 1.0} {Right 1.0}" * 100) == []
    assert reader.receive(b"\n") == ["DRIVE {Left 1.0} {Right 1.0}" * 100]


def test_line_reader_accepts_a_line_of_the_maximum_length() -> None:
    line = b"x" * MAX_LINE_BYTES
    assert LineReader().receive(line + b"\n") == [line.decode()]


@pytest.mark.parametrize("count", [1, 7, 70_000])
def test_line_reader_when_a_line_is_too_long_drops_it_and_reads_the_next(count: int) -> None:
    reader = LineReader()
    data = b"x" * (MAX_LINE_BYTES + 1) + b"\nGETSTARTPOSES\n"
    size = -(-len(data) // count)
    pieces = (data[i : i + size] for i in range(0, len(data), size))
    assert [line for x in pieces for line in reader.receive(x)] == ["GETSTARTPOSES"]


@DETERMINISTIC
@given(st.lists(st.binary(max_size=40)))
def test_line_reader_in_any_segmentation_returns_the_same(chunks: list[bytes]) -> None:
    reader = LineReader()
    cut = [line for chunk in chunks for line in reader.receive(chunk)]
    assert cut == LineReader().receive(b"".join(chunks))


@DETERMINISTIC
@given(st.binary())
def test_line_reader_of_any_bytes_returns_lines_without_ends(data: bytes) -> None:
    lines = LineReader().receive(data)
    assert all(line and "\r" not in line and "\n" not in line for line in lines)


PARSED = [
    # The regression examples inside the UDK parser.
    ("TestCommand {test1 1} {test2 2}", Message("TESTCOMMAND", (("test1", "1"), ("test2", "2")))),
    ("Com1{BasMan Rulez} {Hello 2}", Message("COM1", (("BasMan", "Rulez"), ("Hello", "2")))),
    (
        "Com2     {  WithWhitespaces      88     } {        More  whitespaces }    ",
        Message("COM2", (("WithWhitespaces", "88"), ("More", "whitespaces"))),
    ),
    # No space is needed anywhere.
    ("Com1{A b}{C d}", Message("COM1", (("A", "b"), ("C", "d")))),
    # A value without a name, and nothing at all.
    ("SET {Word}", Message("SET", (("", "Word"),))),
    ("SET {} { }", Message("SET")),
    # Spaces are trimmed, tabs are not.
    ("SET {A \tb }", Message("SET", (("A", "\tb"),))),
    # A block that is not closed, or closed twice, adds nothing to its sound neighbours.
    ("DRIVE {Left 1.0} {Right 2", Message("DRIVE", (("Left", "1.0"),))),
    ("DRIVE {Left {Right 2}} stray", Message("DRIVE", (("Right", "2"),))),
    # The word ends at a space, as in GameBots, or at a brace, as in UDK.
    ("DRIVE }{Left 3}", Message("DRIVE", (("Left", "3"),))),
    ("DRIVE now {Left 3}", Message("DRIVE", (("Left", "3"),))),
    ("", Message("")),
    ("   ", Message("")),
    ("{A b}", Message("", (("A", "b"),))),
]


@pytest.mark.parametrize(("line", "message"), PARSED, ids=[line for line, _ in PARSED])
def test_parse_message_of_loose_forms_finds_word_and_pairs(line: str, message: Message) -> None:
    assert parse_message(line) == message


def test_get_when_a_name_repeats_in_any_case_returns_the_first() -> None:
    message = parse_message("INIT {Classname A} {CLASSNAME B}")
    assert message.get("ClassName") == "A"
    assert message.get("Name") is None


@DETERMINISTIC
@given(st.text())
def test_parse_message_of_any_text_never_raises_and_is_printable(line: str) -> None:
    message = parse_message(line)
    assert message.get("Type") is None or "type" in line.lower()
    assert str(message).isprintable()


@DETERMINISTIC
@given(WORDS, st.lists(st.tuples(NAMES, VALUES)))
def test_format_line_when_parsed_again_is_the_message(
    word: str, pairs: list[tuple[str, str]]
) -> None:
    message = parse_message(f"{word} " + " ".join(f"{{{n} {v}}}" for n, v in pairs))
    line = format_line(message.word, message.pairs)
    assert line.endswith(b"\r\n")
    assert [parse_message(text) for text in LineReader().receive(line)] == [message]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("A", "b}"),
        ("A", "{b"),
        ("A", "b\r"),
        ("A", "b\nDRIVE"),
        ("A b", "c"),
        ("A}", "b"),
        ("A", "\x1b[2J"),
        ("A\x9b", "b"),
        ("A", "b\x7f"),
    ],
)
def test_format_line_when_text_would_break_the_line_raises(name: str, value: str) -> None:
    with pytest.raises(LocalProtocolError, match="cannot be sent"):
        format_line("INIT", [(name, value)])


def test_format_line_when_text_is_not_latin_1_raises() -> None:
    with pytest.raises(LocalProtocolError, match="Latin-1"):
        format_line("INIT", [("Name", "機械")])


def test_str_when_text_cannot_be_printed_escapes_it() -> None:
    assert str(Message("SET", (("A", "\x1b[2J\x00"),))) == r"SET {A \x1b[2J\x00}"


def test_groups_are_the_runs_that_a_key_begins() -> None:
    message = parse_message("X {Value 0} {Link 1} {Value 5} {link 2} {Link 3} {A b}")
    assert [group.pairs for group in split_groups(message, "Link")] == [
        (("Link", "1"), ("Value", "5")),
        (("link", "2"),),
        (("Link", "3"), ("A", "b")),
    ]
    assert split_groups(message, "Name") == []


def test_parse_message_of_too_many_blocks_is_the_word_alone() -> None:
    blocks = MAX_LINE_BLOCKS * "{A b}"
    assert len(parse_message("X " + blocks).pairs) == MAX_LINE_BLOCKS
    assert parse_message("X " + blocks + "{A b}") == Message("X")


@pytest.mark.parametrize("piece", ["{", "}", "{}", "{ ", "{a ", "a ", " ", "x", "{a b}", "{a b} "])
def test_parse_message_of_64_kb_takes_linear_time(piece: str) -> None:
    line = piece * (MAX_LINE_BYTES // len(piece))
    started_s = time.process_time()
    parse_message(line)
    assert time.process_time() - started_s < 0.05  # 2 ms on an idle core


def test_dialect_is_found_by_its_option_text() -> None:
    assert [Dialect("ut2004"), Dialect("udk")] == list(Dialect)


def test_blocks_of_udk_without_a_space_are_written_so() -> None:
    pairs = (("Orientation", "0,0,0"), ("Mount", "P3AT"), ("Name", "F2"))
    assert format_line("GEO", pairs, UDK_BLOCKS_WITHOUT_SPACE) == (
        b"GEO {Orientation 0,0,0}{Mount P3AT} {Name F2}\r\n"
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
