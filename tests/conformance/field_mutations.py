"""Mutations of the numeric fields of messages, generated from tables of fields, for every port.

A port reads the numbers of a message into a table, `Numbers`, and writes a changed table back; here
is what happens in between. A message may list several values of one field (the ranges of a scan,
the sonars of a robot): a fault changes all of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

Numbers = dict[str, tuple[float, ...]]
"""Values by path of the field in one message, `Location.0` or `world_from_robot.3`."""
ChangeNumbers = Callable[[Numbers], Numbers]
"""Numbers of a message in, the same out; a field that is left out is absent from the message."""


class Fault(Enum):
    """What a server may do wrong with a number."""

    SIGN = "sign"
    TENTH_MORE = "x 1.1"
    TEN_TIMES = "x 10"
    TENTH = "x 0.1"
    LARGER_UNIT_NUMBER = "unit"
    """Degrees for radians, millimetres for metres, milliseconds for seconds."""
    SMALLER_UNIT_NUMBER = "inverse unit"
    """Radians for degrees, kilometres for metres."""
    LAG = "lag"
    """Value of the message before."""
    FROZEN = "frozen"
    """Value of the first message."""
    EXCHANGED = "exchanged"
    """Value of a neighbour, or, of several values in one message, in reverse order."""
    ABSENT = "absent"


class Quantity(Enum):
    """What a field measures; its value is the factor of a wrong unit."""

    LENGTH = 1000.0
    ANGLE = math.degrees(1.0)
    DURATION = 1000.0 + 1e-9  # as an alias of LENGTH the two would be one
    COUNT = 100.0


MEASURED = (
    Fault.SIGN,
    Fault.TENTH_MORE,
    Fault.TEN_TIMES,
    Fault.LARGER_UNIT_NUMBER,
    Fault.LAG,
    Fault.FROZEN,
    Fault.EXCHANGED,
    Fault.ABSENT,
)
"""Faults of a field that is reported again and again."""
CONSTANT = tuple(fault for fault in MEASURED if fault not in (Fault.LAG, Fault.FROZEN))
"""Faults of a field that is reported once on request."""


@dataclass(frozen=True, slots=True)
class NumericField:
    """A row of a table of fields."""

    message: str
    """Kind of the message, `SEN Sonar` or `frame`."""
    path: str
    """Key of `Numbers`."""
    quantity: Quantity
    neighbour: str = ""
    """Path of the field that it may be exchanged with; empty for none."""
    faults: tuple[Fault, ...] = MEASURED


@dataclass(frozen=True, slots=True)
class FieldMutation:
    """One fault of one field."""

    field: NumericField
    fault: Fault

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.field.message} {self.field.path} {self.fault.value}"

    def make_change(self) -> ChangeNumbers:
        """Change of the messages of one connection, which remembers earlier ones."""
        path, neighbour = self.field.path, self.field.neighbour
        if self.fault is Fault.ABSENT:
            return lambda numbers: {key: x for key, x in numbers.items() if key != path}
        if self.fault is Fault.EXCHANGED:
            return lambda numbers: _exchange(numbers, path, neighbour)
        change = _REMEMBERING.get(self.fault, lambda: None)() or _scale(
            _FACTORS[self.fault](self.field.quantity.value)
        )
        return lambda numbers: {**numbers, path: change(numbers[path])}


def generate_mutations(fields: Mapping[str, NumericField]) -> Iterator[FieldMutation]:
    """All faults of all fields of a table."""
    for field in fields.values():
        for fault in field.faults:
            yield FieldMutation(field, fault)


Values = tuple[float, ...]
_FACTORS: dict[Fault, Callable[[float], float]] = {
    Fault.SIGN: lambda unit: -1.0,
    Fault.TENTH_MORE: lambda unit: 1.1,
    Fault.TEN_TIMES: lambda unit: 10.0,
    Fault.TENTH: lambda unit: 0.1,
    Fault.LARGER_UNIT_NUMBER: lambda unit: unit,
    Fault.SMALLER_UNIT_NUMBER: lambda unit: 1.0 / unit,
}


def _scale(factor: float) -> Callable[[Values], Values]:
    return lambda values: tuple(factor * value for value in values)


def _remember_first() -> Callable[[Values], Values]:
    first: list[Values] = []

    def change(values: Values) -> Values:
        first.append(values)
        return first[0] if len(first[0]) == len(values) else values

    return change


def _remember_last() -> Callable[[Values], Values]:
    last: list[Values] = []

    def change(values: Values) -> Values:
        last.append(values)
        before = last[max(0, len(last) - 2)]
        return before if len(before) == len(values) else values

    return change


_REMEMBERING: dict[Fault, Callable[[], Callable[[Values], Values]]] = {
    Fault.LAG: _remember_last,
    Fault.FROZEN: _remember_first,
}


def _exchange(numbers: Numbers, path: str, neighbour: str) -> Numbers:
    if len(numbers.get(neighbour, ())) == len(numbers[path]):
        return {**numbers, path: numbers[neighbour], neighbour: numbers[path]}
    return {**numbers, path: numbers[path][::-1]}
