"""Train a segmenter on randomised and on plain pictures of a world, and test both in another.

    .venv/bin/python examples/train_segmenter.py --out out/segmenter

Draws three data sets: the bundled recipe `randomised`, the same without `[Catoptra.Randomise]`, and
plain pictures of the world `offices`. A pixel is floor, wall, ceiling or thing, by the numbers of
the recipe's classes. The network has two hidden layers and sees the colours around a pixel, along
the radius and across, less their mean: NumPy alone, a minute of one core for each training.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from catoptra_client.dataset import open_dataset
from catoptra_server.config.known_names import find_configuration

Float32s = npt.NDArray[np.float32]
GROUPS = ("floor", "wall", "ceiling", "thing")
FIRST_NUMBERS = (1, 10, 30, 40)  # of the classes of each group in the recipe
NOTHING = 255
# Pictures are resampled by azimuth and radius: what is up in the room is outwards everywhere.
AZIMUTHS, RADII = 96, 32
ACROSS, ALONG = (-12, -6, -3, -1, 0, 1, 3, 6, 12), (-9, -6, -4, -2, -1, 0, 1, 2, 4, 6, 9)
HIDDEN, BATCH, STEP, DECAY = (96, 48), 1024, 2e-3, (0.9, 0.999)


def main() -> None:
    """Draw, train and test, and print the mean intersection over union of both."""
    parser = argparse.ArgumentParser(description="Train on randomised and on plain pictures.")
    parser.add_argument("--out", type=Path, required=True, help="folder of data sets")
    parser.add_argument("--samples", type=int, default=2000, help="for each training")
    parser.add_argument("--tests", type=int, default=300, help="pictures of the other world")
    parser.add_argument("--world", default="offices", help="the other world")
    parser.add_argument("--steps", type=int, default=3000, help="of each training")
    parser.add_argument("--seed", type=int, default=0)
    parsed = parser.parse_args()
    recipe = find_configuration("datasets", "randomised").read_text(encoding="utf-8")
    recipe = re.sub(r"Samples=\d+", f"Samples={parsed.samples}", recipe, count=1)
    plain = re.sub(r"^\[Catoptra\.Randomise\].*?\n\n", "", recipe, flags=re.DOTALL | re.MULTILINE)
    other = re.sub(r"Worlds=\w+", f"Worlds={parsed.world}", plain)
    other = re.sub(r"Samples=\d+", f"Samples={parsed.tests}", other, count=1)
    tests = draw_pictures(parsed.out, parsed.world, other)
    for name, text in (("plain", plain), ("randomised", recipe)):
        pictures = draw_pictures(parsed.out, name, text)
        begin_s = time.process_time()
        network = train(*pictures, steps=parsed.steps, seed=parsed.seed)
        seconds = time.process_time() - begin_s
        shares = measure_overlap(network, *tests)
        each = ", ".join(
            f"{group} {share:.3f}" for group, share in zip(GROUPS, shares, strict=True)
        )
        print(f"{name}: mIoU {shares.mean():.3f} in {parsed.world} ({each}); {seconds:.0f} s")


def draw_pictures(folder: Path, name: str, text: str) -> tuple[Float32s, npt.NDArray[np.uint8]]:
    """(n, azimuth, radius, 3) colours and (n, azimuth, radius) groups of a recipe's pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    recipe, out = folder / f"{name}.ini", folder / name
    recipe.write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "catoptra_server", "dataset", str(recipe), "--out", str(out)]
    subprocess.run(command, check=True)
    colours, groups = [], []
    for sample in open_dataset(out).iterate(channels=["classes"]):
        rows, columns = find_pixels(len(sample.rgb))
        number = sample.channels["classes"][rows, columns]
        group = np.searchsorted(FIRST_NUMBERS, number, side="right") - 1
        groups.append(np.where(number == 0, NOTHING, group).astype(np.uint8))
        colours.append((sample.rgb[rows, columns] / 255.0).astype(np.float32))
    return np.array(colours), np.array(groups)


