"""A block of a hand-written file that a program writes: what stands between two marks."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import CatoptraError


def replace_block(path: Path, name: str, text: str) -> None:
    """Replace what stands between `<!-- name: begin ... -->` and `<!-- name: end -->`.

    Raises CatoptraError for a file without these marks.
    """
    before, begin, rest = path.read_text(encoding="utf-8").partition(f"<!-- {name}: begin")
    head, close, after_head = rest.partition("-->\n")
    _, end, after = after_head.partition(f"<!-- {name}: end -->")
    if not (begin and close and end):
        raise CatoptraError(
            f"{path}: no place for the table: put the lines <!-- {name}: begin --> and "
            f"<!-- {name}: end --> where it should stand"
        )
    path.write_text(f"{before}{begin}{head}{close}{text}\n{end}{after}", encoding="utf-8")
