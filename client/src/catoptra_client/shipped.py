"""The landmark files that come with the client: `four_legged_2006` stands for its own copy.

A server elsewhere draws the same landmarks; its files need not be here.
"""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import ConfigError, Where

_SHIPPED = Path(__file__).parent / "configs" / "landmarks"


def landmark_file(text: str) -> Path:
    """Return the file that a command line means: a path, or the bare name of a shipped one.

    A path need not exist: who reads it complains. Raises ConfigError for a name that is not there.
    """
    path = Path(text)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    shipped = {file.stem: file for file in sorted(_SHIPPED.glob("*.csv"))}
    if text not in shipped:
        known = ", ".join(shipped)
        expected = f"a csv file, or a name that comes with the client: {known}"
        raise ConfigError(Where(text), key="file", value=text, expected=expected)
    return shipped[text]
