"""Keys and sections that no reader has read, with the name that was probably meant.

A misspelt name is the commonest mistake in a configuration, and a silent default the hardest to
find. In sections of this program (`[Catoptra.*]`) an unknown name is an error. Sections of USARSim
and of its engine carry keys that have no meaning here: there it is a warning, unless the user wants
all of them reported as errors.
"""

from __future__ import annotations

import difflib
import logging
from collections.abc import Iterable

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.slotted_dataclass import dataclass

log = logging.getLogger(__name__)

_OWN_PACKAGE = "catoptra"
# Ratio of equal characters, of difflib: one wrong letter of four, two swapped ones of seven.
MIN_SIMILARITY = 0.7


@dataclass(frozen=True, slots=True)
class UnknownName:
    """A key, or a section, that no reader has read."""

    key: str
    """The key; empty for a section."""
    value: str
    where: SourceLocation
    section: str
    """Name of the section, also for a key of one of its structs."""
    suggestion: str = ""
    """Known name that is most similar; empty for none."""

    @property
    def is_error(self) -> bool:
        """Whether the server does not start with it."""
        # A section of ours that nothing uses may wait for its turn, such as another mirror's.
        return is_own_section(self.section) and bool(self.key or self.suggestion)

    def describe(self) -> str:
        """The problem without its location."""
        what = f"key {self.key} is unknown" if self.key else f"nothing uses [{self.section}]"
        hint = f"; did you mean {self.suggestion}?" if self.suggestion else ""
        return f"{what} and has no effect{hint}" if self.key else f"{what}{hint}"

    def make_error(self) -> ConfigError:
        """Error with file, line, key and value."""
        known = self.suggestion or "configs/README.md lists them"
        if not self.key:
            return ConfigError(
                self.where, key="section", value=self.section, expected=f"a section in use: {known}"
            )
        question = f"did you mean {known}?" if self.suggestion else known
        return ConfigError(
            self.where,
            key=f"{self.section}.{self.key}",
            value=self.value,
            expected=f"a known key; {question}",
        )


def is_own_section(name: str) -> bool:
    """Whether a section is one of this program, not of USARSim."""
    return name.partition(".")[0].lower() == _OWN_PACKAGE


def suggest_name(name: str, known: Iterable[str], min_similarity: float = MIN_SIMILARITY) -> str:
    """Known name that is most similar to a misspelt one, regardless of case; empty for none."""
    by_lower_case = {one.lower(): one for one in known}
    found = difflib.get_close_matches(name.lower(), by_lower_case, 1, min_similarity)
    return by_lower_case[found[0]] if found else ""


def report_unknown_names(names: Iterable[UnknownName], *, is_strict: bool = False) -> None:
    """Log unknown names of USARSim's sections, and raise an error for one in our own.

    Args:
        names: Unknown names of a file that was read.
        is_strict: Raise for those of all sections.

    Raises:
        ConfigError: For the first name that is an error.
    """
    for name in names:
        if name.is_error or is_strict:
            raise name.make_error()
        log.warning("%s: %s", name.where, name.describe())
