"""Data classes with slots behave as those of the standard library."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, field
from typing import Any, ClassVar

import pytest

from catoptra_protocol.slotted_dataclass import dataclass, slotted_dataclass

Decorator = Callable[..., Any]


def make_wheel(decorator: Decorator, **options: bool) -> Any:
    """A class with every kind of field, by one of the two decorators."""

    @decorator(slots=True, **options)
    class Wheel:
        """A wheel."""

        kinds: ClassVar[int] = 2
        radius_m: float
        name: str = "left"
        marks: list[int] = field(default_factory=list)
        model: str = field(default="", compare=False, repr=False)
        turns: int = field(init=False, default=3)
        tags: list[str] = field(init=False, default_factory=list)
        area: float = field(init=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "area", math.pi * self.radius_m**2)

    return Wheel


@dataclass(frozen=True, slots=True)
class Pair:
    """Two members, of a module, so that it can be pickled."""

    left: int
    right: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Single:
    """One member."""

    value: float


@dataclass(frozen=True, slots=True)
class Empty:
    """No member."""


OURS = make_wheel(slotted_dataclass, frozen=True)
STANDARD = make_wheel(dataclasses.dataclass, frozen=True)
ARGUMENTS: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
    ((0.5,), {}),
    ((0.5, "right"), {}),
    ((0.5,), {"marks": [1], "model": "x"}),
    ((), {}),
    ((0.5, "a", [], "b", 1), {}),
    ((0.5,), {"turns": 1}),
    ((0.5,), {"radius_m": 1.0}),
]


def describe(call: Callable[[], object]) -> str:
    """The text of a result, or of the error."""
    try:
        return repr(call())
    except Exception as error:
        return f"{type(error).__name__}: {error}"


@pytest.mark.parametrize(("args", "kwargs"), ARGUMENTS)
def test_instance_is_made_or_rejected_as_by_the_standard_library(
    args: tuple[Any, ...], kwargs: dict[str, Any]
) -> None:
    ours = describe(lambda: OURS(*args, **kwargs))
    assert ours == describe(lambda: STANDARD(*args, **kwargs))
    assert "Wheel" in ours


@pytest.mark.parametrize("make", [OURS, STANDARD])
def test_instance_when_compared_leaves_out_fields_that_are_not_compared(make: Any) -> None:
    assert make(0.5, model="a", marks=[1]) == make(0.5, model="b", marks=[1])
    assert make(0.5) != make(0.6)
    assert make(0.5) != "wheel"


def test_instance_when_frozen_is_hashed_by_its_compared_fields() -> None:
    assert hash(Pair(1, (2,))) == hash(Pair(1, (2,)))
    assert len({Pair(1), Pair(1), Pair(2), Single(1.0), Single(1.0), Empty(), Empty()}) == 4
    with pytest.raises(TypeError, match="unhashable"):
        hash(OURS(0.5))


def test_single_field_that_is_no_number_equals_itself_as_in_a_tuple() -> None:
    assert Single(math.nan) == Single(math.nan)
    assert Single(math.nan) != Single(float("nan"))


def test_classes_with_equal_fields_differ() -> None:
    assert Pair(1) != dataclasses.make_dataclass("Pair", ["left", "right"])(1, ())
    assert Empty() == Empty()


def test_instance_when_frozen_refuses_assignments_and_deletions() -> None:
    pair = Pair(1)
    for name in ("left", "unknown"):
        with pytest.raises(FrozenInstanceError, match=f"cannot assign to field '{name}'"):
            setattr(pair, name, 2)
        with pytest.raises(FrozenInstanceError, match=f"cannot delete field '{name}'"):
            delattr(pair, name)
    assert pair == Pair(1)


def test_instance_when_not_frozen_changes_and_has_no_hash() -> None:
    wheel = make_wheel(slotted_dataclass)(0.5)
    wheel.name = "right"
    assert wheel.name == "right"
    assert wheel != type(wheel)(0.5)
    assert wheel == type(wheel)(0.5, "right")
    with pytest.raises(AttributeError):
        wheel.unknown = 1
    with pytest.raises(TypeError, match="unhashable"):
        hash(wheel)


def test_instance_without_comparison_equals_itself_alone() -> None:
    make = make_wheel(slotted_dataclass, frozen=True, eq=False)
    wheel = make(0.5)
    assert wheel == wheel
    assert wheel != make(0.5)
    assert {wheel: 1}[wheel] == 1


@pytest.mark.parametrize(
    "clone", [copy.copy, copy.deepcopy, lambda p: pickle.loads(pickle.dumps(p))]
)
def test_clone_equals_its_original(clone: Callable[[Pair], Pair]) -> None:
    assert clone(Pair(1, (2, 3))) == Pair(1, (2, 3))


def test_functions_of_the_standard_library_accept_the_class() -> None:
    pair = dataclasses.replace(Pair(1), right=(2,))
    assert dataclasses.asdict(pair) == {"left": 1, "right": (2,)}
    assert [f.name for f in dataclasses.fields(Pair)] == ["left", "right"]
    match pair:
        case Pair(left, right):
            assert (left, right) == (1, (2,))


def test_default_of_a_factory_is_made_for_each_instance() -> None:
    assert OURS(0.5).marks is not OURS(0.5).marks
    assert OURS(0.5).tags is not OURS(0.5).tags
    assert OURS.kinds == 2


def test_methods_of_the_class_itself_stay() -> None:
    @dataclass(frozen=True, slots=True)
    class Named:
        name: str

        def __repr__(self) -> str:
            return self.name

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Named) and other.name.lower() == self.name.lower()

    assert repr(Named("A")) == "A"
    assert Named("A") == Named("a")
    assert hash(Named("A")) == hash(Named("A"))


def test_class_without_slots_is_rejected() -> None:
    with pytest.raises(TypeError, match="without slots"):
        slotted_dataclass(slots=False)
