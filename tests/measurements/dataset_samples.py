"""Processor time and bytes of a sample, by what its recipe stores, and of reading shards back.

    python tests/measurements/dataset_samples.py [--samples 24] [--vary four_legged_2006]

One process, one thread, pinned like a worker; the first sample of each recipe, which prepares rays,
is not counted. Recipes take turns sample by sample.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from catoptra_protocol.shards import hash_file, iterate_samples, shard_name
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.sample import SampleDescriber, encode_sample
from catoptra_server.datasets.sample_renderer import SampleRenderer
from catoptra_server.datasets.shards import write_shard

KINDS = {
    "picture": "",
    "picture, range": "Channels=range",
    "picture, all channels but ids": "Channels=range,normal,point,classes,agreement,flow,valid",
    "picture, all channels, annotations, compressed": "Channels=all\nCompression=zstd",
    "picture, all channels, annotations": "Channels=all",
}
RECIPE = """[Catoptra.Dataset]
Samples={samples}
Worlds=four_legged_2006
Cameras=(Robot="p2at_omni")
Poses=drive
{channels}
[Catoptra.DrivePoses]
Samples={samples}
X=(Min=-2.2,Max=2.2)
Y=(Min=-1.4,Max=1.4)
"""

VARIED = {
    "nothing": "",
    "colours, textures": "Textures=all\nColours=(Min=0.2,Max=1)\n",
    "3 lamps": "Lamps=3\n",
    "8 distractors": "Distractors=(Min=0,Max=8)\n",
    "a robot": 'Robots=(Robot="p2dx")\n',
    "the mount": "MountShift=0.01\nMountTurn=0.02\n",
}
VARIED_RECIPE = """[Catoptra.Dataset]
Samples={samples}
Worlds={world}
Cameras=(Robot="p2at_omni",Width=240,Height=240)
Poses=random
Channels=range,classes
"""


def measure_varied(samples: int, world: str) -> str:
    """Processor time of a sample without annotations, by what varies."""
    keys = {**VARIED, "all of these": "".join(VARIED.values())}
    artists = {}
    with tempfile.TemporaryDirectory() as name:
        path = Path(name, "recipe.ini")
        for kind, lines in keys.items():
            text = VARIED_RECIPE.format(samples=samples + 1, world=world)
            path.write_text(text + f"[Catoptra.Randomise]\n{lines}" * bool(lines), "utf-8")
            stage = DatasetStage(read_recipe(path))
            artists[kind] = SampleDescriber(stage), SampleRenderer(stage)
    times: dict[str, list[float]] = {kind: [] for kind in artists}
    for index in range(samples + 1):
        for kind, (describer, renderer) in artists.items():
            begin_s = time.process_time()
            renderer.render_sample(describer.describe_sample(index))
            times[kind].append(time.process_time() - begin_s)
    medians = {kind: 1e3 * statistics.median(of[1:]) for kind, of in times.items()}
    return "\n".join(f"{kind}: {median:.1f} ms" for kind, median in medians.items())


def measure(samples: int) -> str:
    """Table of all kinds, and rates of reading."""
    lines = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        artists = {}
        for kind, channels in KINDS.items():
            path = folder / "recipe.ini"
            path.write_text(RECIPE.format(samples=samples + 1, channels=channels), "utf-8")
            stage = DatasetStage(read_recipe(path))
            compression = stage.recipe.compression
            artists[kind] = SampleDescriber(stage), SampleRenderer(stage), compression
        times: dict[str, list[float]] = {kind: [] for kind in KINDS}
        files: dict[str, list[tuple[str, dict[str, bytes]]]] = {kind: [] for kind in KINDS}
        for index in range(samples + 1):
            for kind, (describer, renderer, compression) in artists.items():
                begin_s = time.process_time()
                sample = renderer.render_sample(describer.describe_sample(index))
                files[kind].append((sample.key, encode_sample(sample, compression)))
                times[kind].append(time.process_time() - begin_s)
        for kind in KINDS:
            median_ms = 1e3 * statistics.median(times[kind][1:])
            size = sum(len(part) for _, parts in files[kind] for part in parts.values())
            lines.append(f"{kind}: {median_ms:.0f} ms, {size / (samples + 1) / 1e3:.0f} kB")
        record = write_shard(folder, 0, files[[*KINDS][-1]])
        path = folder / shard_name(0)
        for label, read in {
            "hash": lambda: hash_file(path),
            "metadata alone": lambda: list(iterate_samples(path, frozenset({"json"}))),
        }.items():
            begin_s = time.process_time()
            read()
            rate = record.num_bytes / (time.process_time() - begin_s)
            lines.append(f"{label}: {rate / 1e6:.0f} MB of a shard a second")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=24)
    parser.add_argument("--vary", default="", help="world whose looks and objects vary instead")
    parsed = parser.parse_args()
    vary = parsed.vary
    print(measure_varied(parsed.samples, vary) if vary else measure(parsed.samples))


if __name__ == "__main__":
    main()
