"""Mutants of the fields of the stream's replies, generated from a recording of a check.

A mutant changes one field of all replies of a kind in one way: sign, scale, unit, another value, an
older one, that of a neighbour, or none. The fields are those of the messages; a position in a list
of records is `*`. A mutant that leaves a recording as it is does not concern its check.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.codec import dataclass_from_fields
from catoptra_protocol.stream.replies import REPLIES
from conformance.stream_replay import Exchange, Fields

Path = tuple[str | int, ...]
# Value of a message and those of the messages before in, another value out.
_Change = Callable[[Any, list[Any]], Any]

_PROSE = ("reason", "reference_plan")
# A transform's rotation; longer lists of numbers are tables.
_MAX_VECTOR = 9
# Of a sine of pi.
_ROUNDING = 1e-9
# Of a field that ends so: its usual confusion.
_UNITS = {"_rad": 180.0 / math.pi, "_m": 1000.0, "_s": 1000.0, "_ms": 1e-3, "_px": 1e-2}
_NUMBERS: dict[str, _Change] = {
    "sign": lambda value, _: -value,
    "x 1.1": lambda value, _: 1.1 * value,
    "x 10": lambda value, _: 10 * value,
}
_SEQUENCES: dict[str, _Change] = {
    "lag": lambda value, before: before[-1] if before else value,
    "frozen": lambda value, before: before[0] if before else value,
}
_COUNTS: dict[str, _Change] = {"+ 1": lambda value, _: value + 1, "x 10": _NUMBERS["x 10"]}
_TEXTS: dict[str, _Change] = {
    "empty": lambda value, _: "",
    "another": lambda value, _: f"{value}2",
}
# Of a picture's values, or a channel's.
ARRAY_CHANGES: dict[str, Callable[[Any], Any]] = {
    "upside down": lambda array: array[::-1],
    "mirrored": lambda array: array[:, ::-1],
    "x 10": lambda array: 10 * array,
    "x 1.1": lambda array: 1.1 * array,
    "sign": lambda array: -array,
    "zero": lambda array: 0 * array,
    "components exchanged": lambda array: array[..., ::-1] if array.ndim == 3 else array,
}
_CUT_OFF = "cut off"


@dataclass(frozen=True, slots=True)
class FieldMutant:
    """One change of one field."""

    kind: str
    """Kind of the replies."""
    path: Path
    name: str
    """Name of the change."""
    other: Path = ()
    """Field that it is exchanged with."""

    def __str__(self) -> str:
        path = ".".join(map(str, self.path))
        with_other = f" with {self.other[-1]}" if self.other else ""
        return f"{self.kind} {path}: {self.name}{with_other}"

    def apply(self, exchanges: Sequence[Exchange]) -> list[Exchange]:
        """A recording with the change."""
        if self.path[0] == "part":
            return _change_parts(self, exchanges)
        history: dict[Path, list[Any]] = {}
        return [
            self._change(one, history) if one.reply["kind"] == self.kind else one
            for one in exchanges
        ]

    def _change(self, exchange: Exchange, history: dict[Path, list[Any]]) -> Exchange:
        reply = copy.deepcopy(exchange.reply)
        for place in _expand(reply, self.path):
            holder = _find(reply, place[:-1])
            value = holder[place[-1]]
            if value is None:
                continue
            if self.name == "absent":
                del holder[place[-1]]
                continue
            if self.other:
                key = self.other[-1]
                is_there = not isinstance(holder, dict) or key in holder
                if is_there and holder[key] is not None:
                    holder[place[-1]], holder[key] = holder[key], value
                continue
            before = history.setdefault(place, [])
            holder[place[-1]] = _change_value(self, value, before)
            before.append(value)
        return replace(exchange, reply=reply)


def generate_mutants(exchanges: Iterable[Exchange]) -> list[FieldMutant]:
    """Mutants of all fields of the replies of recordings, each once."""
    values: dict[tuple[str, Path], list[Any]] = {}
    parts: set[Path] = set()
    for one in exchanges:
        for path, value in _walk(one.reply):
            values.setdefault((one.reply["kind"], path), []).append(value)
        if one.parts:
            parts |= {("part", name) for name, _, _ in _arrays(one)}
    mutants = [mutant for (kind, path), seen in values.items() for mutant in _of(kind, path, seen)]
    neighbours = itertools.groupby(
        (key for key, seen in values.items() if isinstance(seen[0], float)),
        lambda key: (key[0], key[1][:-1]),
    )
    for (kind, _), keys in neighbours:
        paths = [path for _, path in keys]
        mutants += [
            FieldMutant(kind, path, "exchanged", other) for path, other in itertools.pairwise(paths)
        ]
    names = (*ARRAY_CHANGES, *_SEQUENCES, _CUT_OFF)
    mutants += [FieldMutant("frame", part, name) for part in sorted(parts) for name in names]
    return mutants


def is_changed(before: Sequence[Exchange], after: Sequence[Exchange]) -> bool:
    """Whether a mutant concerns a recording: by more than the rounding of its numbers."""
    return any(
        one.parts != other.parts
        or not (_are_close(one.reply, other.reply) or _have_one_meaning(one.reply, other.reply))
        for one, other in zip(before, after, strict=True)
    )


def _have_one_meaning(one: Fields, other: Fields) -> bool:
    """Whether the reader of two messages sees no difference: a default in place of a field."""
    if one["kind"] != other["kind"] or one["kind"] not in REPLIES:
        return False
    try:
        return dataclass_from_fields(REPLIES[one["kind"]], one) == dataclass_from_fields(
            REPLIES[other["kind"]], other
        )
    except CatoptraError:
        return False


def _are_close(one: Any, other: Any) -> bool:
    if one == other:
        return True
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=0.0, abs_tol=_ROUNDING)
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_are_close(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_are_close, one, other))
    return False


def _of(kind: str, path: Path, seen: list[Any]) -> Iterator[FieldMutant]:
    value = seen[0]
    if isinstance(value, bool):
        names = ["negated"]
    elif isinstance(value, int):
        names = [*_COUNTS, *_SEQUENCES]
    elif isinstance(value, float) or _is_number(value):
        field = next((str(key) for key in reversed(path) if isinstance(key, str)), "")
        has_unit = any(field.endswith(end) for end in _UNITS)
        names = [*_NUMBERS, *(["unit"] if has_unit else []), *_SEQUENCES]
    else:
        # Texts for people may be any.
        names = ["empty"] if path[-1] in _PROSE else list(_TEXTS)
    if isinstance(path[-1], str) and path[-1] != "*":
        names.append("absent")
    for name in names:
        yield FieldMutant(kind, path, name)


def _walk(value: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Leaves of a message, those of a list of records under one path."""
    if isinstance(value, dict):
        for key, child in value.items():
            if path or key != "kind":
                yield from _walk(child, (*path, key))
    elif isinstance(value, list):
        has_numbers = value and isinstance(value[0], float | int)
        is_vector = has_numbers and len(value) <= _MAX_VECTOR
        for index, child in enumerate(value):
            yield from _walk(child, (*path, index if is_vector else "*"))
    elif value is not None:
        yield path, value


