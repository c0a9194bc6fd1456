"""Recipe files: from `[Catoptra.Dataset]` and sections of poses, lights and effects to a Recipe.

    [Catoptra.Dataset]  Name, Samples, Seed, ShardSamples, Worlds, Cameras, Poses, Channels,
                        Formats, Compression, Renderer, InstructionSet
    [Catoptra.Lights]   Brightness=(Min=,Max=,Levels=)
    [Catoptra.Classes]  numbers of classes, by name
    [Catoptra.Effects]  modes and parameters as in a robot file; parameters may be ranges

Worlds and Cameras are lines: `Worlds=corridor`, `Cameras=(Robot="p2at_omni")`. Files are paths
relative to the recipe, or names of bundled ones. The sections of poses: `poses`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

from catoptra_protocol.labels import LABEL_CHANNELS, SKY_CLASS
from catoptra_protocol.names import suggest_name
from catoptra_protocol.text_files import read_text_file
from catoptra_server.config.camera_sections import MAX_SIDE_PX
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import report_unknown_names
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.datasets.poses import POSE_KINDS, read_poses
from catoptra_server.datasets.randomise import read_randomisation
from catoptra_server.datasets.recipe import (
    COMPRESSIONS,
    FORMATS,
    BrightnessLevels,
    CameraChoice,
    GivenPoses,
    PoseRecipe,
    Recipe,
    WorldChoice,
    follow_each_other,
    read_effects,
    read_range_struct,
    read_words,
)
from catoptra_server.render.renderer_kind import RendererKind

log = logging.getLogger(__name__)

_SECTION = "Catoptra.Dataset"
_LIGHTS = "Catoptra.Lights"
_CLASSES = "Catoptra.Classes"
_RENDERERS = tuple(kind.value for kind in RendererKind)
# Exact rays, which also label.
_DEFAULT_RENDERER = next(kind.value for kind in RendererKind if not kind.uses_faces)
_MAX_FILE_BYTES = 4 * 2**20
_MAX_SAMPLES = 2**31
# Objects of a COCO file count from 1, and a shard is one unit of repeated work.
_MAX_SHARD_SAMPLES = 100_000
# Each brightness is one more renderer in each worker.
_MAX_LEVELS = 16


def read_recipe(path: Path) -> Recipe:
    """Recipe of a file; the named files are found, not read.

    Raises:
        ConfigError: With file, line, key, value and the expected form.
    """
    file = IniFile(path)
    section = file.get_section(_SECTION)
    if not file.has_section(_SECTION):
        close = suggest_name(_SECTION, file.section_names())
        expected = f"[{_SECTION}], which says what to draw"
        raise section.make_error("section", expected=expected + (f", not [{close}]" * bool(close)))
    worlds = tuple(_read_worlds(section, path.parent))
    cameras = tuple(_read_cameras(section, path.parent))
    poses = read_poses(file, section.get_choice("Poses", POSE_KINDS, "random"))
    recipe = Recipe(
        path=path,
        text=read_text_file(path, kind="recipe", max_bytes=_MAX_FILE_BYTES),
        name=section.get_wire_name("Name", path.stem),
        num_samples=_read_num_samples(section, poses, len(worlds) * len(cameras)),
        seed=section.get_int("Seed", 0),
        samples_per_shard=section.get_int(
            "ShardSamples", 100, min_value=1, max_value=_MAX_SHARD_SAMPLES
        ),
        worlds=worlds,
        cameras=cameras,
        poses=poses,
        brightness=_read_brightness(file.get_section(_LIGHTS)),
        group_brightness={
            struct.get_str("Name"): _read_levels(struct, "Groups")
            for struct in file.get_section(_LIGHTS).get_structs("Groups")
        },
        effects=read_effects(file),
        channels=_read_channels(section, poses),
        formats=read_words(section, "Formats", tuple(FORMATS), ()),
        compression=section.get_choice("Compression", COMPRESSIONS, "none"),
        renderer=section.get_choice("Renderer", _RENDERERS, _DEFAULT_RENDERER),
        randomisation=read_randomisation(file),
        class_numbers=_read_classes(file),
    )
    if recipe.randomisation is not None and recipe.renderer != _DEFAULT_RENDERER:
        expected = f"{_DEFAULT_RENDERER}, which alone draws what [Catoptra.Randomise] varies"
        raise section.make_error("Renderer", expected=expected)
    if section.get_choice("InstructionSet", ("avx512", "avx2", "sse4.2"), ""):
        log.warning("%s: InstructionSet has no effect, since all have the same bytes", path)
    report_unknown_names(file.unknown_names())
    return recipe


def _read_worlds(section: SectionReader, folder: Path) -> Iterator[WorldChoice]:
    seen: set[str] = set()
    where = section.find_location("Worlds")
    for path in section.get_paths("Worlds", folder, bundled="worlds"):
        if path.stem in seen:
            raise section.make_error("Worlds", expected=f"each world once, not {path.stem} twice")
        seen.add(path.stem)
        yield WorldChoice(path, where)
    if not seen:
        raise section.make_error("Worlds", expected="at least one world, such as corridor")


def _read_cameras(section: SectionReader, folder: Path) -> Iterator[CameraChoice]:
    structs = section.get_structs("Cameras", example='(Robot="p2at_omni")')
    if not structs:
        raise section.make_error("Cameras", expected='at least one, such as (Robot="p2at_omni")')
    for struct in structs:
        model = None
        if struct.get_str("Model", ""):
            model = struct.get_path("Model", folder, bundled="cameras")
        yield CameraChoice(
            robot_file=struct.get_path("Robot", folder, bundled="robots"),
            camera=struct.get_str("Camera", ""),
            model_file=model,
            size_px=_read_size(struct),
            where=struct.where,
        )


def _read_size(struct: SectionReader) -> tuple[int, int] | None:
    if not (struct.has_key("Width") or struct.has_key("Height")):
        return None
    width, height = (
        struct.get_int(key, min_value=1, max_value=MAX_SIDE_PX) for key in ("Width", "Height")
    )
    return width, height


def _read_num_samples(section: SectionReader, poses: PoseRecipe, num_combinations: int) -> int:
    """Samples as stated; of given poses by default each once for each world and camera."""
    default = len(poses.poses) * num_combinations if isinstance(poses, GivenPoses) else None
    return section.get_int("Samples", default, min_value=1, max_value=_MAX_SAMPLES)


def _read_brightness(section: SectionReader) -> BrightnessLevels:
    if not section.get_str("Brightness", ""):
        return BrightnessLevels(1.0, 1.0, 1)
    struct = section.get_struct("Brightness", example="(Min=0.5,Max=1.5,Levels=5)")
    return _read_levels(struct, "Brightness")


def _read_levels(struct: SectionReader, key: str) -> BrightnessLevels:
    extent = read_range_struct(struct, key, struct, 0.0, 1000.0)
    levels = struct.get_int("Levels", 5, min_value=1, max_value=_MAX_LEVELS)
    return BrightnessLevels(extent.low, extent.high, levels)


def _read_classes(file: IniFile) -> dict[str, int] | None:
    """Numbers of classes by name; None without the section."""
    section = file.get_section(_CLASSES)
    if not file.has_section(_CLASSES):
        return None
    numbers = {
        key: section.get_int(key, min_value=1, max_value=SKY_CLASS - 1) for key in section.keys()
    }
    for name, number in numbers.items():
        if (first := list(numbers)[list(numbers.values()).index(number)]) != name:
            raise section.make_error(name, expected=f"a number of its own: {first} has {number}")
    return numbers


def _read_channels(section: SectionReader, poses: PoseRecipe) -> tuple[str, ...]:
    channels = read_words(section, "Channels", tuple(LABEL_CHANNELS), ())
    if "flow" in channels and not follow_each_other(poses):
        raise section.make_error(
            "Channels", expected="no flow where poses do not follow each other: Poses=path or drive"
        )
    return channels
