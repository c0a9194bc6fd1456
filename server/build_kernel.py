"""Build of the trace renderer's native kernel: C11 sources to a shared library for each processor.

The compiler is the package `ziglang`, so that pip needs none of the system's: numba takes 208 MB,
0.3 s to import and over a second to compile at each start; Cython needs Python's headers and a
wheel for each version; nanobind needs a C++ compiler and CMake. A library has 90 kB and is loaded
by ctypes, by every Python.

`setup.py` runs this in every build of the server, `make setup` alone when a source changed. Where
no kernel can be built, the reason is written beside the place of the library and the server traces
with its reference; CATOPTRA_REQUIRE_KERNEL=1 makes that an error. The standard library is all that
is imported, since this runs before anything is installed.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

# Folder of the package that holds the library, relative to the folder of the package's root.
KERNEL_PACKAGE = Path("catoptra_server/render/trace/kernel")
PACKAGE_ROOT = Path(__file__).resolve().parent / "src"
SOURCE_FOLDER = PACKAGE_ROOT / KERNEL_PACKAGE / "src"
# The same sources for every x86-64 processor since 2009, for those with AVX2 and for those with
# AVX-512; `kernel/library.py` chooses. None fuses multiplications, so all give the same bytes.
_X86_64 = {
    "libcatoptra_trace.so": "x86_64_v2",
    "libcatoptra_trace_avx2.so": "x86_64_v3",
    "libcatoptra_trace_avx512.so": "x86_64_v4",
}
_ARM = {"libcatoptra_trace.so": "generic"}
# Target, processor of each library, and tag of the wheel, by system and machine. Without a target
# the compiler takes the build machine's C library and processor; 2.17 is that of manylinux2014.
PLATFORMS = {
    "linux x86_64": ("x86_64-linux-gnu.2.17", _X86_64, "manylinux2014_x86_64"),
    "linux aarch64": ("aarch64-linux-gnu.2.17", _ARM, "manylinux2014_aarch64"),
    "darwin arm64": ("aarch64-macos.11.0", _ARM, "macosx_11_0_arm64"),
}
PLATFORM = f"{sys.platform} {platform.machine()}"
# On an unknown platform the names alone are of use.
TARGET, PROCESSOR_OF_LIBRARY, WHEEL_TAG = PLATFORMS.get(PLATFORM, PLATFORMS["linux x86_64"])
# AVX-512 is for the search through triangles, which has vectors of 16, and for its rays: a load
# that follows two stores of half its width waits for both, and a search took 1.1 times as long. A
# picture of textures takes 1.25 times as long by AVX-512, and what acts on a pixel 1.2 times, with
# its table of noise. All image effects, whose rows are vectors of 16, take 0.9 to 0.97 of the time
# where changes are measured, the same elsewhere: tests/measurements/image_chain.py.
_WIDE_SOURCES = (
    *("bvh", "camera_rays"),
    *("image_blur", "image_chain", "image_planes", "image_spread"),
)
# Read by `kernel/library.py`: pip shows no output of a build that succeeds.
REASON_NAME = "not_built.txt"

# Functions are inlined across files: a frame takes 0.85 times as long.
# No fused multiply-add: results must not depend on the processor. No errno: square roots in one
# instruction. -g0: no path of the build machine, so that the same sources give the same bytes.
_COMPILE_FLAGS = (
    *("-std=c11", "-O3", "-g0", "-fPIC", "-pthread", "-fvisibility=hidden"),
    *("-ffp-contract=off", "-fno-math-errno", "-fno-sanitize=undefined"),
    *("-Wall", "-Wextra", "-Werror"),
)
# An undefined symbol fails the build instead of the server. -nostdlib leaves out zig's runtime
# library, which takes 5 s to compile and holds nothing that the kernel calls. No libm, whose last
# bits depend on the processor.
_LINK_FLAGS = ("-O3", "-shared", "-s", "-nostdlib", "-lc")
# zig's own linker, for macOS, takes neither of these, and checks for undefined symbols anyway.
_INLINE_ACROSS_FILES, _LINK_ON_LINUX = ("-flto",), ("-flto", "-Wl,-z,defs", "-lpthread")


class KernelBuildError(Exception):
    """The reason for which no kernel was built, as one line."""


def build_or_explain(folder: Path, *, sources: Path = SOURCE_FOLDER) -> bool:
    """Build the libraries in a folder, or write there why not; whether they were built.

    Raises:
        SystemExit: CATOPTRA_REQUIRE_KERNEL is set and no kernel was built.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in (*PROCESSOR_OF_LIBRARY, REASON_NAME):
        (folder / name).unlink(missing_ok=True)
    try:
        _build_libraries(folder, sources=sources)
    except KernelBuildError as error:
        _explain(str(error), folder)
        return False
    return True


