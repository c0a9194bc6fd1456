"""Paths of the kernel and of Embree, and the reasons for which one is missing."""

from __future__ import annotations

import ctypes
import importlib.util
from pathlib import Path

import pytest

from catoptra_server.render.trace.kernel import library as library_files
from catoptra_server.render.trace.kernel.library import (
    INSTRUCTION_SETS,
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


def install_embreex(monkeypatch: pytest.MonkeyPatch, site: Path, *names: str) -> None:
    """Let a folder of packages have embreex with these files beside it."""
    for name in ("embreex/__init__.py", *names):
        (site / name).parent.mkdir(exist_ok=True)
        (site / name).touch()
    spec = importlib.util.spec_from_file_location("embreex", site / "embreex/__init__.py")
    monkeypatch.setattr(importlib.util, "find_spec", lambda package: spec)


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
    name = "embreex.libs/libembree4-0badcafe.so.4"
    install_embreex(monkeypatch, tmp_path, "embreex.libs/libtbb-1.so.12", name)
    assert embree_library_path() == tmp_path / name


@pytest.mark.parametrize("names", [(), ("embreex.libs/libtbb-1.so.12",)])
def test_embree_library_when_embreex_brought_none_is_unavailable(
    names: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install_embreex(monkeypatch, tmp_path, *names)
    with pytest.raises(KernelUnavailableError, match="has no file libembree4") as caught:
        embree_library_path()
    assert str(tmp_path / "embreex.libs") in str(caught.value)


def test_embree_library_when_embreex_is_missing_is_unavailable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda package: None)
    with pytest.raises(KernelUnavailableError, match="embreex is not installed"):
        embree_library_path()
