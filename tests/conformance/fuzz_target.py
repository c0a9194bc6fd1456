"""A parser under fuzzing: its inputs, their mutation, and the tally."""

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
    """A parser exceeded its memory limit, or does not read its own output."""


def mutate(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Test input: one in eight of random bytes, the others a seed with a few changes."""
    if rng.random() < 0.125:
        return rng.randbytes(rng.randrange(_MAX_RANDOM_BYTES))
    data = bytearray(rng.choice(seeds))
    for _ in range(rng.randrange(1, 5)):
        position = rng.randrange(len(data) + 1)
        match rng.randrange(5):
            case 0:
                data[position:position] = rng.choice(_INSERTIONS)
            case 1:
                del data[position : position + rng.randrange(1, 12)]
            case 2:
                data[position : position + 1] = rng.randbytes(1)
            case 3:
                data += data[position : position + 40]
            case _:
                del data[position:]
    return bytes(data)


@dataclass(slots=True)
class FuzzTarget:
    """One parser."""

    name: str
    feed: FeedInput
    """Parse an input; whether the parser accepted. Raises if the parser is broken."""
    seeds: tuple[bytes, ...]
    """Valid inputs to mutate."""
    mutate: Mutator = mutate
    """Makes an input from the seeds."""
    period: int = 1
    """Turns per input; above 1 for slow parsers, such as those of files."""
    num_accepted: int = 0
    num_rejected: int = 0
    total_s: float = 0.0


def load_seed_corpus(channel: str) -> tuple[bytes, ...]:
    """Vectors of a channel."""
    # Truncated, so that a case takes microseconds.
    return tuple(path.read_bytes()[:600] for path in sorted((DATA / channel).glob("*.bytes")))


def check(condition: bool, message: str) -> None:
    """Raise FuzzFailureError if a condition does not hold."""
    if not condition:
        raise FuzzFailureError(message)
