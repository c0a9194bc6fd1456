"""The text of the control protocol: bytes to lines, lines to messages, and back, in two dialects.

`WORD {Name Value} {Name Value}` up to a CR or a LF. The reader accepts the union of both USARSim
parsers (SPEC.md 3); the writer keeps to the subset that every known client reads. No input raises
here. Text is Latin-1, so that one byte is one character and any byte survives.

The dialects are UT2004 (2004-2009, that of the paper) and UDK (2010 on). Each report writes its own
form in either, and readers accept both; here are only the differences that reports share. Several
parts of one type: UT2004 writes one line with a block per part, which holds all its pairs, `{Name
F1 Range 4.5604}`; UDK a block per pair, `{Name F1} {Range 4.5604}`, in readings with a line per
part. Source: MessageParser.uc, ParsedMessage.uc of USARSim (UDK); the GameBots2004 parser.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from enum import Enum

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_LINE_BLOCKS, MAX_LINE_BYTES
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.value_format import format_fixed_point

Pairs = tuple[tuple[str, str], ...]

# The strings of UnrealScript are ISO-8859-1 on the wire, and every byte survives a round trip.
_ENCODING = "latin-1"

_LINE_END = re.compile(rb"[\r\n]")
# No braces inside: no source nests blocks, and a block that is never closed matches nothing.
_BLOCK = re.compile(r"\{([^{}]*)\}")
# Control characters of Latin-1, line ends among them: they end lines and drive terminals.
CONTROL_CHARACTERS = re.compile(r"[\x00-\x1f\x7f-\x9f]")
# Characters that would end a block or a line inside a value; a space ends a name, too.
_UNSAFE_IN_VALUE = re.compile(rf"[{{}}]|{CONTROL_CHARACTERS.pattern}")
_UNSAFE_IN_NAME = re.compile(rf"[{{}} ]|{CONTROL_CHARACTERS.pattern}")


@dataclass(frozen=True, slots=True)
class Message:
    """A parsed line."""

    word: str
    """First word, upper-cased."""
    pairs: Pairs = ()
    """Name and value of each block, in order, as sent."""

    def get(self, name: str) -> str | None:
        """Value of the first pair with this name, in any case; None if missing."""
        lowered = name.lower()
        return next((value for key, value in self.pairs if key.lower() == lowered), None)

    def __str__(self) -> str:
        """Line for a log, with unprintable characters escaped."""
        text = " ".join((self.word, *map(_format_block, self.pairs)))
        # isprintable rather than ASCII: Latin-1 names stay readable in logs.
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def parse_message(line: str) -> Message:
    """Parse a line. Total: every text is a message, if only one with an unknown word.

    The word ends at the first space (GameBots) or brace (UDK). A block is `{...}` without braces
    inside; an unclosed block is ignored, so that half a number is never executed. `{Text}` has an
    empty name and the value `Text`, as in UnrealScript; `{}` is ignored. A line of more than
    MAX_LINE_BLOCKS blocks is its word alone.
    """
    word = line.partition("{")[0].strip(" ").partition(" ")[0].upper()
    texts = _BLOCK.findall(line)
    # All or none: the first blocks alone would be another command.
    if len(texts) > MAX_LINE_BLOCKS:
        return Message(word)
    blocks = (text.strip(" ") for text in texts)
    return Message(word, tuple(_parse_block(block) for block in blocks if block))


def format_line(
    word: str, pairs: Iterable[tuple[str, str]] = (), without_space: frozenset[str] = frozenset()
) -> bytes:
    """Encode a line with CR LF.

    Args:
        word: First word.
        pairs: Name and value of each block.
        without_space: Names of the blocks without a space before their brace.

    Raises:
        LocalProtocolError: A text would break the line, or is not Latin-1.
    """
    pairs = tuple(pairs)
    for name, value in (("", word), *pairs):
        # A brace or a line end in a name of a client would forge blocks or lines of other robots.
        if _UNSAFE_IN_NAME.search(name) or _UNSAFE_IN_VALUE.search(value):
            raise LocalProtocolError(
                f"{word}: {{{name} {value}}} cannot be sent: names must be free of spaces, "
                "names and values of braces, line ends and other control characters"
            )
    blocks = (("" if pair[0] in without_space else " ") + _format_block(pair) for pair in pairs)
    text = "".join((word, *blocks)) + "\r\n"
    try:
        return text.encode(_ENCODING)
    except UnicodeEncodeError as error:
        raise LocalProtocolError(f"{word}: {text!r} is not Latin-1 text") from error


def split_words(value: str) -> list[str]:
    """Words of a value, separated by spaces."""
    return [word for word in value.split(" ") if word]


def split_groups(message: Message, key: str) -> list[Message]:
    """Runs of blocks that each begin with this name; blocks before the first run are ignored.

    A joint begins with its name, a link with its number.
    """
    groups: list[list[tuple[str, str]]] = []
    for pair in message.pairs:
        if pair[0].lower() == key.lower():
            groups.append([])
        if groups:
            groups[-1].append(pair)
    return [Message(message.word, tuple(run)) for run in groups]


class LineReader:
    """Parser of the lines in a byte stream, in any segmentation; buffers at most one line.

    A line longer than `MAX_LINE_BYTES` is dropped up to its end; the next one is read as usual.
    """

    def __init__(self) -> None:
        self._line = bytearray()
        self._is_overlong = False

    def receive(self, data: bytes) -> list[str]:
        """Lines completed by these bytes, without their ends; blank lines are ignored."""
        # CR LF ends a line and a blank one behind it, so one pattern serves all line ends.
        *ended, rest = _LINE_END.split(data)
        lines = [self._finish_line(piece) for piece in ended]
        self._append(rest)
        return [line for line in lines if line]

    def _finish_line(self, piece: bytes) -> str:
        self._append(piece)
        line = self._line.decode(_ENCODING)
        self._line.clear()
        self._is_overlong = False
        return line

    def _append(self, piece: bytes) -> None:
        self._is_overlong = self._is_overlong or len(self._line) + len(piece) > MAX_LINE_BYTES
        # The line stays overlong until its end: a tail must not pass for a line of its own.
        if self._is_overlong:
            self._line.clear()
        else:
            self._line += piece


def _parse_block(block: str) -> tuple[str, str]:
    name, _, value = block.partition(" ")
    return (name, value.strip(" ")) if value else ("", name)


def _format_block(pair: tuple[str, str]) -> str:
    name, value = pair
    return f"{{{name} {value}}}" if name else f"{{{value}}}"


class Dialect(Enum):
    """Dialect of the lines that a server writes."""

    UT2004 = "ut2004"
    UDK = "udk"


# UDK's source appends these blocks without a space before them: GEO's mount and all of a camera's
# CONF behind its name. Seen in real captures; SPEC-NOTES.md, Dialect.
UDK_BLOCKS_WITHOUT_SPACE = frozenset(
    {
        "Mount",
        "TextureOffsetX",
        "TextureOffsetY",
        "TextureResolutionX",
        "TextureResolutionY",
        "CameraDefFov",
        "CameraMinFov",
        "CameraMaxFov",
        "CameraFov",
    }
)


def udk_time_pairs(time_s: float | None, dialect: Dialect) -> Pairs:
    """Time of a reading that has none in UT2004: that of UDK, if known."""
    if dialect is not Dialect.UDK or time_s is None:
        return ()
    return (("Time", format_fixed_point(time_s)),)


def messages_from_items(
    word: str, head: Pairs, items: Iterable[Pairs], dialect: Dialect
) -> tuple[Message, ...]:
    """Lines that list items.

    Args:
        word: First word of each line.
        head: Pairs before the items.
        items: Pairs of each item, its Name first.
        dialect: Dialect of the lines.

    Raises:
        LocalProtocolError: A value is not one word, so it does not fit into a block of UT2004.
    """
    if dialect is Dialect.UDK:
        return tuple(Message(word, (*head, *item)) for item in items)
    return (Message(word, (*head, *map(_merge_into_block, items))),)


def items_from_message(message: Message) -> list[Message]:
    """Items of a line in either form, each as a message of its own."""
    runs = split_groups(message, "Name")
    if len(runs) == 1 and len(split_words(runs[0].pairs[0][1])) == 1:
        # The fields of a single item may precede its name.
        return [message]
    if not runs:
        has_content = any(name.lower() not in ("time", "type") for name, _ in message.pairs)
        return [message] if has_content else []
    return [_expand_block(run) for run in runs]


def _merge_into_block(item: Pairs) -> tuple[str, str]:
    for _, value in item:
        if not value or " " in value:
            raise LocalProtocolError(f"{value!r} cannot be sent in a block: it must be one word")
    (name, first), *others = item
    return name, " ".join((first, *(f"{key} {value}" for key, value in others)))


def _expand_block(run: Message) -> Message:
    """Fields of a run of blocks; those of its first block alone if that holds several."""
    (key, value), *_ = run.pairs
    name, *rest = split_words(value)
    if not rest:
        return run
    # Not strict: a trailing word without a value is ignored, as in the reference clients.
    return Message(run.word, ((key, name), *zip(rest[::2], rest[1::2], strict=False)))
