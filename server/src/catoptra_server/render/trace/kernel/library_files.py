"""Files of the native libraries that trace: the kernel and Embree. Nothing is loaded here.

Where one of them is missing the server traces with its reference, and `KernelUnavailableError` is
the reason.
"""

from __future__ import annotations

import importlib.metadata
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
    try:
        files = importlib.metadata.files("embreex") or ()
    except importlib.metadata.PackageNotFoundError:
        raise KernelUnavailableError("the package embreex is not installed") from None
    paths = (Path(str(file.locate())) for file in files if file.match(EMBREE_PATTERN))
    found = next((path for path in paths if path.is_file()), None)
    if found is None:
        raise KernelUnavailableError(
            f"the package embreex has no file {EMBREE_PATTERN}; install a wheel of it again"
        )
    return found
