"""Shards drawn by Ray on this machine, where it is installed: the bytes of local workers."""

from __future__ import annotations

import builtins
import importlib.util
import os
import select
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.ray_workers import draw_shard_of_job, require_ray
from catoptra_server.datasets.shards import ShardJob
from helpers.dataset_recipes import RANDOMISED, write_drive
from helpers.dataset_runs import COMMAND, TIMEOUT_S, read_hashes, run_dataset

needs_ray = pytest.mark.skipif(
    importlib.util.find_spec("ray") is None, reason="needs the extra [ray]"
)


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a data set that local workers have drawn, beside its recipe."""
    root = tmp_path_factory.mktemp("local")
    done = run_dataset(write_drive(root, *RANDOMISED), root / "out")
    assert done.returncode == 0, done.stderr
    return root / "out"


@needs_ray
def test_ray_writes_the_bytes_of_local_workers(local: Path, tmp_path: Path) -> None:
    done = run_dataset(local.parent / "recipe.ini", tmp_path / "out", "--ray", "local", "--verify")
    assert done.returncode == 0, done.stderr
    assert read_hashes(tmp_path / "out") == read_hashes(local)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
@needs_ray
def test_run_whose_worker_is_killed_or_that_is_interrupted_has_the_same_bytes(
    local: Path, tmp_path: Path, number: signal.Signals
) -> None:
    recipe, folder = local.parent / "recipe.ini", tmp_path / "out"
    process = subprocess.Popen(
        [*COMMAND, str(recipe), "--out", str(folder), "--ray", "local"], stderr=subprocess.PIPE
    )
    # The unfinished file of a shard has the number of its process in its name.
    deadline_s = time.monotonic() + TIMEOUT_S
    while not (parts := [*folder.glob("shards/*.tar.*.part")]):
        assert process.poll() is None, "the run has ended before a shard was begun"
        assert time.monotonic() < deadline_s
        select.select([], [], [], 0.001)
    worker = int(parts[0].name.split(".")[-2])
    os.kill(worker if number is signal.SIGKILL else process.pid, number)
    _, errors = process.communicate(timeout=TIMEOUT_S)
    if number is signal.SIGINT:
        assert process.returncode == 130
        assert not (folder / "dataset.json").exists()
        # What Ray has begun, local workers may finish.
        done = run_dataset(recipe, folder)
        assert done.returncode == 0, done.stderr
    else:
        assert process.returncode == 0, errors.decode()
    assert read_hashes(folder) == read_hashes(local)


@needs_ray
def test_address_without_a_cluster_is_an_error(local: Path, tmp_path: Path) -> None:
    recipe = local.parent / "recipe.ini"
    done = run_dataset(recipe, tmp_path / "out", "--ray", "auto")
    assert done.returncode == 2
    assert "no Ray cluster at auto" in done.stderr


def test_missing_package_is_an_error_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "ray":
            raise ImportError(name)
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(CatoptraError, match=r"pip install 'catoptra-server\[ray\]'"):
        require_ray()


def test_worker_that_differs_says_so_instead_of_failing(tmp_path: Path) -> None:
    job = ShardJob(str(write_drive(tmp_path)), str(tmp_path), "0" * 64, {"numpy": "1"})
    answer = draw_shard_of_job(job, 0)
    assert isinstance(answer, str)
    assert "instead of 1" in answer
