"""What bytes depend on beside the recipe, and workers that differ."""

from __future__ import annotations

import pytest

from catoptra_server.datasets.local_workers import run_in_pinned_process
from catoptra_server.datasets.sample_renderer import (
    describe_environment,
    find_environment_error,
    find_processor_error,
    pinning_variables,
)
from catoptra_server.render.trace.kernel.library import available_instruction_sets

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
    assert run_in_pinned_process("avx2", find_processor_error, "avx2") == ""


@pytest.mark.skipif(
    "avx512" not in available_instruction_sets(), reason="needs a processor with AVX-512"
)
def test_process_that_uses_more_is_refused_with_the_remedy() -> None:
    fault = run_in_pinned_process("avx512", find_processor_error, "avx2")
    assert "beyond avx2" in fault
    assert "NPY_DISABLE_CPU_FEATURES=" in fault


@needs_avx2
def test_worker_with_another_version_is_refused_by_name() -> None:
    environment = describe_environment("avx2")
    assert not run_in_pinned_process("avx2", find_environment_error, environment, "avx2")
    other = {**environment, "numpy": "1.0"}
    fault = run_in_pinned_process("avx2", find_environment_error, other, "avx2")
    assert fault.startswith("this worker differs: numpy ")
    assert fault.endswith(" instead of 1.0")


def test_processor_without_the_instruction_set_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "catoptra_server.render.trace.kernel.library.available_instruction_sets",
        lambda: ("sse4.2",),
    )
    assert "this processor has no avx2" in find_processor_error("avx2")
