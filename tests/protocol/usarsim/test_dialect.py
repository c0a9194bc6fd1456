"""The dialects' names, and the blocks that UDK glues."""

from __future__ import annotations

from catoptra_protocol.usarsim.dialect import UDK_BLOCKS_WITHOUT_SPACE, Dialect
from catoptra_protocol.usarsim.grammar import format_line


def test_dialect_when_named_on_a_command_line_is_found() -> None:
    assert [Dialect("ut2004"), Dialect("udk")] == list(Dialect)


def test_blocks_when_udk_glues_them_have_no_space_before() -> None:
    pairs = (("Orientation", "0,0,0"), ("Mount", "P3AT"), ("Name", "F2"))
    assert format_line("GEO", pairs, UDK_BLOCKS_WITHOUT_SPACE) == (
        b"GEO {Orientation 0,0,0}{Mount P3AT} {Name F2}\r\n"
    )
