"""The landmark files that come with the client: `four_legged_2006` stands for its own copy.

A server elsewhere draws the same landmarks; its files need not be here.
"""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation

_BUNDLED_DIR = Path(__file__).parent / "configs" / "landmarks"


def find_landmark_file(name_or_path: str) -> Path:
    """Return the file that a command line means: a path, or the bare name of a shipped one.

    A path need not exist: who reads it complains. Raises ConfigError for a name that is not there.
    """
    path = Path(name_or_path)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    shipped = {file.stem: file for file in sorted(_BUNDLED_DIR.glob("*.csv"))}
    if name_or_path not in shipped:
        known = ", ".join(shipped)
        expected = f"a csv file, or a name that comes with the client: {known}"
        raise ConfigError(
            SourceLocation(name_or_path), key="file", value=name_or_path, expected=expected
        )
    return shipped[name_or_path]
