"""Every model of the two tables rejects parameters that are no finite numbers, and crossed tables.

A new model is tried as all others are: a lens by the parameters of its first hard case, a mirror by
its line of `helpers.mirror_checks.MIRROR_EXAMPLES`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.mirrors import MIRRORS
from helpers.mirror_checks import MIRROR_EXAMPLES
from stability.catalogue import load


def make_models() -> dict[str, Any]:
    """A possible model of each kind, by name."""
    models: dict[str, Any] = {name: MIRRORS[name](*MIRROR_EXAMPLES[name]) for name in MIRRORS}
    for case in load("wide_angle"):
        given = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in case.inputs.items()
            if key not in ("t", "ratio")
        }
        models.setdefault(f"lens {case.formula}", LENSES[case.formula](**given))
    assert {f"lens {name}" for name in LENSES} <= set(models)
    return models


MODELS = make_models()


def spoil(value: Any, wrong: float) -> Iterator[Any]:
    """A parameter with a wrong number, at the begin, in the middle and at the end of a table."""
    if not isinstance(value, tuple):
        yield wrong
        return
    for index in sorted({0, len(value) // 2, len(value) - 1}):
        yield (*value[:index], wrong, *value[index + 1 :])


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_parameter_that_is_no_finite_number_is_rejected(name: str, wrong: float) -> None:
    model = MODELS[name]
    for field in dataclasses.fields(model):
        for value in spoil(getattr(model, field.name), wrong):
            with pytest.raises(DomainError):
                dataclasses.replace(model, **{field.name: value})


@pytest.mark.parametrize(
    ("name", "field"),
    [
        (name, field.name)
        for name, model in MODELS.items()
        for field in dataclasses.fields(model)
        if "table" in name or name == "profile"
        if isinstance(getattr(model, field.name), tuple)
    ],
)
def test_table_that_turns_back_is_rejected(name: str, field: str) -> None:
    model = MODELS[name]
    first, second, third, *rest = getattr(model, field)
    for crossed in ((first, third, second, *rest), (first, second, second, *rest)):
        with pytest.raises(DomainError):
            dataclasses.replace(model, **{field: crossed})
