"""What is fuzzed: a parser, how it is fed, what its cases are made of, and what became of them."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

DATA = Path(__file__).parent / "data"

_MAX_RANDOM_BYTES = 64
_INSERTIONS = (
    *(b"{", b"}", b" ", b",", b"\r", b"\n", b"\0", b"\xff", b"-", b".", b"1e308", b"-1e-308"),
    *(b"9" * 400, b"nan", b"inf", b"{Name ", b"{Type ", b"{Link ", b"{Location ", b"OK", b"U"),
)

FeedInput = Callable[[bytes], bool]
Mutator = Callable[[random.Random, Sequence[bytes]], bytes]


class FuzzFailureError(Exception):
    """A parser kept more than its limit, or does not read what it wrote."""


def mutate(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Return a case: one in eight of random bytes, the others a seed with a few changes."""
    if rng.random() < 0.125:
        return rng.randbytes(rng.randrange(_MAX_RANDOM_BYTES))
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.randrange(1, 5)):
        place = rng.randrange(len(data) + 1)
        match rng.randrange(5):
            case 0:
                data[place:place] = rng.choice(_INSERTIONS)
            case 1:
                del data[place : place + rng.randrange(1, 12)]
            case 2:
                data[place : place + 1] = rng.randbytes(1)
            case 3:
                data += data[place : place + 40]
            case _:
                del data[place:]
    return bytes(data)


@dataclass(slots=True)
class FuzzTarget:
    """One parser: how to feed it a case, what to mutate, and the tally.

    feed returns whether the case was accepted, and raises if the parser is broken. mutate: makes a
    case from the seeds. every: of how many of its turns it takes one, for those that read files.
    """

    name: str
    feed: FeedInput
    seeds: tuple[bytes, ...]
    mutate: Mutator = mutate
    period: int = 1
    num_accepted: int = 0
    num_rejected: int = 0
    total_s: float = 0.0


def load_seed_corpus(channel: str) -> tuple[bytes, ...]:
    """Return the vectors of a channel, long ones cut so that a case takes microseconds."""
    return tuple(path.read_bytes()[:600] for path in sorted((DATA / channel).glob("*.bytes")))


def check(condition: bool, message: str) -> None:
    """Raise FuzzFailureError if something is not so."""
    if not condition:
        raise FuzzFailureError(message)
