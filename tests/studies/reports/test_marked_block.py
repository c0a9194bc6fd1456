from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.reports import replace_block

TEXT = "before\n<!-- cost: begin, written by make cost -->\nold\n<!-- cost: end -->\nafter\n"


def test_block_is_replaced_and_the_rest_stays(tmp_path: Path) -> None:
    path = tmp_path / "README.md"
    path.write_text(TEXT)
    replace_block(path, "cost", "new\ntable")
    assert path.read_text() == TEXT.replace("old", "new\ntable")


def test_block_when_written_twice_is_the_same(tmp_path: Path) -> None:
    path = tmp_path / "README.md"
    path.write_text(TEXT)
    replace_block(path, "cost", "new")
    once = path.read_text()
    replace_block(path, "cost", "new")
    assert path.read_text() == once


@pytest.mark.parametrize("missing", ["<!-- cost: begin", "<!-- cost: end -->"])
def test_file_when_a_mark_is_missing_is_rejected_and_unchanged(
    tmp_path: Path, missing: str
) -> None:
    path = tmp_path / "README.md"
    path.write_text(TEXT.replace(missing, ""))
    before = path.read_text()
    with pytest.raises(CatoptraError, match="no marks for the table"):
        replace_block(path, "cost", "new")
    assert path.read_text() == before
