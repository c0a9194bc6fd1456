"""A run from recipe to manifest, drawn by this process, with its progress."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.dataset_run import DatasetRun, ProgressReport
from helpers.dataset_recipes import write_drive, write_recipe
from helpers.drawn_datasets import draw_here


def test_run_ends_with_a_manifest_of_all_shards(tmp_path: Path) -> None:
    path, folder = write_drive(tmp_path), tmp_path / "out"
    run = DatasetRun(path, folder)
    assert run.missing == [0, 1, 2]
    run.complete(draw_here)
    manifest = json.loads((folder / "dataset.json").read_text(encoding="utf-8"))
    assert [shard["path"] for shard in manifest["shards"]] == [
        f"shards/00000{number}.tar" for number in range(3)
    ]
    assert manifest["samples"] == 6
    assert manifest["recipe"] == path.read_text(encoding="utf-8")
    assert manifest["environment"]["code_sha256"]
    again = DatasetRun(path, folder)
    assert again.is_whole
    assert not again.missing


def test_run_draws_missing_and_damaged_shards_alone(tmp_path: Path) -> None:
    path, folder = write_drive(tmp_path), tmp_path / "out"
    list(draw_here(DatasetRun(path, folder).job, [0, 1]))
    shard = folder / "shards/000001.tar"
    shard.write_bytes(shard.read_bytes()[:-5])
    run = DatasetRun(path, folder)
    assert run.missing == [1, 2]
    assert run.num_finished_samples == 2


def test_drawing_that_stops_early_leaves_no_manifest(tmp_path: Path) -> None:
    run = DatasetRun(write_drive(tmp_path), tmp_path / "out")
    with pytest.raises(CatoptraError, match="1 of 3 shards"):
        run.complete(lambda job, shards: draw_here(job, shards[:1]))
    assert not (tmp_path / "out/dataset.json").exists()


def test_pose_inside_a_wall_makes_no_folder(tmp_path: Path) -> None:
    grid = ("[Catoptra.GridPoses]", "X=(Min=0,Max=0,Count=1)", "Y=(Min=0,Max=1.06,Count=2)")
    path = write_recipe(tmp_path, *grid, samples=0, poses="grid")
    with pytest.raises(CatoptraError, match=r"recipe.ini:\d+: pose 2 .* is not free"):
        DatasetRun(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


class Clock:
    """Clock that a test sets."""

    now_s = 0.0

    def __call__(self) -> float:
        """Time."""
        return self.now_s


def test_line_has_counts_rate_and_remaining_time() -> None:
    clock, output = Clock(), io.StringIO()
    progress = ProgressReport("tour", 200, 40, output, clock)
    assert progress.describe() == "tour: 40 of 200 samples"
    for number in range(80):
        clock.now_s = 0.5 * (number + 1)
        progress.count_samples(1)
    assert progress.describe() == "tour: 120 of 200 samples, 2.0 a second, 40 s left"
    progress.uncount_samples(10)
    assert progress.describe().startswith("tour: 110 of 200")


def test_log_gets_a_line_seldom_and_one_at_the_end() -> None:
    clock, output = Clock(), io.StringIO()
    progress = ProgressReport("tour", 100, 0, output, clock)
    for number in range(100):
        clock.now_s = float(number)
        progress.count_samples(1)
    progress.finish()
    assert len(output.getvalue().splitlines()) == 4
    assert output.getvalue().endswith("left\n")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (59.4, "59 s"), (200.0, "3 min 20 s"), (7500.0, "2 h 05 min")],
)
def test_remaining_time_is_short(seconds: float, text: str) -> None:
    clock = Clock()
    progress = ProgressReport("tour", 2, 0, io.StringIO(), clock)
    clock.now_s = seconds
    progress.count_samples(1)
    assert progress.describe().endswith(f" a second, {text} left")
