"""Instruction sets by a processor's flags, files of the libraries, and errors of loading."""

from __future__ import annotations

import ctypes
import ctypes.util
from pathlib import Path
from typing import ClassVar

import pytest

from catoptra_server.render.trace.kernel import library as module
from catoptra_server.render.trace.kernel.kernel_structs import (
    STRUCTURES,
    Fields,
    FrameStruct,
    MeshArrays,
    RayTableStruct,
    SceneStruct,
)
from catoptra_server.render.trace.kernel.library import (
    LIBRARY_OF_INSTRUCTION_SET,
    REASON_NAME,
    KernelDevice,
    KernelError,
    KernelUnavailableError,
    available_instruction_sets,
    choose_instruction_set,
    kernel_library_path,
)
from helpers.deadline import Deadline

SSE = "fpu sse sse2 ssse3 sse4_1 sse4_2 popcnt"
AVX2 = f"{SSE} avx avx2 fma f16c bmi1 bmi2"
AVX512 = f"{AVX2} avx512f avx512dq avx512cd avx512bw avx512vl"


def write_cpu_info(folder: Path, flags: str) -> Path:
    """File of two processors in the form of the kernel's own."""
    path = folder / "cpuinfo"
    one = f"processor\t: 0\nmodel name\t: a flagship\nflags\t\t: {flags}\n\n"
    path.write_text(one + one.replace(flags, "fpu"), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("flags", "available"),
    [
        (AVX512, ("avx512", "avx2", "sse4.2")),
        (AVX512.replace(" avx512vl", ""), ("avx2", "sse4.2")),
        (AVX2, ("avx2", "sse4.2")),
        (AVX2.replace(" fma", ""), ("sse4.2",)),
        (f"{SSE} avx2x", ("sse4.2",)),
    ],
    ids=["avx512", "part of avx512", "avx2", "avx2 without fma", "sse4.2"],
)
def test_instruction_sets_are_those_whose_flags_the_processor_has(
    tmp_path: Path, flags: str, available: tuple[str, ...]
) -> None:
    assert available_instruction_sets(write_cpu_info(tmp_path, flags)) == available


def test_instruction_set_when_nothing_is_known_is_the_least(tmp_path: Path) -> None:
    assert available_instruction_sets(tmp_path / "missing") == ("sse4.2",)
    (tmp_path / "empty").touch()
    assert available_instruction_sets(tmp_path / "empty") == ("sse4.2",)
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\0flags")
    assert available_instruction_sets(tmp_path / "bytes") == ("sse4.2",)


@pytest.fixture
def avx2_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """A processor with AVX2."""
    monkeypatch.setattr(module, "available_instruction_sets", lambda: ("avx2", "sse4.2"))