def _explain(reason: str, folder: Path) -> None:
    if os.environ.get("CATOPTRA_REQUIRE_KERNEL", "0") not in ("", "0"):
        sys.exit(f"error: no native kernel: {reason} (CATOPTRA_REQUIRE_KERNEL is set)")
    (folder / REASON_NAME).write_text(reason + "\n", encoding="utf-8")
    print(
        f"warning: no native kernel: {reason}; the server will trace with its slow reference",
        file=sys.stderr,
    )


def is_current(folder: Path, *, sources: Path = SOURCE_FOLDER) -> bool:
    """Whether the libraries in a folder are newer than every source, their list and this file."""
    libraries = [folder / name for name in PROCESSOR_OF_LIBRARY]
    inputs = [sources, *sources.glob("*.[ch]"), Path(__file__)]
    newest_ns = max(path.stat().st_mtime_ns for path in inputs)
    return all(path.is_file() and path.stat().st_mtime_ns > newest_ns for path in libraries)


def _build_libraries(folder: Path, *, sources: Path) -> None:
    """Compile all C files of a folder and link them, for each processor.

    Raises:
        KernelBuildError: the machine, the compiler or a source does not allow it.
    """
    require_compiler()
    files = sorted(sources.glob("*.c"))
    if not files:
        raise KernelBuildError(f"{sources} holds no C source")
    started_ns = time.time_ns()
    with tempfile.TemporaryDirectory(prefix="catoptra-kernel-") as name:
        linked = [
            build_library(files, library, processor, Path(name))
            for library, processor in PROCESSOR_OF_LIBRARY.items()
        ]
        for library in linked:
            # As old as the start: a source saved during the build is newer.
            os.utime(library, ns=(started_ns, started_ns))
            _move(library, folder / library.name)


def require_compiler() -> None:
    """Raise KernelBuildError where no kernel can run, or nothing can be compiled."""
    here = f"{sys.platform} {platform.machine()}"
    if here not in PLATFORMS or sys.maxsize <= 2**32:
        raise KernelBuildError(f"the kernel exists for {', '.join(PLATFORMS)}; this is {here}")
    if sys.platform == "linux" and platform.libc_ver()[0] != "glibc":
        raise KernelBuildError("the kernel needs glibc as the system's C library")
    if importlib.util.find_spec("ziglang") is None:
        raise KernelBuildError("the package ziglang, which compiles the kernel, is not installed")


def build_library(
    files: Sequence[Path], library: str, processor: str, folder: Path, *, target: str = TARGET
) -> Path:
    """Library of C files in a folder, compiled side by side for a processor and a target."""
    compile_one = partial(compile_source, processor=processor, folder=folder, target=target)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        objects = list(pool.map(compile_one, files))
    words = ("-target", target, f"-mcpu={processor}", *_LINK_FLAGS, *map(str, objects))
    linked = folder / library
    _run_zig(
        *words, *(_LINK_ON_LINUX if "linux" in target else ()), "-o", str(linked), cache=folder
    )
    return linked


def compile_source(source: Path, *, processor: str, folder: Path, target: str = TARGET) -> Path:
    """Object file of one C file for a processor, as zig names it, in a folder."""
    compiled = folder / f"{source.stem}.{processor}.o"
    narrow = processor if source.stem in _WIDE_SOURCES else processor.replace("v4", "v3")
    inlining = _INLINE_ACROSS_FILES if "linux" in target else ()
    flags = ("-target", target, f"-mcpu={narrow}", *_COMPILE_FLAGS, *inlining)
    _run_zig(*flags, "-c", str(source), "-o", str(compiled), cache=folder)
    return compiled


def _run_zig(*words: str, cache: Path) -> None:
    # The home folder may be missing or read-only. A user's own cache saves compiling unchanged
    # sources and the C library's stubs again.
    caches = {"ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    ended = subprocess.run(
        [sys.executable, "-m", "ziglang", "cc", *words],
        env={**caches, **os.environ},
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if ended.returncode:
        sys.stderr.write(ended.stderr)
        raise KernelBuildError(f"the compiler failed: {_first_error(ended.stderr)}")


def _first_error(output: str) -> str:
    """First line of a compiler's output that states an error, else its last line."""
    lines = output.strip().splitlines() or ["no output"]
    return next((line for line in lines if "error:" in line), lines[-1])


def _move(source: Path, target: Path) -> None:
    """Replace a file at once: a server that has the old one open keeps it."""
    part = target.with_suffix(".part")
    shutil.copy2(source, part)
    part.chmod(0o755)
    part.replace(target)


def main() -> None:
    """Build the kernel in the source tree, unless it is newer than its sources.

    With --is-current nothing is built: the status says whether there is nothing to do.
    """
    folder = PACKAGE_ROOT / KERNEL_PACKAGE
    if "--is-current" in sys.argv[1:]:
        sys.exit(not is_current(folder))
    if not is_current(folder):
        build_or_explain(folder)


if __name__ == "__main__":
    main()
