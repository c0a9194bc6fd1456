"""Configuration files of the repository, and edited copies of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from catoptra_server.config.section_reader import SectionReader

REPOSITORY = Path(__file__).parents[2]
CAMERAS = REPOSITORY / "configs/cameras"
ROBOTS = REPOSITORY / "configs/robots"
WORLDS = REPOSITORY / "configs/worlds"
OMNI_ROBOT = ROBOTS / "p2at_omni.ini"
FIELD = WORLDS / "four_legged_2006.ini"


@dataclass(frozen=True, slots=True)
class Edit:
    """Replacement of a text that occurs once in a file."""

    old: str
    new: str

    def apply(self, text: str) -> str:
        """A text with the replacement made."""
        assert text.count(self.old) == 1, f"{self.old!r} occurs {text.count(self.old)} times"
        return text.replace(self.old, self.new)


def write_edited_copy(original: Path, folder: Path, *edits: Edit) -> Path:
    """Write a copy of a file with edits into a folder, and return the path of the copy."""
    text = original.read_text(encoding="utf-8")
    for edit in edits:
        text = edit.apply(text)
    copy = folder / original.name
    copy.write_text(text, encoding="utf-8")
    return copy


def find_line_number(path: Path, part: str) -> int:
    """Number of the first line that contains a text."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(number for number, line in enumerate(lines, 1) if part in line)


def write_small_world(folder: Path, *lines: str) -> Path:
    """Write a world of one box and further lines, and return the path of the file."""
    path = folder / "world.ini"
    box = "Boxes=(Size=(X=1,Y=1,Z=1),Position=(X=3,Y=0,Z=-0.5))"
    path.write_text("\n".join(("[Catoptra.World]", box, *lines)) + "\n", encoding="utf-8")
    return path


def make_section(*lines: str, name: str = "A.B") -> SectionReader:
    """Reader of a section with some lines; its file is called x.ini, and its name is line 1."""
    # Clients on a Python without the server read the files above.
    from catoptra_server.config.section_reader import SectionReader
    from catoptra_server.config.unreal_ini import parse_sections

    (section,) = parse_sections("\n".join((f"[{name}]", *lines)), file="x.ini")
    return SectionReader(section.name, section.where, section.entries)
