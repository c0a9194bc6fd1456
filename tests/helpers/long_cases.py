"""Cases of a proof of which `make test` runs one of each kind, and `make long-test` the others."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Any

import pytest


def quick_cases(cases: Iterable[Any], *quick: int) -> list[Any]:
    """Arguments of `pytest.mark.parametrize`.

    Args:
        cases: Values of one parameter, or tuples of several.
        quick: Positions of the cases of `make test`.
    """
    values = list(cases)
    assert max(quick) < len(values)
    return [
        value
        if index in quick
        else pytest.param(
            *(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.long
        )
        for index, value in enumerate(values)
    ]


def one_of_each(cases: Iterable[Any], kind: Callable[[Any], Hashable]) -> list[Any]:
    """Values of `pytest.mark.parametrize`; of each kind the first one is a case of `make test`."""
    values = list(cases)
    kinds = [kind(value) for value in values]
    return quick_cases(values, *(kinds.index(one) for one in set(kinds)))
