"""`catoptra-server --version`: version, system and the engine that traces, in one line."""

from __future__ import annotations

import platform
from importlib import metadata

from catoptra_server.render.trace.kernel.library import (
    AUTO,
    KernelDevice,
    KernelUnavailableError,
    choose_instruction_set,
)


def describe_version() -> str:
    """Version of the server, Python, system, and the kernel's instruction set or its lack."""
    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return f"catoptra-server {metadata.version('catoptra-server')} ({system}; {_describe_kernel()})"


def _describe_kernel() -> str:
    instruction_set = choose_instruction_set(AUTO)
    try:
        # Opened, since a library that is there may not load.
        KernelDevice(instruction_set, 1).close()
    except KernelUnavailableError as error:
        return str(error)
    return f"kernel: {instruction_set}"