def _expand(value: Any, path: Path) -> Iterator[Path]:
    """Places of a path in a message."""
    if not path:
        yield ()
        return
    head, rest = path[0], path[1:]
    if head == "*":
        keys: Iterable[str | int] = range(len(value)) if isinstance(value, list) else ()
    elif isinstance(value, dict):
        keys = [head] if head in value else []
    else:
        keys = [head] if isinstance(value, list) and int(head) < len(value) else []
    for key in keys:
        for tail in _expand(value[key], rest):
            yield (key, *tail)


def _find(value: Any, path: Path) -> Any:
    for key in path:
        value = value[key]
    return value


def _change_value(mutant: FieldMutant, value: Any, before: list[Any]) -> Any:
    if mutant.name == "negated":
        return not value
    if mutant.name in _SEQUENCES:
        return _SEQUENCES[mutant.name](value, before)
    if mutant.name in _TEXTS:
        return _TEXTS[mutant.name](value, before)
    if mutant.name == "unit":
        field = next(str(key) for key in reversed(mutant.path) if isinstance(key, str))
        # The longest ending: `_ms` is none of `_s`.
        end = max((end for end in _UNITS if field.endswith(end)), key=len)
        return _UNITS[end] * value
    change = {**_NUMBERS, **_COUNTS}[mutant.name]
    # Numbers of a camera model are text.
    return repr(change(float(value), before)) if isinstance(value, str) else change(value, before)


def _is_number(value: Any) -> bool:
    try:
        return isinstance(value, str) and math.isfinite(float(value))
    except ValueError:
        return False


def _arrays(exchange: Exchange) -> Iterator[tuple[str, int, Any]]:
    """Uncompressed image and channels of a frame: name, part, array."""
    reply = exchange.reply
    size = reply["height_px"], reply["width_px"]
    if reply["encoding"] == "raw":
        yield "rgb", 0, np.frombuffer(exchange.parts[0], np.uint8).reshape(*size, 3)
    records = reply["labels"]["channels"] if reply["labels"] else ()
    for part, record in enumerate(records, 1):
        if record["encoding"] == "raw":
            shape = size if record["depth"] == 1 else (*size, record["depth"])
            array = np.frombuffer(exchange.parts[part], record["dtype"])
            yield record["name"], part, array.reshape(shape)


def _change_parts(mutant: FieldMutant, exchanges: Sequence[Exchange]) -> list[Exchange]:
    before: list[bytes] = []
    changed = []
    for one in exchanges:
        arrays = {name: (part, array) for name, part, array in _arrays(one)} if one.parts else {}
        if found := arrays.get(str(mutant.path[1])):
            part, array = found
            parts = list(one.parts)
            if mutant.name in ARRAY_CHANGES:
                with np.errstate(invalid="ignore", over="ignore"):
                    new = ARRAY_CHANGES[mutant.name](array).astype(array.dtype)
                data = np.ascontiguousarray(new).tobytes()
            elif mutant.name == _CUT_OFF:
                data = parts[part][:-3]
            else:
                data = _SEQUENCES[mutant.name](parts[part], before)
                before.append(parts[part])
            if len(data) == len(parts[part]) or mutant.name == _CUT_OFF:
                parts[part] = data
            one = replace(one, parts=parts)
        changed.append(one)
    return changed
