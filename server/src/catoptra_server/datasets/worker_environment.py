"""Code and libraries of a process that draws samples, which are the same in all workers.

Processors and C libraries may differ: nothing of theirs reaches a sample
(`catoptra_protocol/optics/elementary.py`). The kernel's plain library stands for all of a machine.
A worker whose code or libraries differ refuses, instead of drawing other bytes.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

import catoptra_protocol
import catoptra_server
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.shards import hash_file, load_zstandard
from catoptra_server.datasets import png_files
from catoptra_server.render.trace.kernel.library import kernel_library_path

ZSTANDARD = "zstandard"
"""Entry of the environment that matters where arrays are compressed."""


class WorkerRefusedError(CatoptraError):
    """A worker has other code, libraries or files than the driver."""


@cache
def describe_environment() -> dict[str, str]:
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
        "kernel_sha256": hash_file(kernel_library_path("sse4.2")),
        "machine": platform.machine(),
        # Its sum of floats is another one from 3.12 on.
        "python": ".".join(platform.python_version_tuple()[:2]),
        "png_encoder": png_files.ENCODER,
        **libraries,
        **describe_zstandard(),
    }


def describe_zstandard() -> dict[str, str]:
    """Version of the library on which compressed bytes depend; nothing where it is missing."""
    try:
        version = load_zstandard().ZSTD_VERSION
    except CatoptraError:
        return {}
    return {ZSTANDARD: ".".join(map(str, version))}


def require_environment(expected: Mapping[str, str]) -> None:
    """Check that this process draws the bytes of a driver with an environment.

    Raises:
        WorkerRefusedError: Code or a library differs; names what.
    """
    try:
        own = describe_environment()
    except (CatoptraError, metadata.PackageNotFoundError) as error:
        raise WorkerRefusedError(str(error)) from error
    different = [
        f"{name} {own.get(name, 'none')} instead of {value}"
        for name, value in expected.items()
        if own.get(name) != value
    ]
    if different:
        raise WorkerRefusedError(f"this worker differs: {', '.join(different)}")


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
