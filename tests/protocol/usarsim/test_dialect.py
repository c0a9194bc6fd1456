"""Names of the dialects, and the blocks of UDK without a space."""

from __future__ import annotations

from catoptra_protocol.usarsim.grammar import UDK_BLOCKS_WITHOUT_SPACE, Dialect, format_line


def test_dialect_is_found_by_its_option_text() -> None:
    assert [Dialect("ut2004"), Dialect("udk")] == list(Dialect)


def test_blocks_of_udk_without_a_space_are_written_so() -> None:
    pairs = (("Orientation", "0,0,0"), ("Mount", "P3AT"), ("Name", "F2"))
    assert format_line("GEO", pairs, UDK_BLOCKS_WITHOUT_SPACE) == (
        b"GEO {Orientation 0,0,0}{Mount P3AT} {Name F2}\r\n"
    )
