"""Run the results of `helpers.result_hashes` on an emulated ARM processor, and compare: `make arm`.

Debian's Python for arm64 and the wheels of constraints.txt are unpacked into out/arm, where they
stay; without root rights or binfmt. The kernel is cross-compiled, and QEMU runs all. The hashes
have to be those of each library of this x86-64 processor.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
FOLDER = REPOSITORY / "out" / "arm"
sys.path.insert(0, str(REPOSITORY / "server"))
import build_kernel  # noqa: E402 # no package holds it

_PACKAGES = ("python3.11", "libpython3.11-stdlib", "libstdc++6")
_WHEELS = ("numpy", "msgpack", "pillow", "opencv-contrib-python-headless", "trimesh", "pycollada")
_KERNEL = Path("server/src") / build_kernel.KERNEL_PACKAGE
_TARGET, _PROCESSORS, _ = build_kernel.PLATFORMS["linux aarch64"]


def main() -> None:
    """Set up what is missing, run, and compare."""
    if shutil.which("apt-get") is None or build_kernel.PLATFORM != "linux x86_64":
        sys.exit("skipped: Debian's packages for ARM need apt-get, on Linux with x86-64")
    FOLDER.mkdir(parents=True, exist_ok=True)
    if not (FOLDER / "site").is_dir():
        _unpack_debian()
        _unpack_wheels()
    _copy_sources()
    root = FOLDER / "tree"
    folders = [root / name for name in ("server/src", "protocol/src", "tests", "metadata")]
    program = [*_qemu(), "-L", FOLDER / "root", FOLDER / "root/usr/bin/python3.11"]
    found = _run([*program, "-m", "helpers.result_hashes"], [*folders, FOLDER / "site"])
    (FOLDER / "arm.txt").write_text(found, encoding="utf-8")
    for name in ("sse4.2", "avx2", "avx512"):
        words = [sys.executable, "-m", "helpers.result_hashes"]
        expected = _run(words, [REPOSITORY / "tests"], CATOPTRA_KERNEL=name)
        different = set(found.splitlines()) ^ set(expected.splitlines())
        if different:
            sys.exit(f"ARM and {name} differ:\n" + "\n".join(sorted(different)))
        print(f"{len(found.splitlines())} hashes of ARM are those of {name}")


def _unpack_debian() -> None:
    """Download Python for arm64 and QEMU, by lists and a cache of their own, and unpack both."""
    state = FOLDER / "apt"
    for name in ("lists/partial", "cache/archives/partial"):
        (state / name).mkdir(parents=True, exist_ok=True)
    (state / "status").touch()
    settings = {
        "APT::Architecture": "arm64",
        "APT::Architectures::": "arm64",
        "Dir::State": state,
        "Dir::State::lists": state / "lists",
        "Dir::State::status": state / "status",
        "Dir::Cache": state / "cache",
        "Debug::NoLocking": "1",
    }
    apt = ["apt-get", "--quiet", *(f"--option={key}={value}" for key, value in settings.items())]
    _run([*apt, "update"])
    _run([*apt, "install", "--yes", "--no-install-recommends", "--download-only", *_PACKAGES])
    for package in (state / "cache/archives").glob("*.deb"):
        _run(["dpkg", "-x", package, FOLDER / "root"])
    if shutil.which("qemu-aarch64-static") is None:
        _run(["apt-get", "--quiet", "download", "qemu-user-static"], folder=FOLDER)
        _run(["dpkg", "-x", next(FOLDER.glob("qemu-user-static*.deb")), FOLDER / "host"])


def _qemu() -> list[str | Path]:
    return [shutil.which("qemu-aarch64-static") or FOLDER / "host/usr/bin/qemu-aarch64-static"]


def _unpack_wheels() -> None:
    """Download the wheels of the tested versions, and unpack them."""
    constraints = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8")
    pins = [re.search(rf"(?m)^{name}==.*$", constraints)[0] for name in _WHEELS]  # type: ignore[index]
    platforms = [f"--platform=manylinux_2_{minor}_aarch64" for minor in (17, 27, 28)]
    words = ["--quiet", "--only-binary=:all:", "--python-version=3.11", "--implementation=cp"]
    words += ["--abi=cp311", "--abi=abi3", "--abi=none", "--platform=manylinux2014_aarch64"]
    pip = [sys.executable, "-m", "pip", "download", *words, *platforms]
    _run([*pip, "--dest", FOLDER / "wheels", *pins])
    for wheel in (FOLDER / "wheels").glob("*.whl"):
        zipfile.ZipFile(wheel).extractall(FOLDER / "site")


def _copy_sources() -> None:
    """Copy what the results need, with the kernel of ARM in place of this processor's."""
    tree = FOLDER / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    ignored = shutil.ignore_patterns("__pycache__", "libcatoptra_trace*", "not_built.txt")
    for name in ("server/src", "protocol/src", "tests/helpers", "configs"):
        shutil.copytree(REPOSITORY / name, tree / name, ignore=ignored)
    installed = Path(next(path for path in sys.path if path.endswith("site-packages")))
    for found in installed.glob("catoptra_*.dist-info"):
        shutil.copytree(found, tree / "metadata" / found.name)
    sources = sorted(build_kernel.SOURCE_FOLDER.glob("*.c"))
    (FOLDER / "build").mkdir(exist_ok=True)
    for name, processor in _PROCESSORS.items():
        library = build_kernel.build_library(
            sources, name, processor, FOLDER / "build", target=_TARGET
        )
        shutil.copy2(library, tree / _KERNEL / name)


def _run(words: list[str | Path], paths: list[Path] | None = None, **variables: object) -> str:
    """Output of a program; its errors go to the terminal."""
    folder = variables.pop("folder", None)
    path = {"PYTHONPATH": os.pathsep.join(map(str, paths))} if paths else {}
    environment = {**os.environ, **path, **{name: str(v) for name, v in variables.items()}}
    return subprocess.run(
        list(map(str, words)), env=environment, cwd=folder, check=True, stdout=-1, text=True
    ).stdout


if __name__ == "__main__":
    main()
