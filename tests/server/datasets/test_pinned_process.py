"""Functions in pinned processes: results, errors, deaths."""

from __future__ import annotations

import os
import signal

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.local_workers import run_in_pinned_process


def read_variable(name: str) -> str | None:
    """Variable of this process."""
    return os.environ.get(name)


def fail() -> None:
    """Raise an error of ours."""
    raise CatoptraError("recipe.ini:3: wrong")


def die() -> None:
    """End as a killed process does."""
    os.kill(os.getpid(), signal.SIGKILL)


def test_process_has_the_variables_and_this_one_has_not() -> None:
    before = os.environ.get("OPENBLAS_CORETYPE")
    assert run_in_pinned_process("avx2", read_variable, "OPENBLAS_CORETYPE") == "Haswell"
    assert os.environ.get("OPENBLAS_CORETYPE") == before


def test_error_of_the_function_is_raised_here() -> None:
    with pytest.raises(CatoptraError, match=r"recipe.ini:3: wrong"):
        run_in_pinned_process("avx2", fail)


def test_death_is_an_error() -> None:
    with pytest.raises(CatoptraError, match="has ended: exit status -9"):
        run_in_pinned_process("avx2", die)
