"""Builds of the server from its sources, without the package that compiles the kernel.

Needs the package index: `make wheels` runs this.
"""

from __future__ import annotations

import shutil
import subprocess
import tarfile
from dataclasses import dataclass
from pathlib import Path

import pytest

from helpers.configs import REPOSITORY
from helpers.virtual_environments import (
    KERNEL,
    VirtualEnvironment,
    create_environment,
    find_wheel,
    list_wheel_files,
    needs_wheels,
)

pytestmark = needs_wheels


@dataclass(frozen=True, slots=True)
class SourceBuild:
    """A copy of the server's sources, and an environment that can build it without the compiler."""

    source: Path
    environment: VirtualEnvironment

    def build_wheel(self, folder: Path) -> subprocess.CompletedProcess[str]:
        """Build a wheel with nothing but what the environment holds."""
        return self.environment.run(
            *("python", "-m", "pip", "wheel", "--disable-pip-version-check", "--verbose"),
            *("--no-build-isolation", "--no-deps", "--wheel-dir", str(folder), str(self.source)),
        )


@pytest.fixture(scope="module")
def source_build(tmp_path_factory: pytest.TempPathFactory) -> SourceBuild:
    folder = tmp_path_factory.mktemp("source_build")
    # With the library of the developer's own build, which no wheel may take over.
    ignored = shutil.ignore_patterns("build", "*.egg-info", "__pycache__")
    shutil.copytree(REPOSITORY / "server", folder / "source", ignore=ignored)
    environment = create_environment(folder, ["catoptra-protocol"])
    added = environment.run(
        *("python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--upgrade"),
        *("--constraint", str(REPOSITORY / "constraints.txt"), "setuptools"),
    )
    assert added.returncode == 0, added.stderr
    return SourceBuild(folder / "source", environment)


def test_wheel_when_built_without_compiler_installs_and_states_the_reason(
    source_build: SourceBuild, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CATOPTRA_REQUIRE_KERNEL", raising=False)
    built = source_build.build_wheel(tmp_path)
    assert built.returncode == 0, built.stderr
    assert "warning: no native kernel: the package ziglang" in built.stdout + built.stderr
    wheel = find_wheel("catoptra_server", tmp_path)
    assert wheel.name == "catoptra_server-0.1.0-py3-none-any.whl"
    files = list_wheel_files("catoptra_server", tmp_path)
    assert [name for name in files if "libcatoptra_trace" in name] == []
    environment = source_build.environment
    installed = environment.run("python", "-m", "pip", "install", "--no-deps", str(wheel))
    assert installed.returncode == 0, installed.stderr
    # The module alone, without what the rest of the server imports.
    code = (
        "import importlib.util, pathlib, runpy\n"
        "package = pathlib.Path(importlib.util.find_spec('catoptra_server').origin).parents[1]\n"
        f"module = runpy.run_path(package / '{KERNEL}/library_files.py')\n"
        "module['kernel_library_path']('sse4.2')"
    )
    asked = environment.run("python", "-c", code)
    assert asked.returncode == 1
    assert "none was built at installation: the package ziglang" in asked.stderr


def test_wheel_when_the_kernel_is_required_is_not_built_without_compiler(
    source_build: SourceBuild, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CATOPTRA_REQUIRE_KERNEL", "1")
    built = source_build.build_wheel(tmp_path)
    assert built.returncode != 0
    assert "error: no native kernel: the package ziglang" in built.stdout + built.stderr
    assert list(tmp_path.iterdir()) == []


def test_source_distribution_holds_what_the_kernel_is_built_from(
    source_build: SourceBuild, tmp_path: Path
) -> None:
    code = (
        "import os, sys\n"
        "from setuptools import build_meta\n"
        "os.chdir(sys.argv[1])\n"
        "build_meta.build_sdist(sys.argv[2])"
    )
    words = ("-c", code, str(source_build.source), str(tmp_path))
    packed = source_build.environment.run("python", *words)
    assert packed.returncode == 0, packed.stderr
    (archive,) = tmp_path.iterdir()
    with tarfile.open(archive) as files:
        names = {name.partition("/")[2] for name in files.getnames()}
    sources = [*(REPOSITORY / f"server/src/{KERNEL}/src").glob("*.[ch]")]
    expected = {path.relative_to(REPOSITORY / "server").as_posix() for path in sources}
    assert expected
    assert names >= expected | {"setup.py", "build_kernel.py", "pyproject.toml"}
    assert [name for name in names if "libcatoptra_trace" in name] == []