@pytest.mark.usefixtures("avx2_processor")
@pytest.mark.parametrize(
    ("variable", "chosen"), [("", "avx2"), ("off", "avx2"), ("avx2", "avx2"), ("sse4.2", "sse4.2")]
)
def test_choice_is_the_set_of_the_variable_or_the_best(
    variable: str, chosen: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CATOPTRA_KERNEL", variable)
    assert choose_instruction_set() == chosen


@pytest.mark.usefixtures("avx2_processor")
@pytest.mark.parametrize("variable", ["avx512", "AVX2", "neon"])
def test_choice_when_the_processor_lacks_the_set_names_those_that_it_has(
    variable: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CATOPTRA_KERNEL", variable)
    with pytest.raises(KernelUnavailableError, match=rf"={variable}; .* has avx2, sse4\.2"):
        choose_instruction_set()


def test_instruction_set_of_arm_is_neon(monkeypatch: pytest.MonkeyPatch) -> None:
    for machine in ("aarch64", "arm64"):
        monkeypatch.setattr(module.platform, "machine", lambda name=machine: name)
        assert available_instruction_sets() == ("neon",)
    assert kernel_library_path("neon") == kernel_library_path("sse4.2")


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in the place of the package's own."""
    monkeypatch.setattr(module, "__file__", str(tmp_path / "library.py"))
    monkeypatch.delenv("CATOPTRA_KERNEL", raising=False)
    return tmp_path


def test_kernel_library_when_it_exists_is_that_of_the_instruction_set(package: Path) -> None:
    for name in LIBRARY_OF_INSTRUCTION_SET.values():
        (package / name).touch()
    paths = [kernel_library_path(name).name for name in ("avx512", "avx2", "sse4.2")]
    assert paths == [f"libcatoptra_trace{suffix}.so" for suffix in ("_avx512", "_avx2", "")]


def test_kernel_library_when_it_is_missing_names_file_and_remedy(package: Path) -> None:
    with pytest.raises(KernelUnavailableError, match="install catoptra-server again") as caught:
        kernel_library_path("avx2")
    assert str(package / LIBRARY_OF_INSTRUCTION_SET["avx2"]) in str(caught.value)


def test_kernel_library_when_it_was_not_built_states_the_reason_of_the_build(package: Path) -> None:
    (package / REASON_NAME).write_text("the compiler failed: a.c:1: error\n", encoding="utf-8")
    with pytest.raises(KernelUnavailableError) as caught:
        kernel_library_path("avx2")
    assert caught.value.reason == (
        "none was built at installation: the compiler failed: a.c:1: error"
    )


def test_kernel_library_when_switched_off_is_unavailable(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (package / LIBRARY_OF_INSTRUCTION_SET["avx2"]).touch()
    monkeypatch.setenv("CATOPTRA_KERNEL", "off")
    with pytest.raises(KernelUnavailableError, match="CATOPTRA_KERNEL=off"):
        kernel_library_path("avx2")
    # Read at each call, not at import.
    monkeypatch.delenv("CATOPTRA_KERNEL")
    assert kernel_library_path("avx2") == package / LIBRARY_OF_INSTRUCTION_SET["avx2"]


DEADLINE_S = 10.0
INSTRUCTION_SET = available_instruction_sets()[0]


def replace_library(monkeypatch: pytest.MonkeyPatch, path: Path) -> None:
    """Let the kernel's library be another file."""
    monkeypatch.setattr(module, "kernel_library_path", lambda instruction_set: path)


@pytest.fixture(autouse=True)
def _kernel() -> None:
    """Skip where no kernel can run."""
    try:
        kernel_library_path(INSTRUCTION_SET)
    except KernelUnavailableError as error:
        pytest.skip(str(error))


def test_library_when_it_is_no_library_is_unavailable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "libcatoptra_trace.so"
    path.write_text("no library", encoding="utf-8")
    replace_library(monkeypatch, path)
    with pytest.raises(KernelUnavailableError, match="cannot be loaded") as caught:
        KernelDevice(INSTRUCTION_SET, 1)
    assert str(path) in str(caught.value)


def test_library_when_a_function_is_missing_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    replace_library(monkeypatch, Path(ctypes.util.find_library("m") or ""))
    with pytest.raises(KernelUnavailableError, match="has no function catoptra_abi; install"):
        KernelDevice(INSTRUCTION_SET, 1)


@pytest.mark.parametrize("number", range(len(STRUCTURES)))
def test_library_when_of_another_release_names_the_structure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, number: int
) -> None:
    class Longer(STRUCTURES[number]):  # type: ignore[misc]
        _fields_: ClassVar[Fields] = [("more", ctypes.c_void_p)]

    changed = (*STRUCTURES[:number], Longer, *STRUCTURES[number + 1 :])
    monkeypatch.setattr(module, "STRUCTURES", changed)
    # A name of its own: libraries are checked once each.
    (tmp_path / "kernel.so").symlink_to(kernel_library_path(INSTRUCTION_SET))
    replace_library(monkeypatch, tmp_path / "kernel.so")
    with pytest.raises(KernelUnavailableError, match="another release, by its Longer; install"):
        KernelDevice(INSTRUCTION_SET, 1)


def test_library_knows_the_sizes_of_these_structures_alone() -> None:
    library = ctypes.CDLL(str(kernel_library_path(INSTRUCTION_SET)))
    assert [library.catoptra_abi(number) for number in (-1, len(STRUCTURES), 2**31 - 1)] == [-1] * 3


def test_device_when_closed_refuses_all_work_and_closes_again() -> None:
    device = KernelDevice(INSTRUCTION_SET, 2)
    device.close()
    device.close()
    uses = (
        lambda: device.commit_mesh(MeshArrays()),
        lambda: device.prepare(RayTableStruct()),
        lambda: device.render(SceneStruct(), 0, FrameStruct()),
        lambda: device.trace(SceneStruct(), 0, FrameStruct()),
        lambda: device.build_light_maps(SceneStruct()),
    )
    for use in uses:
        with pytest.raises(KernelError, match="the device is closed"):
            use()


def count_threads() -> int:
    """Threads of this process."""
    return len(list(Path("/proc/self/task").iterdir()))


def wait_for_threads(expected: int) -> None:
    """Wait for a number of threads: the system lists one that was joined a moment longer."""
    deadline = Deadline(f"{expected} threads", DEADLINE_S)
    while count_threads() != expected:
        deadline.check()


@pytest.mark.parametrize(("threads", "more"), [(-3, 0), (0, 0), (1, 0), (2, 1), (64, 63)])
def test_device_has_one_thread_less_than_requested_and_none_when_closed(
    threads: int, more: int
) -> None:
    before = count_threads()
    device = KernelDevice(INSTRUCTION_SET, threads)
    wait_for_threads(before + more)
    device.close()
    wait_for_threads(before)
