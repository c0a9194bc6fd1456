"""Processes whose libraries are pinned to an instruction set from their start.

NumPy chooses its code while it is loaded: scenes that it computes differ in their last bits between
AVX2 and AVX-512, and so do pictures. What a data set is compared by is computed in such a process.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.drawing_environment import pinning_variables

T = TypeVar("T")


def start_pinned_process(
    instruction_set: str, target: Callable[..., None], *args: object
) -> tuple[Any, Connection]:
    """Start a process that gets a connection as its last argument.

    Returns:
        The process, and this end of the connection, which the end of the process closes.
    """
    # Spawned: a fork has this process's NumPy, and neither its threads nor its OpenGL context.
    context = multiprocessing.get_context("spawn")
    own, others = context.Pipe()
    with _set_environment(pinning_variables(instruction_set)):
        process = context.Process(target=target, args=(*args, others), daemon=True)
        process.start()
    # Closed here, so that the end of the process closes the pipe.
    others.close()
    return process, own


@contextmanager
def _set_environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Environment variables for processes that are started in a block."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def run_in_pinned_process(instruction_set: str, function: Callable[..., T], *args: object) -> T:
    """Result of a function, called in a process of its own.

    Args:
        instruction_set: Instruction set of the process.
        function: A function that the process can import.
        args: Its arguments.

    Raises:
        CatoptraError: As the function does, or the process has ended without a result.
    """
    process, connection = start_pinned_process(instruction_set, _answer, function, args)
    try:
        result, error = connection.recv()
    except EOFError:
        process.join()
        raise CatoptraError(
            f"a process that reads the recipe has ended: exit status {process.exitcode}"
        ) from None
    finally:
        connection.close()
    process.join()
    if error:
        raise CatoptraError(error)
    answer: T = result
    return answer


def _answer(function: Callable[..., T], args: tuple[object, ...], connection: Connection) -> None:
    try:
        connection.send((function(*args), ""))
    except CatoptraError as error:
        connection.send((None, str(error)))
