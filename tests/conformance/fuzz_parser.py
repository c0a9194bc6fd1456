"""What is fuzzed: a parser, how it is fed, what its cases are made of, and what became of them."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

DATA = Path(__file__).parent / "data"

_LONGEST_RANDOM = 64
_PIECES = (
    *(b"{", b"}", b" ", b",", b"\r", b"\n", b"\0", b"\xff", b"-", b".", b"1e308", b"-1e-308"),
    *(b"9" * 400, b"nan", b"inf", b"{Name ", b"{Type ", b"{Link ", b"{Location ", b"OK", b"U"),
)

Case = Callable[[bytes], bool]
Mutate = Callable[[random.Random, Sequence[bytes]], bytes]


class BrokenError(Exception):
    """A parser kept more than its limit, or does not read what it wrote."""


def mutated(chance: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Return a case: one in eight of random bytes, the others a seed with a few changes."""
    if chance.random() < 0.125:
        return chance.randbytes(chance.randrange(_LONGEST_RANDOM))
    data = bytearray(chance.choice(seeds))
    for _ in range(chance.randrange(1, 5)):
        place = chance.randrange(len(data) + 1)
        match chance.randrange(5):
            case 0:
                data[place:place] = chance.choice(_PIECES)
            case 1:
                del data[place : place + chance.randrange(1, 12)]
            case 2:
                data[place : place + 1] = chance.randbytes(1)
            case 3:
                data += data[place : place + 40]
            case _:
                del data[place:]
    return bytes(data)


@dataclass(slots=True)
class Parser:
    """One parser: how to feed it a case, what to mutate, and the tally.

    feed returns whether the case was accepted, and raises if the parser is broken. mutate: makes a
    case from the seeds. every: of how many of its turns it takes one, for those that read files.
    """

    name: str
    feed: Case
    seeds: tuple[bytes, ...]
    mutate: Mutate = mutated
    every: int = 1
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0


def seeds(channel: str) -> tuple[bytes, ...]:
    """Return the vectors of a channel, long ones cut so that a case takes microseconds."""
    return tuple(path.read_bytes()[:600] for path in sorted((DATA / channel).glob("*.bytes")))


def hold(is_so: bool, otherwise: str) -> None:
    """Raise BrokenError if something is not so."""
    if not is_so:
        raise BrokenError(otherwise)
