"""Build of the native kernel: where it succeeds, what the library needs, and the reasons if not."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from catoptra_server.render.trace.kernel import library as library_files
from helpers.configs import REPOSITORY


def load_build_script() -> ModuleType:
    """The module server/build_kernel.py, which no package holds."""
    path = REPOSITORY / "server" / "build_kernel.py"
    spec = importlib.util.spec_from_file_location("build_kernel", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


build_kernel = load_build_script()

try:
    build_kernel.require_compiler()
    WHY_NOT = ""
except build_kernel.KernelBuildError as error:
    WHY_NOT = str(error)
LIBRARY_NAMES = list(build_kernel.PROCESSOR_OF_LIBRARY)
needs_compiler = pytest.mark.skipif(bool(WHY_NOT), reason=f"no kernel here: {WHY_NOT}")

EXPORT = '__attribute__((visibility("default")))'
# A header, a second file, threads and functions of the C library.
HEADER = "double scale(double value);\n"
FIRST = f"""#include "scale.h"
#include <pthread.h>
#include <string.h>
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
{EXPORT} double scale_sum(const double *values, int count) {{
    double copy[64] = {{0}};
    memcpy(copy, values, (size_t)count * sizeof *values);
    pthread_mutex_lock(&lock);
    double sum = 0;
    for (int i = 0; i < count; i++)
        sum += scale(copy[i]);
    pthread_mutex_unlock(&lock);
    return sum;
}}
"""
SECOND = """#include "scale.h"
double scale(double value) {
    return value * value * value;
}
"""


def write_sources(folder: Path) -> Path:
    """Write the sources of a small library into a new folder."""
    folder.mkdir()
    for name, text in {"scale.h": HEADER, "first.c": FIRST, "second.c": SECOND}.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One cache of the compiler for all tests: the C library's stubs take seconds."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
            if name not in os.environ:
                patch.setenv(name, str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """A folder with the sources of a small library."""
    return write_sources(tmp_path / "sources")


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for the library."""
    monkeypatch.delenv("CATOPTRA_REQUIRE_KERNEL", raising=False)
    return tmp_path / "package"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small library for every processor, built once."""
    if WHY_NOT:
        pytest.skip(f"no kernel here: {WHY_NOT}")
    folder = tmp_path_factory.mktemp("built")
    assert build_kernel.build_or_explain(folder, sources=write_sources(folder / "sources"))
    return folder / LIBRARY_NAMES[0]


def reason_in(package: Path) -> str:
    """Reason that the build left; there must be no library."""
    assert [path.name for path in package.iterdir()] == [build_kernel.REASON_NAME]
    return (package / build_kernel.REASON_NAME).read_text(encoding="utf-8").strip()


def test_names_of_the_files_are_those_that_the_server_looks_for() -> None:
    assert set(LIBRARY_NAMES) == set(library_files.LIBRARY_OF_INSTRUCTION_SET.values())
    assert build_kernel.REASON_NAME == library_files.REASON_NAME
    assert (build_kernel.PACKAGE_ROOT / build_kernel.KERNEL_PACKAGE) == Path(
        library_files.__file__
    ).parent


def test_compiler_when_pinned_is_the_same_in_both_files() -> None:
    """Constraints do not reach the isolated build, and the build's pin does not reach `.venv`."""
    project = tomllib.loads((REPOSITORY / "server/pyproject.toml").read_text(encoding="utf-8"))
    pins = [r.partition(";")[0] for r in project["build-system"]["requires"] if "ziglang" in r]
    constraints = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8").splitlines()
    assert pins == [line for line in constraints if line.startswith("ziglang==")]


def test_library_when_built_computes(built: Path) -> None:
    library = ctypes.CDLL(str(built))
    library.scale_sum.restype = ctypes.c_double
    values = (ctypes.c_double * 3)(0.5, 0.0, -0.5)
    assert library.scale_sum(values, 3) == 0.0


def test_library_when_built_exports_only_what_is_marked(built: Path) -> None:
    library = ctypes.CDLL(str(built))
    assert hasattr(library, "scale_sum")
    assert not hasattr(library, "scale")


def test_library_when_built_needs_only_an_old_system_library(built: Path) -> None:
    binary = built.read_bytes()
    needed = set(re.findall(rb"\0(lib[\w.+-]+\.so[.\d]*)", binary))
    assert b"libc.so.6" in needed
    assert needed <= {b"libc.so.6", b"libpthread.so.0"}
    versions = re.findall(rb"GLIBC_2\.(\d+)", binary)
    assert versions
    assert max(map(int, versions)) <= 17


@needs_compiler
def test_library_when_built_elsewhere_has_the_same_bytes(
    built: Path, package: Path, sources: Path
) -> None:
    build_kernel.build_or_explain(package, sources=sources)
    assert sorted(path.name for path in package.iterdir()) == LIBRARY_NAMES
    for name in LIBRARY_NAMES:
        assert (package / name).read_bytes() == (built.parent / name).read_bytes()


