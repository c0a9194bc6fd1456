"""Small recipes of data sets: pictures of 64 px of a field and of a corridor."""

from __future__ import annotations

from pathlib import Path

from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.sample import RenderedSample, SampleDescriber
from catoptra_server.datasets.sample_renderer import SampleRenderer

CAMERA = 'Cameras=(Robot="p2at_omni",Width=64,Height=64)'
FISHEYE = 'Cameras=(Robot="p2at_omni",Model="equidistant_220",Width=64,Height=64)'


def write_recipe(
    folder: Path,
    *sections: str,
    samples: int = 4,
    poses: str = "random",
    world: str = "corridor",
    cameras: tuple[str, ...] = (CAMERA,),
    lines: tuple[str, ...] = (),
) -> Path:
    """Write a recipe of two samples a shard, and return its path.

    Args:
        folder: Folder of the file.
        sections: Further sections, whole.
        samples: Number of samples; 0 for no such line.
        poses: Kind of poses.
        world: The world.
        cameras: Lines of cameras.
        lines: Further lines of the first section.
    """
    number = (f"Samples={samples}",) if samples else ()
    head = ("[Catoptra.Dataset]", *number, "Seed=7", "ShardSamples=2", f"Poses={poses}")
    path = folder / "recipe.ini"
    content = "\n".join((*head, f"Worlds={world}", *cameras, *lines, *sections)) + "\n"
    path.write_text(content, encoding="utf-8")
    return path


RANDOMISED = (
    "[Catoptra.Randomise]",
    "Textures=brick,wood",
    "Colours=(Min=0.3,Max=1)",
    "Gloss=(Min=0,Max=0.3)",
    "Lamps=2",
    "LampDistance=(Min=0.5,Max=1)",
    "Distractors=(Min=0,Max=3)",
    "DistractorSize=(Min=0.1,Max=0.2)",
    "Objects=(Thing=cone,Count=(Min=0,Max=1))",
    'Robots=(Robot="p2dx")',
    "MountShift=0.01",
    "MountTurn=0.02",
)


def write_drive(folder: Path, *sections: str, lines: tuple[str, ...] = ("Channels=all",)) -> Path:
    """Write a recipe of drives of two samples, with two cameras and three lights."""
    return write_recipe(
        folder,
        "[Catoptra.DrivePoses]",
        "Samples=2",
        "[Catoptra.Lights]",
        "Brightness=(Min=0.5,Max=1.5,Levels=3)",
        *sections,
        samples=6,
        poses="drive",
        cameras=(CAMERA, FISHEYE),
        lines=lines,
    )


def stage_recipe(path: Path) -> DatasetStage:
    """Stage of a recipe's file."""
    return DatasetStage(read_recipe(path))


def render_samples(path: Path, *indices: int) -> list[RenderedSample]:
    """Samples of a recipe, drawn in the order of the indices."""
    stage = stage_recipe(path)
    describer, renderer = SampleDescriber(stage), SampleRenderer(stage)
    try:
        return [renderer.render_sample(describer.describe_sample(index)) for index in indices]
    finally:
        renderer.close()
