"""The command as a program: whole, killed, resumed, interrupted, refused."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import time
from pathlib import Path

import pytest

from catoptra_server.__main__ import main
from helpers.dataset_recipes import write_drive, write_recipe
from helpers.dataset_runs import COMMAND, TIMEOUT_S, read_hashes, run_dataset


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a whole data set, beside its recipe."""
    folder = tmp_path_factory.mktemp("whole")
    done = run_dataset(write_drive(folder), folder / "out", "--workers", "1")
    assert done.returncode == 0, done.stderr
    return folder / "out"


def wait_for_shard(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Wait until the first record of a shard is on disk."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while not [*folder.glob("shards/*.json")]:
        assert process.poll() is None, "the run has ended before its first shard"
        assert time.monotonic() < deadline_s
        select.select([], [], [], 0.01)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_run_after_a_signal_goes_on_and_has_the_same_bytes(
    whole: Path, tmp_path: Path, number: signal.Signals
) -> None:
    recipe, folder = whole.parent / "recipe.ini", tmp_path / "out"
    process = subprocess.Popen(
        [*COMMAND, str(recipe), "--out", str(folder), "--workers", "1"], stderr=subprocess.PIPE
    )
    wait_for_shard(process, folder)
    os.kill(process.pid, number)
    _, errors = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == (-9 if number is signal.SIGKILL else 130)
    if number is signal.SIGINT:
        assert b"the same command goes on" in errors
    assert not (folder / "dataset.json").exists()
    done = run_dataset(recipe, folder, "--workers", "2", "--verify")
    assert done.returncode == 0, done.stderr
    assert "all 6 samples" in done.stdout
    assert read_hashes(folder) == read_hashes(whole)


def test_interrupt_of_the_group_while_workers_load_is_one_line(whole: Path, tmp_path: Path) -> None:
    command = [*COMMAND, str(whole.parent / "recipe.ini"), "--out", str(tmp_path / "out")]
    process = subprocess.Popen(
        [*command, "--workers", "2"], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    deadline_s = time.monotonic() + TIMEOUT_S
    # The tracker of resources and both workers, which have loaded nothing yet.
    while len(children.read_text().split()) < 3:
        assert time.monotonic() < deadline_s
        select.select([], [], [], 0.01)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 130
    assert errors == "catoptra-server: interrupted; the same command goes on\n"


def test_whole_data_set_is_not_drawn_again(whole: Path) -> None:
    times = {path: path.stat().st_mtime_ns for path in whole.rglob("*")}
    done = run_dataset(whole.parent / "recipe.ini", whole)
    assert done.returncode == 0, done.stderr
    assert {path: path.stat().st_mtime_ns for path in whole.rglob("*")} == times


def test_verification_needs_no_recipe_and_finds_damage(
    whole: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "--out", str(whole), "--verify"]) == 0
    assert "all 6 samples are as they were written" in capsys.readouterr().out


def test_folder_of_another_recipe_is_refused(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe = write_recipe(tmp_path)
    assert main(["dataset", str(recipe), "--out", str(whole)]) == 1
    assert "holds samples of another recipe" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("Smaples=3",), "recipe.ini:8: Catoptra.Dataset.Smaples='3': expected a known key"),
        (("Channels=rnage",), "did you mean range?"),
        (("Worlds=marz",), "marz"),
    ],
)
def test_bad_recipe_is_an_error_and_makes_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lines: tuple[str, ...], message: str
) -> None:
    recipe = write_recipe(tmp_path, lines=lines)
    assert main(["dataset", str(recipe), "--out", str(tmp_path / "out")]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_missing_recipe_is_an_error(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for words, message in ((["feild_tour"], "datasets"), ([], "RECIPE")):
        with pytest.raises(SystemExit):
            main(["dataset", *words, "--out", str(tmp_path / "out")])
        assert message in capsys.readouterr().err


@pytest.mark.parametrize("workers", ["0", "-1", "many", "5000"])
def test_impossible_number_of_workers_is_refused(tmp_path: Path, workers: str) -> None:
    with pytest.raises(SystemExit):
        main(["dataset", "r.ini", "--out", str(tmp_path), "--workers", workers])
