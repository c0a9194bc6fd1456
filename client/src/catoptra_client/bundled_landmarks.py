"""Landmark files bundled with the client, such as `four_legged_2006`.

The client's copies describe the same landmarks as the server's, whose files need not be on this
machine.

`catoptra_client/configs/landmarks` is a link to `configs/`, as the server's is: one copy in the
repository, real files in the wheels.
"""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation

_BUNDLED_DIR = Path(__file__).parent / "configs" / "landmarks"


def find_landmark_file(name_or_path: str) -> Path:
    """Landmark file of a command-line argument: a path, or the bare name of a bundled file.

    A path is returned even if the file is missing; reading reports the error.

    Raises:
        ConfigError: a bare name matches no bundled file.
    """
    path = Path(name_or_path)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    # A bare word without suffix or directory can only mean a bundled file: list those on failure.
    bundled = {file.stem: file for file in sorted(_BUNDLED_DIR.glob("*.csv"))}
    if name_or_path not in bundled:
        known = ", ".join(bundled)
        expected = f"a csv file, or a name that comes with the client: {known}"
        raise ConfigError(
            SourceLocation(name_or_path), key="file", value=name_or_path, expected=expected
        )
    return bundled[name_or_path]
