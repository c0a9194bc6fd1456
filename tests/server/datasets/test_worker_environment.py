"""Code and libraries of workers, and workers that differ."""

from __future__ import annotations

import pytest

from catoptra_server.datasets.worker_environment import (
    WorkerRefusedError,
    describe_environment,
    require_environment,
)
from catoptra_server.render.trace.kernel import library


def test_environment_names_code_and_libraries() -> None:
    environment = describe_environment()
    assert {"code_version", "code_sha256", "kernel_sha256", "numpy", "png_encoder"} <= {
        *environment
    }
    assert all(environment.values())
    require_environment(environment)


def test_environment_is_the_same_for_all_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = describe_environment()
    describe_environment.cache_clear()
    monkeypatch.setattr(library, "available_instruction_sets", lambda: ("sse4.2",))
    assert describe_environment() == environment


def test_worker_with_another_version_is_refused_by_name() -> None:
    other = {**describe_environment(), "numpy": "1.0"}
    with pytest.raises(
        WorkerRefusedError, match=r"^this worker differs: numpy \S+ instead of 1\.0$"
    ):
        require_environment(other)
