"""Processes whose libraries are pinned, so that the bytes of samples follow from the recipe alone.

NumPy and OpenBLAS choose code by the processor, and last bits differ: between AVX2 and AVX-512 in
scenes that NumPy computes, and so in pictures. A data set pins one instruction set for both and for
the kernel, by variables that a process needs before NumPy is loaded. The digest by which a data
set is compared is computed in such a process. A worker whose code, libraries or processor differ
refuses, instead of drawing other bytes.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import platform
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module, metadata
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

import catoptra_protocol
import catoptra_server
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.shards import hash_file
from catoptra_server.datasets import png_files
from catoptra_server.render.trace.kernel.library import choose_instruction_set, kernel_library_path

_T = TypeVar("_T")
# Features that NumPy may choose code for, by the instruction set that first has them; features
# of later ones are disabled. By prefix, since NumPy 2.4 has new names.
_LATER_FEATURES = {
    "avx512": (),
    "avx2": ("AVX512", "X86_V4"),
    "sse4.2": ("AVX", "FMA", "F16C", "X86_V3", "X86_V4"),
}
_BLAS_CORES = {"avx512": "SkylakeX", "avx2": "Haswell", "sse4.2": "Nehalem"}


class WorkerRefusedError(CatoptraError):
    """A worker has other code, libraries or files than the driver, or another processor."""


def run_in_pinned_process(instruction_set: str, function: Callable[..., _T], *args: object) -> _T:
    """Result of a function, called in a process of its own.

    Args:
        instruction_set: Instruction set of the process.
        function: A function that the process can import.
        args: Arguments of the function.

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
    answer: _T = result
    return answer


def start_pinned_process(
    instruction_set: str, target: Callable[..., None], *args: object
) -> tuple[Any, Connection]:
    """Start a process that gets a connection as the last argument.

    Returns:
        The process, and this end of the connection, which the end of the process closes.
    """
    # Spawned: a fork has this process's NumPy, but no threads and no OpenGL context.
    context = multiprocessing.get_context("spawn")
    own, others = context.Pipe()
    with _set_environment(pinning_variables(instruction_set)):
        process = context.Process(target=target, args=(*args, others), daemon=True)
        process.start()
    # Closed here, so that the end of the process closes the pipe.
    others.close()
    return process, own


def pinning_variables(instruction_set: str) -> dict[str, str]:
    """Environment variables of a worker process, to be set before the start."""
    disabled = [name for name in _numpy_features() if _is_later(name, instruction_set)]
    return {
        "NPY_DISABLE_CPU_FEATURES": " ".join(disabled),
        "OPENBLAS_CORETYPE": _BLAS_CORES[instruction_set],
        "OPENBLAS_NUM_THREADS": "1",
    }


@cache
def describe_environment(instruction_set: str) -> dict[str, str]:
    """Versions of code and libraries, to be equal in all workers of a data set.

    Raises:
        KernelUnavailableError: The kernel is missing.
    """
    libraries = {
        name: metadata.version(name)
        for name in ("numpy", "opencv-contrib-python-headless", "pillow", "trimesh")
    }
    return {
        "code_version": catoptra_server.__version__,
        "code_sha256": _hash_code(),
        "kernel_sha256": hash_file(kernel_library_path(instruction_set)),
        "machine": platform.machine(),
        # Has sines and cosines of its own.
        "libc": " ".join(platform.libc_ver()) or platform.system(),
        "png_encoder": png_files.ENCODER,
        **libraries,
    }


def require_environment(expected: Mapping[str, str], instruction_set: str) -> None:
    """Check that this process draws the bytes of a driver with an environment.

    Raises:
        WorkerRefusedError: Processor, code or a library differs; names what.
    """
    _require_processor(instruction_set)
    try:
        own = describe_environment(instruction_set)
    except (CatoptraError, metadata.PackageNotFoundError) as error:
        raise WorkerRefusedError(str(error)) from error
    different = [
        f"{name} {own.get(name, 'none')} instead of {value}"
        for name, value in expected.items()
        if own.get(name) != value
    ]
    if different:
        raise WorkerRefusedError(f"this worker differs: {', '.join(different)}")


def _require_processor(instruction_set: str) -> None:
    """Raise WorkerRefusedError where this process must not draw with an instruction set."""
    try:
        choose_instruction_set(instruction_set)
    except DomainError as error:
        raise WorkerRefusedError(str(error)) from error
    enabled = [
        name
        for name, is_enabled in _numpy_features().items()
        if is_enabled and _is_later(name, instruction_set)
    ]
    if enabled:
        variables = pinning_variables(instruction_set)
        settings = " ".join(f"{key}='{value}'" for key, value in variables.items())
        raise WorkerRefusedError(
            f"NumPy uses {', '.join(enabled)} beyond {instruction_set}: start with {settings}"
        )


def _is_later(feature: str, instruction_set: str) -> bool:
    return feature.startswith(_LATER_FEATURES[instruction_set])


def _numpy_features() -> dict[str, bool]:
    """Features that NumPy has code for beyond the baseline, and whether each is enabled here."""
    # No public function lists these for programs; `numpy.show_runtime` prints them.
    umath = import_module("numpy._core._multiarray_umath")
    return {name: bool(umath.__cpu_features__[name]) for name in umath.__cpu_dispatch__}


def _hash_code() -> str:
    """Digest of the sources of protocol and server, shaders included."""
    digest = hashlib.sha256()
    for package in (catoptra_protocol, catoptra_server):
        root = Path(package.__path__[0])
        for suffix in ("*.py", "*.frag", "*.vert", "*.glsl"):
            for path in sorted(root.rglob(suffix)):
                digest.update(path.relative_to(root).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


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


def _answer(function: Callable[..., _T], args: tuple[object, ...], connection: Connection) -> None:
    try:
        connection.send((function(*args), ""))
    except CatoptraError as error:
        connection.send((None, str(error)))
