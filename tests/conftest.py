"""Set-up of all tests: no cache folder of the user; no search for garbage; coroutines are run.

On a client's Python, which has no server, tests that import it are skipped.
"""

from __future__ import annotations

import gc
import inspect
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.loopback import run_scenario


class _SkipWithoutServer:
    """Last of the finders of modules: what is missing of a server skips its test."""

    def find_spec(self, name: str, *_: object) -> None:
        if name in ("catoptra_server", "catoptra_studies", "PIL"):
            pytest.skip(f"{name} is not installed", allow_module_level=True)


sys.meta_path.append(_SkipWithoutServer())


def pytest_collection_finish() -> None:
    """Take what lasts until the end, modules and 15 000 tests, out of every garbage collection."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine as a scenario of helpers.loopback."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    run_scenario(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Cache folder of this session, for servers that tests start as processes, too.

    Shared by the workers of a parallel run, which are sessions of their own: baked occlusion is the
    same for all, and files are renamed when they are complete.
    """
    folder = tmp_path_factory.getbasetemp()
    # Workers have folders of their own in that of the run.
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    folder = folder / "cache"
    folder.mkdir(exist_ok=True)
    before = os.environ.get("XDG_CACHE_HOME")
    os.environ["XDG_CACHE_HOME"] = str(folder)
    yield folder
    if before is None:
        del os.environ["XDG_CACHE_HOME"]
    else:
        os.environ["XDG_CACHE_HOME"] = before