def find_pixels(side_px: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """(azimuth, radius) rows and columns in a square picture."""
    angle = np.arange(AZIMUTHS)[:, None] * (2.0 * np.pi / AZIMUTHS)
    radius = (np.arange(RADII) + 0.5) * (0.5 * side_px / RADII)
    places = (0.5 * side_px + radius * one for one in (np.sin(angle), np.cos(angle)))
    rows, columns = (np.clip(one, 0, side_px - 1).astype(np.intp) for one in places)
    return rows, columns


def describe_pixels(colours: Float32s, at: npt.NDArray[np.intp]) -> Float32s:
    """(n, k) what the network sees of (3, n) pixels: picture, azimuth, radius."""
    picture, azimuth, radius = at
    across, along = (one.reshape(-1) for one in np.meshgrid(ACROSS, ALONG))
    rows = (azimuth[:, None] + across) % AZIMUTHS
    columns = np.clip(radius[:, None] + along, 0, RADII - 1)
    seen = colours[picture[:, None], rows, columns]
    mean = seen.mean(axis=1, keepdims=True)
    relative = 2.0 * (seen - mean).reshape(len(picture), -1)
    where = np.eye(RADII, dtype=np.float32)[radius]
    return np.concatenate((relative, mean[:, 0] - 0.5, where), axis=1)


class Network:
    """Layers with rectifiers between, trained by Adam (Kingma & Ba 2015)."""

    def __init__(self, sizes: tuple[int, ...], generator: np.random.Generator) -> None:
        """Begin with random weights, by He et al. 2015."""
        self.weights: list[Float32s] = []
        for inputs, outputs in pairwise(sizes):
            scale = np.sqrt(2.0 / inputs)
            drawn = scale * generator.standard_normal((inputs, outputs))
            self.weights += [drawn.astype(np.float32), np.zeros(outputs, np.float32)]
        self._moments = [(np.zeros_like(one), np.zeros_like(one)) for one in self.weights]
        self._num_steps = 0

    def run(self, inputs: Float32s) -> list[Float32s]:
        """What goes into each layer, and the scores."""
        layers = [inputs]
        for weight, bias in zip(self.weights[::2], self.weights[1::2], strict=True):
            layers.append(np.maximum(layers[-1] @ weight + bias, 0.0))
        # Scores may be negative.
        layers[-1] = layers[-2] @ weight + bias
        return layers

    def learn(
        self, inputs: Float32s, groups: npt.NDArray[np.uint8], each: Float32s, step: float
    ) -> None:
        """One step against the cross entropy, by the weight of each group."""
        layers = self.run(inputs)
        odds = np.exp(layers[-1] - layers[-1].max(axis=1, keepdims=True))
        error = (
            odds / odds.sum(axis=1, keepdims=True) - np.eye(len(GROUPS), dtype=np.float32)[groups]
        )
        error *= each[groups][:, None] / len(groups)
        slopes: list[Float32s] = []
        for layer, weight in zip(layers[-2::-1], self.weights[-2::-2], strict=True):
            slopes = [layer.T @ error, error.sum(axis=0), *slopes]
            error = (error @ weight.T) * (layer > 0.0)
        self._num_steps += 1
        for weight, slope, (mean, square) in zip(self.weights, slopes, self._moments, strict=True):
            for moment, value, decay in zip(
                (mean, square), (slope, slope * slope), DECAY, strict=True
            ):
                moment += (1.0 - decay) * (value - moment)
            first, second = (
                moment / (1.0 - decay**self._num_steps)
                for moment, decay in zip((mean, square), DECAY, strict=True)
            )
            weight -= step * first / (np.sqrt(second) + 1e-8)


def train(colours: Float32s, groups: npt.NDArray[np.uint8], *, steps: int, seed: int) -> Network:
    """Network trained on pixels of pictures, rare groups counting more."""
    generator = np.random.default_rng(seed)
    places = np.argwhere(groups != NOTHING)
    shares = np.bincount(groups[groups != NOTHING], minlength=len(GROUPS)) / len(places)
    each = (1.0 / np.sqrt(shares + 1e-3)).astype(np.float32)
    num_inputs = 3 * len(ACROSS) * len(ALONG) + 3 + RADII
    network = Network((num_inputs, *HIDDEN, len(GROUPS)), generator)
    for number in range(steps):
        at = places[generator.integers(len(places), size=BATCH)].T
        seen = describe_pixels(colours, at)
        network.learn(seen, groups[tuple(at)], each / each.mean(), STEP * (1.0 - number / steps))
    return network


def measure_overlap(
    network: Network, colours: Float32s, groups: npt.NDArray[np.uint8]
) -> npt.NDArray[np.float64]:
    """Intersection over union of each group, over all pixels of pictures."""
    counts = np.zeros((len(GROUPS), len(GROUPS)))
    for number in range(len(groups)):
        at = np.argwhere(groups[number : number + 1] != NOTHING).T
        at[0] = number
        found = network.run(describe_pixels(colours, at))[-1].argmax(axis=1)
        np.add.at(counts, (groups[tuple(at)], found), 1.0)
    own = np.diag(counts)
    return own / (counts.sum(axis=0) + counts.sum(axis=1) - own)


if __name__ == "__main__":
    main()
