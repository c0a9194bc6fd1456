"""Which world, camera, pose and light a sample has: a function of the recipe and the index alone.

Samples of one sequence follow each other: a whole path, drive or grid, or one random pose. The next
sequence has the next world and camera of all combinations, cameras changing first.
"""

from __future__ import annotations

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.recipe import DrivePoses, GivenPoses, Recipe
from catoptra_server.runtime.random_sources import RandomSource


@dataclass(frozen=True, slots=True)
class SamplePlace:
    """Place of a sample in a data set."""

    index: int
    sequence: int
    step: int
    """Number within the sequence."""
    world: int
    """Number of the world in the recipe."""
    camera: int


def sequence_length(recipe: Recipe) -> int:
    """Samples of a sequence."""
    if isinstance(recipe.poses, GivenPoses):
        return len(recipe.poses.poses)
    return recipe.poses.num_samples if isinstance(recipe.poses, DrivePoses) else 1


def find_place(recipe: Recipe, index: int) -> SamplePlace:
    """Place of a sample."""
    sequence, step = divmod(index, sequence_length(recipe))
    world, camera = divmod(
        sequence % (len(recipe.worlds) * len(recipe.cameras)), len(recipe.cameras)
    )
    return SamplePlace(index, sequence, step, world, camera)


def random_source(recipe: Recipe, purpose: str) -> RandomSource:
    """Random numbers of the samples, or sequences, for one purpose."""
    return RandomSource.from_names(recipe.seed, "dataset", purpose)


def draw_brightness(recipe: Recipe, index: int) -> float:
    """Factor of all lights in a sample."""
    levels = recipe.brightness.levels
    number = random_source(recipe, "brightness").generator(index).integers(levels)
    return recipe.brightness.level(int(number))
