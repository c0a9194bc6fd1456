"""Instruction sets of this processor that Embree has code for."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import DomainError

AUTO = "auto"
INSTRUCTION_SETS = ("avx512", "avx2", "sse4.2")
"""Embree's names, best first."""

_CPU_INFO = Path("/proc/cpuinfo")
# What Embree requires of a processor, in the words of the kernel's list.
_REQUIRED_FLAGS = {
    "avx512": {"avx512f", "avx512dq", "avx512cd", "avx512bw", "avx512vl"},
    "avx2": {"avx2", "fma", "f16c", "bmi1", "bmi2"},
    "sse4.2": {"sse4_2"},
}


def choose_instruction_set(requested: str) -> str:
    """Embree's name of an instruction set; "auto" for the best that the processor has.

    Raises:
        DomainError: No such instruction set, or not on this processor.
    """
    available = available_instruction_sets()
    if requested == AUTO:
        return available[0]
    if requested not in INSTRUCTION_SETS:
        names = ", ".join((AUTO, *INSTRUCTION_SETS))
        raise DomainError(f"an instruction set is one of {names}, not {requested!r}")
    if requested not in available:
        raise DomainError(f"this processor has no {requested}; it has {', '.join(available)}")
    return requested


def available_instruction_sets(cpu_info: Path = _CPU_INFO) -> tuple[str, ...]:
    """Instruction sets of the processor, best first; SSE4.2, which the kernel needs, is assumed."""
    flags = _read_flags(cpu_info)
    found = (name for name in INSTRUCTION_SETS if _REQUIRED_FLAGS[name] <= flags)
    return tuple(found) or ("sse4.2",)


def _read_flags(cpu_info: Path) -> set[str]:
    """Flags of the first processor."""
    try:
        lines = cpu_info.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return set()
    line = next((line for line in lines if line.startswith("flags")), "")
    return set(line.partition(":")[2].split())
