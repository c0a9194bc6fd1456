"""The line of --version names the kernel's instruction set, or why there is no kernel."""

from __future__ import annotations

from importlib import metadata

import pytest

from catoptra_server.commands.list import describe_version
from catoptra_server.render.trace.kernel.library import INSTRUCTION_SETS
from helpers.trace_kernels import open_kernel
from helpers.worlds import make_test_world


def test_version_with_a_kernel_names_the_instruction_set() -> None:
    with open_kernel(make_test_world()):
        line = describe_version()
    assert line.startswith(f"catoptra-server {metadata.version('catoptra-server')} (Python 3.")
    assert line.rpartition("kernel: ")[2].rstrip(")") in INSTRUCTION_SETS


def test_version_without_a_kernel_has_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CATOPTRA_KERNEL", "off")
    line = describe_version()
    assert "no native kernel: CATOPTRA_KERNEL=off" in line
    assert "\n" not in line
