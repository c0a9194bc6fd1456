"""A generated block in a hand-written file, between two marks."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import CatoptraError


def replace_block(path: Path, name: str, text: str) -> None:
    """Replace the text between `<!-- name: begin ... -->` and `<!-- name: end -->`.

    Raises:
        CatoptraError: The file has no such marks.
    """
    before, begin, rest = path.read_text(encoding="utf-8").partition(f"<!-- {name}: begin")
    # The opening mark may go on with a note for editors, which stays.
    note, close, after_note = rest.partition("-->\n")
    _, end, after = after_note.partition(f"<!-- {name}: end -->")
    if not (begin and close and end):
        raise CatoptraError(
            f"{path}: no marks for the table: put the lines <!-- {name}: begin --> and "
            f"<!-- {name}: end --> where the table is to be"
        )
    path.write_text(f"{before}{begin}{note}{close}{text}\n{end}{after}", encoding="utf-8")
