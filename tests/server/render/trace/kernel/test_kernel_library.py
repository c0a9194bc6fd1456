"""Loading of the kernel's library, and its device's errors."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import ClassVar

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.render.trace.kernel import library as kernel_library
from catoptra_server.render.trace.kernel.kernel_structs import (
    STRUCTURES,
    Fields,
    FrameStruct,
    MeshArrays,
    RayTableStruct,
    SceneStruct,
)
from catoptra_server.render.trace.kernel.library import (
    KernelDevice,
    KernelError,
    KernelUnavailableError,
    available_instruction_sets,
    embree_library_path,
    kernel_library_path,
)
from helpers.deadline import Deadline

DEADLINE_S = 10.0
INSTRUCTION_SET = available_instruction_sets()[0]


def replace_library(monkeypatch: pytest.MonkeyPatch, path: Path) -> None:
    """Let the kernel's library be another file."""
    monkeypatch.setattr(kernel_library, "kernel_library_path", lambda instruction_set: path)


@pytest.fixture(autouse=True)
def _kernel() -> None:
    """Skip where no kernel can run."""
    try:
        kernel_library_path(INSTRUCTION_SET)
        embree_library_path()
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
    replace_library(monkeypatch, embree_library_path())
    with pytest.raises(KernelUnavailableError, match="has no function catoptra_abi; install"):
        KernelDevice(INSTRUCTION_SET, 1)


@pytest.mark.parametrize("number", range(len(STRUCTURES)))
def test_library_when_of_another_release_names_the_structure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, number: int
) -> None:
    class Longer(STRUCTURES[number]):  # type: ignore[misc]
        _fields_: ClassVar[Fields] = [("more", ctypes.c_void_p)]

    changed = (*STRUCTURES[:number], Longer, *STRUCTURES[number + 1 :])
    monkeypatch.setattr(kernel_library, "STRUCTURES", changed)
    # A name of its own: libraries are checked once each.
    (tmp_path / "kernel.so").symlink_to(kernel_library_path(INSTRUCTION_SET))
    replace_library(monkeypatch, tmp_path / "kernel.so")
    with pytest.raises(KernelUnavailableError, match="another release, by its Longer; install"):
        KernelDevice(INSTRUCTION_SET, 1)


def test_library_knows_the_sizes_of_these_structures_alone() -> None:
    library = ctypes.CDLL(str(kernel_library_path(INSTRUCTION_SET)))
    assert [library.catoptra_abi(number) for number in (-1, len(STRUCTURES), 2**31 - 1)] == [-1] * 3


def test_device_when_embree_is_missing_is_unavailable(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(kernel_library, "embree_library_path", lambda: tmp_path / "none.so")
    with pytest.raises(KernelUnavailableError, match=r"none\.so"):
        KernelDevice(INSTRUCTION_SET, 1)


def test_device_when_embree_is_another_library_names_the_missing_function(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = kernel_library_path(INSTRUCTION_SET)
    monkeypatch.setattr(kernel_library, "embree_library_path", lambda: path)
    with pytest.raises(KernelUnavailableError, match="has no function rtcNewDevice"):
        KernelDevice(INSTRUCTION_SET, 1)


def test_device_when_its_path_is_very_long_is_unavailable(monkeypatch: pytest.MonkeyPatch) -> None:
    # Longer than the buffer of the kernel's errors.
    monkeypatch.setattr(kernel_library, "embree_library_path", lambda: Path("/" + 4000 * "x"))
    with pytest.raises(KernelUnavailableError, match="no native kernel: /xxx"):
        KernelDevice(INSTRUCTION_SET, 1)


@pytest.mark.skipif(INSTRUCTION_SET == "avx512", reason="this processor has every set")
def test_device_when_the_processor_lacks_the_instruction_set_is_unavailable() -> None:
    with pytest.raises(KernelUnavailableError, match="no device for the instruction set avx512"):
        KernelDevice("avx512", 1)


@pytest.mark.parametrize("width", [-1, 2, 3, 5, 32, 2**31 - 1])
def test_device_when_packets_have_no_such_width_is_refused(width: int) -> None:
    with pytest.raises(DomainError, match="a packet has"):
        KernelDevice(INSTRUCTION_SET, 1, packet_width=width)


def test_device_has_the_packets_that_its_instruction_set_runs_fast() -> None:
    widths = {"sse4.2": 4, "avx2": 8, "avx512": 16}
    for name in available_instruction_sets():
        device = KernelDevice(name, 1)
        assert device.packet_width == widths[name]
        device.close()


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
    KernelDevice(INSTRUCTION_SET, 1).close()  # Embree starts threads of its own at its first device
    before = count_threads()
    device = KernelDevice(INSTRUCTION_SET, threads)
    wait_for_threads(before + more)
    device.close()
    wait_for_threads(before)
