"""Pinned processes: functions that run in them, their environment, and workers that differ."""

from __future__ import annotations

import os
import signal

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.pinned_process import (
    WorkerRefusedError,
    describe_environment,
    pinning_variables,
    require_environment,
    run_in_pinned_process,
)
from catoptra_server.render.trace.kernel.library import available_instruction_sets


def read_variable(name: str) -> str | None:
    """Variable of this process."""
    return os.environ.get(name)


def fail() -> None:
    """Raise an error of ours."""
    raise CatoptraError("recipe.ini:3: wrong")


def die() -> None:
    """End as a killed process does."""
    os.kill(os.getpid(), signal.SIGKILL)


def test_process_has_the_variables_and_this_one_has_not() -> None:
    before = os.environ.get("OPENBLAS_CORETYPE")
    assert run_in_pinned_process("avx2", read_variable, "OPENBLAS_CORETYPE") == "Haswell"
    assert os.environ.get("OPENBLAS_CORETYPE") == before


def test_error_of_the_function_is_raised_here() -> None:
    with pytest.raises(CatoptraError, match=r"recipe.ini:3: wrong"):
        run_in_pinned_process("avx2", fail)


def test_death_is_an_error() -> None:
    with pytest.raises(CatoptraError, match="has ended: exit status -9"):
        run_in_pinned_process("avx2", die)


HAS_AVX2 = "avx2" in available_instruction_sets()
needs_avx2 = pytest.mark.skipif(not HAS_AVX2, reason="needs a processor with AVX2")


def test_environment_names_code_and_libraries() -> None:
    environment = describe_environment("avx2")
    assert {"code_version", "code_sha256", "kernel_sha256", "numpy", "png_encoder", "libc"} <= {
        *environment
    }
    assert all(environment.values())


def test_variables_disable_what_is_beyond_the_instruction_set() -> None:
    disabled = {
        name: set(pinning_variables(name)["NPY_DISABLE_CPU_FEATURES"].split())
        for name in ("avx512", "avx2", "sse4.2")
    }
    assert not disabled["avx512"]
    assert disabled["avx2"] <= disabled["sse4.2"]
    assert not {"AVX2", "X86_V3"} & disabled["avx2"]


@needs_avx2
def test_pinned_process_may_draw() -> None:
    run_in_pinned_process("avx2", require_environment, {}, "avx2")


@pytest.mark.skipif(
    "avx512" not in available_instruction_sets(), reason="needs a processor with AVX-512"
)
def test_process_that_uses_more_is_refused_with_the_remedy() -> None:
    with pytest.raises(CatoptraError, match=r"beyond avx2.*NPY_DISABLE_CPU_FEATURES="):
        run_in_pinned_process("avx512", require_environment, {}, "avx2")


@needs_avx2
def test_worker_with_another_version_is_refused_by_name() -> None:
    environment = describe_environment("avx2")
    run_in_pinned_process("avx2", require_environment, environment, "avx2")
    other = {**environment, "numpy": "1.0"}
    with pytest.raises(CatoptraError, match=r"^this worker differs: numpy \S+ instead of 1\.0$"):
        run_in_pinned_process("avx2", require_environment, other, "avx2")


def test_processor_without_the_instruction_set_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "catoptra_server.render.trace.kernel.library.available_instruction_sets",
        lambda: ("sse4.2",),
    )
    with pytest.raises(WorkerRefusedError, match="this processor has no avx2"):
        require_environment({}, "avx2")
