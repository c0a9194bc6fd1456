"""Instruction sets by the flags of a processor, and the choice among them."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.render.trace.kernel import library as instruction_sets
from catoptra_server.render.trace.kernel.library import (
    available_instruction_sets,
    choose_instruction_set,
)

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
    monkeypatch.setattr(instruction_sets, "available_instruction_sets", lambda: ("avx2", "sse4.2"))


@pytest.mark.usefixtures("avx2_processor")
@pytest.mark.parametrize(
    ("requested", "chosen"), [("auto", "avx2"), ("avx2", "avx2"), ("sse4.2", "sse4.2")]
)
def test_choice_is_the_requested_set_or_the_best(requested: str, chosen: str) -> None:
    assert choose_instruction_set(requested) == chosen


@pytest.mark.usefixtures("avx2_processor")
def test_choice_when_the_processor_lacks_the_set_names_those_that_it_has() -> None:
    with pytest.raises(DomainError, match=r"no avx512; it has avx2, sse4\.2"):
        choose_instruction_set("avx512")


@pytest.mark.parametrize("requested", ["", "AVX2", "sse2", "avx2,threads=9"])
def test_choice_when_unknown_names_all_sets(requested: str) -> None:
    with pytest.raises(DomainError, match=r"auto, avx512, avx2, sse4\.2, not "):
        choose_instruction_set(requested)
