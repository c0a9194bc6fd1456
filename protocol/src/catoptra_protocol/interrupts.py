"""Ctrl-C where it must not raise an exception: while libraries are loaded, and in other processes.

It loads next to nothing, so that programs import it before all else.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

EXIT_INTERRUPTED = 130
"""Status that shells give to a process that Ctrl-C has ended."""


@contextmanager
def end_at_interrupt(program: str) -> Iterator[None]:
    """End the process by Ctrl-C at once, with one line, while a block loads libraries.

    An exception would be shown with its traceback, or be caught by a library.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return

    def end(*_: object) -> None:
        os.write(2, f"{program}: interrupted\n".encode())
        os._exit(EXIT_INTERRUPTED)

    signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def start_without_interrupts() -> Iterator[None]:
    """Keep Ctrl-C from the processes that a block starts: a terminal sends it to all of a group.

    A process that is being spawned would print the traceback of its interrupted imports.
    """
    from multiprocessing import resource_tracker

    # It starts with the first process, and unblocks the signal.
    resource_tracker.ensure_running()
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)
