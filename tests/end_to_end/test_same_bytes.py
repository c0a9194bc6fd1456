"""The same bytes whatever code libraries choose for the processor: results of shipped worlds."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from catoptra_server.render.trace.kernel.library import available_instruction_sets
from helpers.configs import REPOSITORY

# The oldest processor of x86-64 that the kernel has a library for: NumPy's vector code, OpenBLAS
# and the C library's fused sums and products are off.
OLD_PROCESSOR = {
    "CATOPTRA_KERNEL": "sse4.2",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Nehalem",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
}


def hash_results(**variables: str) -> list[str]:
    """Lines of `helpers.result_hashes` in a process with some environment variables."""
    path = os.pathsep.join((str(REPOSITORY / "tests"), os.environ.get("PYTHONPATH", "")))
    ended = subprocess.run(
        [sys.executable, "-m", "helpers.result_hashes"],
        env={**os.environ, "PYTHONPATH": path, **variables},
        check=True,
        capture_output=True,
        text=True,
    )
    return ended.stdout.splitlines()


@pytest.mark.skipif(
    "neon" in available_instruction_sets(), reason="compares instruction sets of x86-64"
)
def test_results_of_an_old_processor_are_those_of_this_one() -> None:
    expected = hash_results()
    assert len(expected) > 100
    assert hash_results(**OLD_PROCESSOR) == expected
