"""What the bytes of samples depend on beside the recipe: code, libraries, instruction sets.

Embree, NumPy and OpenBLAS choose code by the processor, and last bits differ. A data set pins one
instruction set for all of them, by variables that a process needs before it loads NumPy; a worker
that differs refuses, instead of drawing other bytes.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib import import_module, metadata
from pathlib import Path

import catoptra_protocol
import catoptra_server
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_server.datasets import png_files
from catoptra_server.render.trace.kernel.library import choose_instruction_set, kernel_library_path

# Features that NumPy may choose code for, by the instruction set that first has them: those of
# later ones are disabled. By prefix, since NumPy 2.4 has renamed them.
_LATER_FEATURES = {
    "avx512": (),
    "avx2": ("AVX512", "X86_V4"),
    "sse4.2": ("AVX", "FMA", "F16C", "X86_V3", "X86_V4"),
}
_BLAS_CORES = {"avx512": "SkylakeX", "avx2": "Haswell", "sse4.2": "Nehalem"}

Environment = Mapping[str, str]


def pinning_variables(instruction_set: str) -> dict[str, str]:
    """Environment variables of a worker process, to be set before it starts."""
    disabled = [name for name in _numpy_features() if _is_later(name, instruction_set)]
    return {
        "NPY_DISABLE_CPU_FEATURES": " ".join(disabled),
        "OPENBLAS_CORETYPE": _BLAS_CORES[instruction_set],
        "OPENBLAS_NUM_THREADS": "1",
    }


def find_processor_error(instruction_set: str) -> str:
    """Why this process must not draw with an instruction set; empty where it may."""
    try:
        choose_instruction_set(instruction_set)
    except DomainError as error:
        return str(error)
    enabled = [
        name
        for name, is_enabled in _numpy_features().items()
        if is_enabled and _is_later(name, instruction_set)
    ]
    if enabled:
        variables = pinning_variables(instruction_set)
        settings = " ".join(f"{key}='{value}'" for key, value in variables.items())
        return f"NumPy uses {', '.join(enabled)} beyond {instruction_set}: start with {settings}"
    return ""


def _is_later(feature: str, instruction_set: str) -> bool:
    return feature.startswith(_LATER_FEATURES[instruction_set])


def _numpy_features() -> dict[str, bool]:
    """Features that NumPy has code for beyond its baseline, and whether each is enabled here."""
    # No public function lists them for programs; `numpy.show_runtime` prints these.
    umath = import_module("numpy._core._multiarray_umath")
    return {name: bool(umath.__cpu_features__[name]) for name in umath.__cpu_dispatch__}


@cache
def describe_environment(instruction_set: str) -> dict[str, str]:
    """Versions of code and libraries, to be equal in all workers of a data set.

    Raises:
        KernelUnavailableError: The kernel is missing.
    """
    libraries = {
        name: metadata.version(name)
        for name in ("numpy", "embreex", "opencv-contrib-python-headless", "pillow", "trimesh")
    }
    return {
        "code_version": catoptra_server.__version__,
        "code_sha256": _hash_code(),
        "kernel_sha256": _hash(kernel_library_path(instruction_set)),
        "machine": platform.machine(),
        # Sines and cosines are its own.
        "libc": " ".join(platform.libc_ver()) or platform.system(),
        "png_encoder": png_files.ENCODER,
        **libraries,
    }


def find_environment_error(expected: Environment, instruction_set: str) -> str:
    """Why this worker must not draw for a driver; empty where it may."""
    processor = find_processor_error(instruction_set)
    if processor:
        return processor
    try:
        own = describe_environment(instruction_set)
    except (CatoptraError, metadata.PackageNotFoundError) as error:
        return str(error)
    different = [
        f"{name} {own.get(name, 'none')} instead of {value}"
        for name, value in expected.items()
        if own.get(name) != value
    ]
    return f"this worker differs: {', '.join(different)}" if different else ""


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


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
