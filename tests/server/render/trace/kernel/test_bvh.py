"""The hierarchy of boxes and the queries of rays, tested in C: `c/test_bvh.c` has the claims."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from helpers.kernel_programs import compile_bvh_test, has_zig


@pytest.mark.skipif(not has_zig(), reason="no compiler: the package ziglang is not installed")
def test_hierarchies_hold_every_triangle_and_rays_meet_the_nearest_of_all(tmp_path: Path) -> None:
    program = compile_bvh_test(tmp_path, "-O2", "-fno-sanitize=undefined")
    ended = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
