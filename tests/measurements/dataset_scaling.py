"""How the rate of a data set grows with local workers of one thread each, and what a sample takes.

    python tests/measurements/dataset_scaling.py [--workers 1 2] [--runs 3] [--shards 8]

Runs of each number of workers take turns; medians count. The clock of a run begins when its last
worker begins its first sample, with all shards queued, and ends with the last record: the start of
processes, 2 to 3 s each, is reported apart. Writing and fsync are included.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.dataset_run import DatasetRun
from catoptra_server.datasets.local_workers import LocalWorkers
from catoptra_server.datasets.shards import ShardJob
from catoptra_server.runtime.memory import count_processors

SAMPLES_A_SHARD = 6
RECIPE = """[Catoptra.Dataset]
Samples={samples}
ShardSamples={shard}
Worlds=four_legged_2006
Cameras=(Robot="p2at_omni")
Poses=drive
Channels={channels}
[Catoptra.DrivePoses]
Samples={shard}
X=(Min=-2.2,Max=2.2)
Y=(Min=-1.4,Max=1.4)
"""


@dataclass(frozen=True, slots=True)
class Run:
    """One run."""

    start_s: float
    """Until the last worker begins its first sample."""
    samples_per_s: float
    bytes_per_sample: float


def measure(job: ShardJob, num_shards: int, workers: int) -> Run:
    """Draw all shards anew."""
    begun: list[float] = []
    drawing = LocalWorkers(job, workers, count=lambda *_: begun.append(time.perf_counter()))
    begin_s = time.perf_counter()
    records = list(drawing.draw(range(num_shards)))
    end_s = time.perf_counter()
    # The samples that are begun before all workers work are not counted.
    first_s = begun[workers - 1]
    samples = sum(record.num_samples for record in records) - (workers - 1)
    size = sum(record.num_bytes for record in records) / (num_shards * SAMPLES_A_SHARD)
    return Run(first_s - begin_s, samples / (end_s - first_s), size)


def main() -> None:
    """Print the medians of each number of workers, and their ratio to one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, nargs="+", default=[1, count_processors()])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--shards", type=int, default=8)
    parser.add_argument(
        "--channels", default="all", help="as in a recipe; `` for the picture alone"
    )
    parsed = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        recipe = Path(folder, "recipe.ini")
        text = RECIPE.format(
            samples=parsed.shards * SAMPLES_A_SHARD, shard=SAMPLES_A_SHARD, channels=parsed.channels
        )
        recipe.write_text(text, encoding="utf-8")
        job = DatasetRun(recipe, Path(folder, "out")).job
        runs: dict[int, list[Run]] = {workers: [] for workers in parsed.workers}
        for _ in range(parsed.runs):
            for workers, found in runs.items():
                found.append(measure(job, parsed.shards, workers))
    rates = {w: statistics.median(run.samples_per_s for run in found) for w, found in runs.items()}
    for workers, found in runs.items():
        each = ", ".join(f"{run.samples_per_s:.2f}" for run in found)
        start_s = statistics.median(run.start_s for run in found)
        print(
            f"{workers} workers: {rates[workers]:.2f} samples/s ({each}), start {start_s:.1f} s, "
            f"{found[0].bytes_per_sample / 1e6:.2f} MB a sample"
        )
    one = min(rates)
    for workers, rate in rates.items():
        print(f"{workers} workers: {rate * one / (rates[one] * workers):.3f} of linear")


if __name__ == "__main__":
    main()
