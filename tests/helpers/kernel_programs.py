"""The kernel's tests in C, and the kernel under sanitizers: `make sanitize` runs this module.

Zig has the runtime of UndefinedBehaviorSanitizer, not of AddressSanitizer: gcc or clang compile
with both where they are installed. Silent when all is well.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from catoptra_server.render.trace.kernel import library
from helpers.configs import REPOSITORY

SOURCES = Path(library.__file__).parent / "src"
TESTS = REPOSITORY / "tests/server/render/trace/kernel"
# What the hierarchy and instances are linked with.
BVH_SOURCES = [
    SOURCES / f"{name}.c" for name in ("bvh", "bvh_build", "instances", "frame_state", "workers")
]
ZIG = (sys.executable, "-m", "ziglang", "cc")
_FLAGS = (
    *("-std=c11", "-g", "-fPIC", "-pthread", "-march=native", "-ffp-contract=off"),
    *("-fno-math-errno", "-Wall", "-Wextra", "-Werror", f"-I{SOURCES}"),
)
# gcc warns of vectors that are wider than the processor's, and of enumerations that are one number.
_GCC_FLAGS = ("-Wno-psabi", "-Wno-enum-compare")
_UNDEFINED = ("-O1", "-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover=all")
_ADDRESS = ("-fsanitize=address", "-fno-omit-frame-pointer")


def has_zig() -> bool:
    """Whether the compiler of the kernel is installed."""
    return importlib.util.find_spec("ziglang") is not None


def compile_bvh_test(folder: Path, *words: str, compiler: Sequence[str] = ZIG) -> Path:
    """Program of the tests of the hierarchy, compiled without link-time optimization."""
    program = folder / "test_bvh"
    files = map(str, (*BVH_SOURCES, TESTS / "c/test_bvh.c"))
    _run([*compiler, *_FLAGS, *words, *files, "-lm", "-o", str(program)])
    return program


def _compile_library(folder: Path, words: Sequence[str]) -> Path:
    def compile_source(source: Path) -> str:
        compiled = str(folder / f"{source.stem}.o")
        _run([*words, "-c", str(source), "-o", compiled])
        return compiled

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        compiled = list(pool.map(compile_source, sorted(SOURCES.glob("*.c"))))
    path = folder / "libsanitized.so"
    _run([*words, "-shared", *compiled, "-lm", "-o", str(path)])
    return path


def _run(words: Sequence[str], **environment: str) -> None:
    """Run a program; its output appears and this process ends where it fails."""
    ended = subprocess.run(
        words, env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    if ended.returncode:
        sys.exit(f"{ended.stdout}{ended.stderr}{' '.join(words[:3])} ... failed")


def _find_address_sanitizer(folder: Path) -> tuple[tuple[str, ...], str]:
    """Words of a compiler that has one, and the library to load first; empty without."""
    source = folder / "empty.c"
    source.write_text("int main(void) { return 0; }\n", encoding="utf-8")
    for name, flags, runtime in (
        ("gcc", _GCC_FLAGS, "libasan.so"),
        ("clang", ("-shared-libasan",), "libclang_rt.asan-x86_64.so"),
    ):
        words = (name, *_ADDRESS, *flags)
        if shutil.which(name) is None:
            continue
        linked = [*words, str(source), "-o", str(folder / "empty")]
        if not subprocess.run(linked, capture_output=True, check=False).returncode:
            asked = [name, f"-print-file-name={runtime}"]
            return words, subprocess.check_output(asked, text=True).strip()
    return (), ""


def _sanitize() -> None:
    with tempfile.TemporaryDirectory(prefix="catoptra-sanitize-") as name:
        folder = Path(name)
        compiler, runtime = _find_address_sanitizer(folder)
        if not compiler:
            print("no AddressSanitizer (apt install gcc): undefined behaviour alone is looked for")
            compiler = ZIG
        program = compile_bvh_test(folder, *_UNDEFINED, compiler=compiler)
        _run([str(program), "240"])
        path = _compile_library(folder, [*compiler, *_FLAGS, *_UNDEFINED])
        # Python does not free all at its end; a test asks for more memory than there is.
        _run(
            [sys.executable, "-m", "helpers.kernel_programs", str(path)],
            **({"LD_PRELOAD": runtime} if runtime else {}),
            # Freed memory is held back for a while: a test counts what engines leave.
            ASAN_OPTIONS="detect_leaks=0:allocator_may_return_null=1:quarantine_size_mb=8",
        )


def _test_library(path: Path) -> int:
    """Run the kernel's tests in Python with this library for every instruction set."""
    # Without capture: a sanitizer ends the process, its words are all there is.
    load = library._load_library

    def load_sanitized(asked: Path) -> object:
        return load(path if asked.parent == SOURCES.parent else asked)

    library._load_library = load_sanitized  # type: ignore[assignment]
    return int(pytest.main(["-q", "-x", "-s", str(TESTS)]))


if __name__ == "__main__":
    sys.exit(_test_library(Path(sys.argv[1])) if sys.argv[1:] else _sanitize())
