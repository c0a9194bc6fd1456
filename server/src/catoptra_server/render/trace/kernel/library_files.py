"""Files of the native libraries that trace: the kernel and Embree. Nothing is loaded here.

Where one of them is missing the server traces with its reference, and `KernelUnavailableError` is
the reason.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

from catoptra_protocol.errors import CatoptraError

# These names are those of build_kernel.py, which compiles the kernel once for each processor.
LIBRARY_OF_INSTRUCTION_SET = {
    "sse4.2": "libcatoptra_trace.so",
    "avx2": "libcatoptra_trace_avx2.so",
    "avx512": "libcatoptra_trace_avx2.so",
}
REASON_NAME = "not_built.txt"
# The wheels of embreex name their copy of Embree by a hash, which changes from version to version.
EMBREE_PATTERN = "libembree4*.so*"


class KernelUnavailableError(CatoptraError):
    """The native kernel cannot trace here; the message names the missing part and the remedy."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"no native kernel: {reason}")
        self.reason = reason


def kernel_library_path(instruction_set: str) -> Path:
    """Path of the kernel's library for an instruction set, as Embree names it.

    Raises:
        KernelUnavailableError: CATOPTRA_KERNEL=off, or the installation brought no library.
    """
    if os.environ.get("CATOPTRA_KERNEL") == "off":
        raise KernelUnavailableError("CATOPTRA_KERNEL=off; unset it to trace with the kernel")
    path = Path(__file__).parent / LIBRARY_OF_INSTRUCTION_SET[instruction_set]
    if not path.is_file():
        raise KernelUnavailableError(_missing_library(path))
    return path


def _missing_library(path: Path) -> str:
    """Reason that the build left beside the place of the library, or its plain absence."""
    try:
        reason = (path.parent / REASON_NAME).read_text(encoding="utf-8").strip()
    except OSError:
        return f"{path} does not exist; install catoptra-server again"
    return f"none was built at installation: {reason}"


def embree_library_path() -> Path:
    """Path of the Embree library that the package embreex brings along.

    Raises:
        KernelUnavailableError: embreex is not installed, or brought no such library.
    """
    package = importlib.util.find_spec("embreex")
    if package is None or package.origin is None:
        raise KernelUnavailableError("the package embreex is not installed")
    # Where wheels keep the libraries that they bring along. Not by the wheel's list of files:
    # importlib.metadata takes 0.02 s of every start.
    folder = Path(package.origin).parents[1] / "embreex.libs"
    found = next(folder.glob(EMBREE_PATTERN), None)
    if found is None:
        raise KernelUnavailableError(
            f"{folder} has no file {EMBREE_PATTERN}; install a wheel of the package embreex again"
        )
    return found
