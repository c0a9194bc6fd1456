"""Text files whose size is checked before their content is in memory."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation


def read_text_file(path: Path, *, kind: str, max_bytes: int) -> str:
    """Text of a UTF-8 file, with or without a byte order mark.

    Args:
        path: the file.
        kind: kind of file for error messages, such as `ini file`.
        max_bytes: size above which the file is rejected; no more is read.

    Raises:
        ConfigError: for an unreadable or oversized file, or a byte that is no UTF-8.
    """
    where = SourceLocation(str(path))
    try:
        with path.open("rb") as file:
            # One byte beyond the limit, instead of the size that the system states: devices and
            # pipes state none.
            data = file.read(max_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise ConfigError(
            where, key="file", value=str(path), expected=f"a readable {kind} ({error})"
        ) from error
    if len(data) > max_bytes:
        expected = f"a smaller {kind}: at most {max_bytes} bytes"
        raise ConfigError(where, key="file", value=str(path), expected=expected)
    return _decode(data, where)


def _decode(data: bytes, where: SourceLocation) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = SourceLocation(where.file, data.count(b"\n", 0, error.start) + 1)
        byte = repr(data[error.start : error.end])
        raise ConfigError(line, key="file", value=byte, expected="UTF-8 text") from error
