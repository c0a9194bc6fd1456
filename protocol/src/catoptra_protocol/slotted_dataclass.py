"""Not the standard library's `dataclass`: a cheaper one, for classes with slots.

`slotted_dataclass` is exported as `dataclass` too, the one name by which type checkers know the
decorator. It lacks `order`, keyword-only fields (`kw_only`), `InitVar`, and the text of an object
that contains itself: no class here needs them. `field`, `fields`, `replace`, `asdict`, patterns,
copies, pickles and FrozenInstanceError work as with `dataclasses`.

`dataclasses` compiles six functions for each frozen class, 0.8 ms; in the 280 classes that a server
imports this was a third of its start. Here one function is compiled, `__init__`, with the first
instance; the methods for comparison, text and protection are closures over the names of the fields:
0.15 ms per class, half of it with the first instance. Later instances take 0.4 instead of 1.1
microseconds, since `__init__` calls the slots' own setters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import MISSING, Field, FrozenInstanceError
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeVar

_T = TypeVar("_T")


def slotted_dataclass(
    *, frozen: bool = False, slots: bool, eq: bool = True
) -> Callable[[type[_T]], type[_T]]:
    """Decorator that makes a class with slots from its annotations.

    Args:
        frozen: Assignments to fields raise FrozenInstanceError; hashable where `eq`.
        slots: True; the keyword is that of the standard library, which type checkers know.
        eq: Compare by fields instead of by identity.

    Raises:
        TypeError: Without slots.
    """
    if not slots:
        raise TypeError("a data class without slots: take dataclasses.dataclass")

    def decorate(plain: type[_T]) -> type[_T]:
        own = plain.__dict__
        # Else `dataclasses` makes a text of the signature, which takes 3 ms.
        plain.__doc__ = plain.__doc__ or plain.__qualname__
        # Without methods: the fields and the class with slots alone, 0.04 ms.
        cls: type[Any] = dataclasses.dataclass(init=False, repr=False, eq=False, slots=True)(plain)
        fields = dataclasses.fields(cls)
        methods = {"__init__": _make_first_init(cls, fields), "__repr__": _describe}
        methods |= _comparison_methods(fields, frozen=frozen) if eq else {}
        methods |= _FROZEN_METHODS if frozen else {}
        for name, method in methods.items():
            # A class with an __eq__ of its own and no __hash__ has the entry None.
            if own.get(name) is None:
                setattr(cls, name, method)
        return cls

    return decorate


def _make_first_init(cls: type[Any], fields: tuple[Field[Any], ...]) -> Callable[..., None]:
    """The method of the first instance, which compiles the one of all others."""

    # Most of a server's classes, such as messages, have no instance at the first frame.
    def compile_and_call(self: object, /, *arguments: object, **named: object) -> None:
        init = _make_init(cls, fields)
        if cls.__init__ is compile_and_call:
            cls.__init__ = init
        init(self, *arguments, **named)

    return compile_and_call


def _make_init(cls: type[Any], fields: tuple[Field[Any], ...]) -> Callable[..., None]:
    """The method that sets all fields, in their order, and calls `__post_init__`."""
    names: dict[str, Any] = {"MISSING": MISSING}
    parameters, lines = ["self"], []
    for field in fields:
        name, value = field.name, field.name
        names[f"set_{name}"] = getattr(cls, name).__set__
        if field.default_factory is not MISSING:
            names[f"make_{name}"] = field.default_factory
            parameter = f"{name}=MISSING"
            value = f"make_{name}()" + (f" if {name} is MISSING else {name}" if field.init else "")
        elif field.default is not MISSING:
            names[f"default_{name}"] = field.default
            parameter = f"{name}=default_{name}"
            value = name if field.init else f"default_{name}"
        elif field.init:
            parameter = name
        else:
            continue  # set by __post_init__
        if field.init:
            parameters.append(parameter)
        lines.append(f"set_{name}(self, {value})")
    if hasattr(cls, "__post_init__"):
        lines.append("self.__post_init__()")
    # A signature can be had from a text alone; with *args each instance would take twice as long.
    exec(f"def __init__({', '.join(parameters)}):\n " + "\n ".join(lines or ["pass"]), names)
    init: Callable[..., None] = names["__init__"]
    # As errors name it, such as for a missing argument.
    init.__qualname__ = f"{cls.__qualname__}.__init__"
    return init


def _comparison_methods(fields: tuple[Field[Any], ...], *, frozen: bool) -> dict[str, Any]:
    """Methods that compare by fields; an object that can change has no hash."""
    compared = [field.name for field in fields if field.compare]
    # attrgetter returns a tuple from two names on.
    values = attrgetter(*compared) if len(compared) > 1 else _make_tuple_getter(compared)

    def equals(self: object, other: object) -> bool:
        return values(self) == values(other) if type(other) is type(self) else NotImplemented

    def hash_values(self: object) -> int:
        return hash(values(self))

    return {"__eq__": equals, "__hash__": hash_values if frozen else None}


def _make_tuple_getter(names: list[str]) -> Callable[[object], tuple[Any, ...]]:
    if not names:
        return lambda instance: ()
    # Without a loop: channels of frames, keys of many tables, have one field, and hash in a fifth
    # of the time.
    get = attrgetter(*names)
    return lambda instance: (get(instance),)


def _describe(self: Any) -> str:
    shown = (f for f in dataclasses.fields(self) if f.repr)
    values = ", ".join(f"{field.name}={getattr(self, field.name)!r}" for field in shown)
    return f"{type(self).__qualname__}({values})"


def _refuse_assignment(self: object, name: str, value: object) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_deletion(self: object, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


def _get_state(self: Any) -> list[Any]:
    return [getattr(self, field.name) for field in dataclasses.fields(self)]


def _set_state(self: Any, state: list[Any]) -> None:
    for field, value in zip(dataclasses.fields(self), state, strict=True):
        object.__setattr__(self, field.name, value)


_FROZEN_METHODS = {
    "__setattr__": _refuse_assignment,
    "__delattr__": _refuse_deletion,
    # Copies and pickles set slots by assignments without these.
    "__getstate__": _get_state,
    "__setstate__": _set_state,
}

# Type checkers know the standard decorator by its name alone: they see that one.
if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:
    dataclass = slotted_dataclass
