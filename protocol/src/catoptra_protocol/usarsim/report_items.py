"""Several parts of one type in a report: the lists of UT2004 and UDK.

UT2004 writes one line with a block per part, which holds all its pairs: `{Name F1 Range 4.5604}`.
UDK writes a block per pair: `{Name F1} {Range 4.5604}`, in readings with a line per part; both are
read.
"""

from __future__ import annotations

from collections.abc import Iterable

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.grammar import Message, Pairs, split_groups, split_words


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
