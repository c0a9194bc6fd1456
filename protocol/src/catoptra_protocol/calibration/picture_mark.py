"""Which pictures a calibration file is of: Catoptra's own mark, a comment or a field.

All formats describe right-handed cameras, so a file says nothing of the hand of the pictures that
it was made from, and a mirrored world fits as well. Files of other programs have no mark.
"""

from __future__ import annotations

import re

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.picture import Picture

_FIELD = "catoptra_picture"
_MARK = re.compile(rf'"?{_FIELD}"?\s*[:=]\s*"?(\w+)')


def mark_picture(text: str, picture: Picture) -> str:
    """Text of a file with the mark: a field of a JSON object, a comment of others."""
    if text.startswith("{"):
        # The last field: Basalt's reader takes the first one, whatever its name.
        return f'{text.rstrip()[:-1].rstrip()},\n  "{_FIELD}": "{picture.value}"\n}}\n'
    comment = f"# {_FIELD}: {picture.value}\n"
    if text.startswith("%YAML"):
        # OpenCV wants the head as the first bytes, and no comment before the document.
        head, separator, body = text.partition("---\n")
        return head + separator + comment + body
    return comment + text


def read_picture_mark(text: str, file: str) -> Picture | None:
    """Hand of the pictures that a file describes; None for files without a mark.

    Raises:
        ConfigError: The mark names no hand.
    """
    found = _MARK.search(text)
    if found is None:
        return None
    try:
        return Picture(found[1])
    except ValueError as error:
        names = " or ".join(picture.value for picture in Picture)
        raise ConfigError(
            SourceLocation(file), key=_FIELD, value=found[1], expected=names
        ) from error
