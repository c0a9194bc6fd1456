"""Paths of the kernel and of Embree, and the reasons for which one is missing."""

from __future__ import annotations

import ctypes
import importlib.metadata
from pathlib import Path

import pytest

from catoptra_server.render.trace.kernel import library_files
from catoptra_server.render.trace.kernel.instruction_sets import INSTRUCTION_SETS
from catoptra_server.render.trace.kernel.library_files import (
    LIBRARY_OF_INSTRUCTION_SET,
    REASON_NAME,
    KernelUnavailableError,
    embree_library_path,
    kernel_library_path,
)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in the place of the package's own."""
    monkeypatch.setattr(library_files, "__file__", str(tmp_path / "library_files.py"))
    monkeypatch.delenv("CATOPTRA_KERNEL", raising=False)
    return tmp_path


class FakeFile(importlib.metadata.PackagePath):
    """A file of a package's list, in any folder."""

    folder = Path()

    def locate(self) -> Path:
        return self.folder / self


def list_files(monkeypatch: pytest.MonkeyPatch, folder: Path, *names: str) -> None:
    """Let the list of embreex hold these names."""
    files = [FakeFile(name) for name in names]
    monkeypatch.setattr(FakeFile, "folder", folder)
    monkeypatch.setattr(importlib.metadata, "files", lambda package: files)


def test_kernel_library_when_it_exists_is_that_of_the_instruction_set(package: Path) -> None:
    for name in LIBRARY_OF_INSTRUCTION_SET.values():
        (package / name).touch()
    paths = [kernel_library_path(name).name for name in INSTRUCTION_SETS]
    newer, older = "libcatoptra_trace_avx2.so", "libcatoptra_trace.so"
    assert paths == [newer, newer, older]


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


def test_embree_library_when_embreex_is_installed_exports_packets() -> None:
    embree = ctypes.CDLL(str(embree_library_path()))
    assert all(hasattr(embree, f"rtcIntersect{width}") for width in (1, 4, 8, 16))


def test_embree_library_when_its_name_has_a_hash_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = tmp_path / "embreex.libs" / "libembree4-0badcafe.so.4"
    library.parent.mkdir()
    library.touch()
    names = ("embreex/__init__.py", "embreex.libs/libtbb-1.so.12", "embreex.libs/" + library.name)
    list_files(monkeypatch, tmp_path, *names)
    assert embree_library_path() == library


@pytest.mark.parametrize(
    "names", [(), ("embreex/__init__.py",), ("embreex.libs/libembree4-deleted.so.4",)]
)
def test_embree_library_when_embreex_brought_none_is_unavailable(
    names: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    list_files(monkeypatch, tmp_path, *names)
    with pytest.raises(KernelUnavailableError, match="embreex has no file"):
        embree_library_path()


def test_embree_library_when_embreex_has_no_list_of_files_is_unavailable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(importlib.metadata, "files", lambda package: None)
    with pytest.raises(KernelUnavailableError, match="embreex has no file"):
        embree_library_path()


def test_embree_library_when_embreex_is_missing_is_unavailable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def find_none(package: str) -> None:
        raise importlib.metadata.PackageNotFoundError(package)

    monkeypatch.setattr(importlib.metadata, "files", find_none)
    with pytest.raises(KernelUnavailableError, match="embreex is not installed"):
        embree_library_path()
