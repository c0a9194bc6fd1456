"""Build steps of the server beyond `pyproject.toml`: the native kernel and the tag of its wheel."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import ClassVar

from setuptools import Command, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build import build
from setuptools.command.install import install

# A build backend runs this file without its folder on the path.
sys.path.insert(0, str(Path(__file__).resolve().parent))
from build_kernel import (
    KERNEL_PACKAGE,
    PACKAGE_ROOT,
    PROCESSOR_OF_LIBRARY,
    REASON_NAME,
    SOURCE_FOLDER,
    WHEEL_TAG,
    build_or_explain,
)

ROOT = Path(__file__).resolve().parent


class BuildKernel(Command):
    """Step of `build`: the kernel's libraries beside the package's modules."""

    description = "compile the native kernel of the trace renderer"
    user_options: ClassVar = [("build-lib=", "d", "folder of the built package")]

    def initialize_options(self) -> None:
        """Options before the command line is read; setuptools sets `editable_mode` itself."""
        self.build_lib: str = ""
        self.editable_mode = False
        self.built = False

    def finalize_options(self) -> None:
        """Take the folder of the built package from `build`."""
        self.build_lib = self.build_lib or self.get_finalized_command("build").build_lib

    def run(self) -> None:
        """Build the libraries, in the source tree for an editable install."""
        root = PACKAGE_ROOT if self.editable_mode else Path(self.build_lib)
        self.built = build_or_explain(root / KERNEL_PACKAGE)

    def get_source_files(self) -> list[str]:
        """Files that the source distribution needs for this step, relative to this file."""
        files = [ROOT / "build_kernel.py", *sorted(SOURCE_FOLDER.glob("*.[ch]"))]
        return [path.relative_to(ROOT).as_posix() for path in files]

    def get_outputs(self) -> list[str]:
        """Paths of the files that this step writes into the built package."""
        names = PROCESSOR_OF_LIBRARY if self.built else (REASON_NAME,)
        return [str(Path(self.build_lib) / KERNEL_PACKAGE / name) for name in names]

    def get_output_mapping(self) -> dict[str, str]:
        """No output is a copy of a source."""
        return {}


class BuildWithKernel(build):
    """The steps of `build`, the kernel's last."""

    sub_commands: ClassVar = [*build.sub_commands, ("build_kernel", None)]


class InstallWithKernel(install):
    """Installation into the folder for platform-dependent packages if there is a kernel."""

    def finalize_options(self) -> None:
        """Choose the folder of the package: setuptools does so by extension modules alone."""
        super().finalize_options()
        if self.get_finalized_command("build_kernel").built:
            self.install_lib = self.install_platlib


class KernelWheel(bdist_wheel):
    """A wheel for one platform and every Python with the kernel, for all platforms without it."""

    def run(self) -> None:
        """Build before the tag is chosen, since only then it is known whether a kernel exists."""
        self.run_command("build")
        self.root_is_pure = not self.get_finalized_command("build_kernel").built
        super().run()

    def get_tag(self) -> tuple[str, str, str]:
        """Tag of the wheel: the kernel is loaded by ctypes and knows no version of Python."""
        if self.root_is_pure:
            return super().get_tag()
        return "py3", "none", WHEEL_TAG


setup(
    cmdclass={
        "build": BuildWithKernel,
        "build_kernel": BuildKernel,
        "install": InstallWithKernel,
        "bdist_wheel": KernelWheel,
    }
)
