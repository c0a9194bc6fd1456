"""Names of ini files that are sent to clients in lines of the control protocol."""

from __future__ import annotations

import re

from catoptra_protocol.limits import MAX_NAME_CHARS

# Printable Latin-1 without space and braces, which delimit names in a line of the protocol.
_WIRE_NAME = re.compile(rf"[!-z|~\xa1-\xff]{{1,{MAX_NAME_CHARS}}}")
WIRE_NAME_EXPECTED = "one word without spaces and braces: it is sent to clients"


def is_wire_name(text: str) -> bool:
    """Whether a text fits a line of the protocol as a name."""
    return _WIRE_NAME.fullmatch(text) is not None