@needs_compiler
def test_compiler_when_home_cannot_be_written_keeps_its_cache_beside_the_objects(
    tmp_path: Path, sources: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    # A file, since an administrator may write into any folder.
    monkeypatch.setenv("HOME", str(sources / "first.c"))
    assert build_kernel.compile_source(
        sources / "second.c", processor="x86_64_v2", folder=tmp_path
    ).is_file()


def disassemble(library: Path) -> str:
    """Instructions of a library."""
    command = ("objdump", "--disassemble", str(library))
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@pytest.mark.skipif(shutil.which("objdump") is None, reason="no objdump here")
def test_libraries_have_wide_registers_for_the_newer_processor_alone(built: Path) -> None:
    wide = {name: "%ymm" in disassemble(built.parent / name) for name in LIBRARY_NAMES}
    assert wide == {name: name != "libcatoptra_trace.so" for name in LIBRARY_NAMES}


@needs_compiler
@pytest.mark.parametrize("name", ["linux aarch64", "darwin arm64"])
def test_kernel_compiles_and_links_for_arm(name: str, tmp_path: Path) -> None:
    target, processors, _ = build_kernel.PLATFORMS[name]
    files = sorted(build_kernel.SOURCE_FOLDER.glob("*.c"))
    for library, processor in processors.items():
        built = build_kernel.build_library(files, library, processor, tmp_path, target=target)
        # The machine in the headers of ELF and of Mach-O: ARM of 64 bits.
        assert (
            built.read_bytes()[:20].endswith(b"\xb7\0") or built.read_bytes()[4:8] == b"\x0c\0\0\1"
        )


BROKEN = {
    "an error": "int f(void) { return missing; }\n",
    "a warning": "int f(void) { int unused; return 1; }\n",
    "an undefined symbol": f"int missing(void);\n{EXPORT} int f(void) {{ return missing(); }}\n",
}


@needs_compiler
@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN)
def test_build_when_a_source_is_broken_removes_the_old_library_and_says_why(
    text: str, package: Path, sources: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    package.mkdir()
    for name in LIBRARY_NAMES:
        (package / name).touch()
    (sources / "third.c").write_text(text, encoding="utf-8")
    assert not build_kernel.build_or_explain(package, sources=sources)
    assert re.match(r"the compiler failed: .*(missing|unused)", reason_in(package))
    assert "warning: no native kernel: the compiler failed" in capsys.readouterr().err


def test_build_when_there_is_no_source_says_so(package: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_kernel, "require_compiler", lambda: None)
        assert not build_kernel.build_or_explain(package, sources=tmp_path)
    assert reason_in(package) == f"{tmp_path} holds no C source"


@pytest.fixture
def without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """No package ziglang, on a machine that could use the kernel."""
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(build_kernel.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(build_kernel.platform, "libc_ver", lambda: ("glibc", "2.36"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)


@pytest.mark.usefixtures("without_compiler")
def test_build_without_compiler_warns_and_leaves_the_reason(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not build_kernel.build_or_explain(package)
    assert "ziglang, which compiles the kernel, is not installed" in reason_in(package)
    assert capsys.readouterr().err.startswith("warning: no native kernel: the package ziglang")


@pytest.mark.usefixtures("without_compiler")
@pytest.mark.parametrize("value", ["", "0"])
def test_build_without_compiler_when_the_kernel_is_not_required_goes_on(
    value: str, package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CATOPTRA_REQUIRE_KERNEL", value)
    assert not build_kernel.build_or_explain(package)


@pytest.mark.usefixtures("without_compiler")
def test_build_without_compiler_when_the_kernel_is_required_fails(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CATOPTRA_REQUIRE_KERNEL", "1")
    with pytest.raises(SystemExit, match="error: no native kernel: the package ziglang"):
        build_kernel.build_or_explain(package)


@pytest.mark.parametrize(
    ("system", "machine", "library", "named"),
    [
        ("linux", "riscv64", "glibc", "this is linux riscv64"),
        ("darwin", "x86_64", "", "this is darwin x86_64"),
        ("win32", "AMD64", "", "this is win32 AMD64"),
        ("linux", "x86_64", "", "needs glibc"),
    ],
)
def test_build_on_another_platform_states_it(
    system: str, machine: str, library: str, named: str, package: Path
) -> None:
    # A context, since pytest itself reads sys.platform between the test and its clean-up.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "platform", system)
        patch.setattr(build_kernel.platform, "machine", lambda: machine)
        patch.setattr(build_kernel.platform, "libc_ver", lambda: (library, ""))
        assert not build_kernel.build_or_explain(package)
    assert named in reason_in(package)


def set_age(path: Path, seconds: int) -> None:
    """Let a file be some seconds older than a moment in the past."""
    os.utime(path, (1_000_000_000 - seconds, 1_000_000_000 - seconds))


def test_library_is_current_until_a_source_the_list_or_the_build_changes(
    package: Path, sources: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = sources.parent / "script.py"
    monkeypatch.setattr(build_kernel, "__file__", str(script))
    package.mkdir()
    libraries = [package / name for name in LIBRARY_NAMES]
    inputs = [script, *sources.iterdir(), sources]
    for path in (script, *libraries):
        path.touch()
    for path in inputs:
        set_age(path, 10)
    for path in libraries:
        set_age(path, 5)
    assert build_kernel.is_current(package, sources=sources)
    for path in inputs:
        set_age(path, 0)
        assert not build_kernel.is_current(package, sources=sources), path
        set_age(path, 10)
    libraries[1].unlink()
    assert not build_kernel.is_current(package, sources=sources)


@needs_compiler
def test_library_when_a_source_is_saved_during_the_build_is_not_current(
    package: Path, sources: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compile_and_save(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
        ended = run(*words, **options)
        (sources / "first.c").touch()
        return ended

    run = subprocess.run
    monkeypatch.setattr(build_kernel.subprocess, "run", compile_and_save)
    assert build_kernel.build_or_explain(package, sources=sources)
    assert not build_kernel.is_current(package, sources=sources)
