"""Parts of mutations of the control port: changes of one line of text, for all or for some lines.

A change gets a line with its end and returns what is passed on: a line, several, or nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from conformance.mutation import ConnectionMutation, MutateBytes

ChangeLine = Callable[[str], str]
Connect = Callable[[], ConnectionMutation]


def of_replies(change: ChangeLine) -> Connect:
    """Mutation of the server's lines."""
    return lambda: ConnectionMutation(mutate_reply=_on_bytes(change))


def of_replies_with_state(make_change: Callable[[], ChangeLine]) -> Connect:
    """Mutation of the server's lines that remembers earlier ones of the connection."""
    return lambda: ConnectionMutation(mutate_reply=_on_bytes(make_change()))


def of_commands(change: ChangeLine) -> Connect:
    """Mutation of the client's lines."""
    return lambda: ConnectionMutation(mutate_request=_on_bytes(change))


def where(pattern: str, change: ChangeLine) -> ChangeLine:
    """Change of the lines that begin like a pattern; the others pass."""
    return lambda line: change(line) if re.match(pattern, line) else line


def drop(line: str) -> str:
    """No line."""
    return ""


def substitute(pattern: str, replacement: str) -> ChangeLine:
    """Replacement of all matches."""
    return lambda line: re.sub(pattern, replacement, line)


def scale(block: str, factors: tuple[float, ...], template: str = "%.4f") -> ChangeLine:
    """Numbers of a block times factors, in turn."""

    def scale_block(found: re.Match[str]) -> str:
        numbers = found[2].split(",")
        scaled = [float(x) * factors[i % len(factors)] for i, x in enumerate(numbers)]
        return f"{{{found[1]} {','.join(template % x for x in scaled)}}}"

    return lambda line: re.sub(rf"\{{({block}) (-?\d[^{{}} ]*)\}}", scale_block, line)


def reorder_ranges(reorder: Callable[[list[str]], list[str]]) -> ChangeLine:
    """Another list of the ranges of a scan."""

    def change(found: re.Match[str]) -> str:
        return "{Range " + ",".join(reorder(found[1].split(","))) + "}"

    return where("SEN .*RangeScanner", lambda line: re.sub(r"\{Range ([^}]*)\}", change, line))


def freeze(pattern: str) -> Callable[[], ChangeLine]:
    """The first match of a connection in the place of all later ones."""

    def make_change() -> ChangeLine:
        first: list[str] = []

        def freeze_match(found: re.Match[str]) -> str:
            first[:] = first or [found[0]]
            return first[0]

        return lambda line: re.sub(pattern, freeze_match, line)

    return make_change


def split_items(line: str) -> str:
    """A line for each item of a list."""
    head, *items = re.split(r" (?=\{Name )", line.rstrip("\r\n"))
    return "".join(f"{head} {item}\r\n" for item in items)


def swap_sides(line: str) -> str:
    """Left for Right and Right for Left."""
    names = {"Left": "Right", "Right": "Left"}
    return re.sub(r"\{(Left|Right) ", lambda found: f"{{{names[found[1]]} ", line)


def move_block_first(line: str, block: str) -> str:
    """A block before all others."""
    found = re.search(rf" \{{{block} [^}}]*\}}", line)
    if found is None:
        return line
    word, _, rest = line.replace(found[0], "", 1).partition(" ")
    return f"{word}{found[0]} {rest}"


def _on_bytes(change: ChangeLine) -> MutateBytes:
    return lambda data: change(data.decode("latin-1")).encode("latin-1")
