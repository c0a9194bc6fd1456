"""Recipe of a data set as frozen data, and values that only recipes have. Metres, radians, seconds.

A recipe is read by `recipe_file`, the poses by `poses`. A range is drawn anew for each sample. An
effect that the recipe names replaces the camera's own, parameters included; the others stay.
Effects that need a mirror, or a single viewpoint, are left out for cameras without.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from catoptra_protocol.errors import SourceLocation
from catoptra_protocol.names import suggest_name
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.camera_sections import (
    read_effect_settings,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import Entry
from catoptra_server.effects import (
    EFFECT_TYPES,
    EffectMode,
    EffectParameter,
    EffectSettings,
    EffectType,
)
from catoptra_server.simulation.robot_description import PlanarPose

FORMATS = {
    "coco": True,
    "coco_folder": True,
    "yolo": True,
    "yolo_polygons": True,
    "kitti": True,
    "asl": False,
    "tum": False,
    "parquet": False,
}
"""Files that a recipe may have beside the shards, and whether they need annotations."""
COMPRESSIONS = ("none", "zstd")
_EXAMPLE = "(Min=0,Max=1)"
DISTRACTOR_CLASS = "distractor"
_EFFECTS_SECTION = "Catoptra.Effects"


@dataclass(frozen=True, slots=True)
class Recipe:
    """All that the samples of a data set follow from."""

    path: Path
    text: str
    """Content of the file."""
    name: str
    num_samples: int
    seed: int
    samples_per_shard: int
    worlds: tuple[WorldChoice, ...]
    cameras: tuple[CameraChoice, ...]
    poses: PoseRecipe
    brightness: BrightnessLevels
    group_brightness: Mapping[str, BrightnessLevels]
    """Factors of groups of lights by name, beside that of all."""
    effects: EffectOverrides
    channels: tuple[str, ...]
    """Names of channels of ground truth beside the picture."""
    formats: tuple[str, ...]
    """Files beside the shards: of FORMATS."""
    compression: str
    """Of NumPy's files: of COMPRESSIONS."""
    renderer: str
    randomisation: Randomisation | None = None
    """What else varies; None: nothing."""
    class_numbers: Mapping[str, int] | None = None
    """Numbers of classes in all worlds; None: of each world its own."""

    @property
    def num_shards(self) -> int:
        """Number of shards, the last one perhaps smaller."""
        return -(-self.num_samples // self.samples_per_shard)

    def shard_samples(self, shard: int) -> range:
        """Indices of the samples of a shard."""
        first = shard * self.samples_per_shard
        return range(first, min(first + self.samples_per_shard, self.num_samples))

    def sample_key(self, index: int) -> str:
        """Name of a sample in files: the index, in as many digits for all."""
        return f"{index:0{max(6, len(str(self.num_samples - 1)))}d}"


@dataclass(frozen=True, slots=True)
class WorldChoice:
    """World of a recipe."""

    file: Path
    where: SourceLocation

    @property
    def name(self) -> str:
        """Name in samples: the file's, without suffix."""
        return self.file.stem


@dataclass(frozen=True, slots=True)
class CameraChoice:
    """Camera of a robot, or a camera file that the robot carries in place of another camera."""

    robot_file: Path
    camera: str
    """Name of the robot's camera in any case; empty for the first."""
    model_file: Path | None
    """Camera file to be carried; None: the robot's own camera."""
    size_px: tuple[int, int] | None
    """Width and height that the image is scaled to fit; None: the camera's own."""
    where: SourceLocation


@dataclass(frozen=True, slots=True)
class ValueRange:
    """Closed range of a number that each sample draws; low = high for a fixed one."""

    low: float
    high: float

    def draw(self, generator: np.random.Generator) -> float:
        """Uniform number of the range; takes one number of the generator even where fixed."""
        # Always one: another number of the sample must not depend on whether this one is fixed.
        return self.low + (self.high - self.low) * float(generator.random())


@dataclass(frozen=True, slots=True)
class FreeThing:
    """A thing of the scenery that stands in free space."""

    name: str
    """Of THINGS in `randomise`."""
    class_name: str
    count: ValueRange
    where: SourceLocation


@dataclass(frozen=True, slots=True)
class Randomisation:
    """What varies from sample to sample; None and empty: nothing."""

    where: SourceLocation
    textures: tuple[str | Path, ...]
    """Names of `named_textures`, and image files."""
    texture_share: float
    """Share of the objects that get one of these."""
    colours: ValueRange | None
    """Factors of each colour channel of an object."""
    gloss: ValueRange | None
    """Reflectance along the normal."""
    gloss_share: float
    roughness: ValueRange
    kept_classes: tuple[str, ...]
    """Classes of objects whose looks stay."""
    lamps: ValueRange | None
    """Number of point lights about the robot."""
    lamp_intensity: ValueRange
    lamp_tint: ValueRange
    """Factor of each colour channel."""
    lamp_height_m: ValueRange
    lamp_distance_m: ValueRange
    sun: ValueRange | None
    """Irradiance of a sun in place of the world's directional lights."""
    sun_elevation_rad: ValueRange
    distractors: ValueRange | None
    """Number of shapes in free space."""
    distractor_size_m: ValueRange
    distance_m: ValueRange
    """From the robot's way to what stands in free space."""
    things: tuple[FreeThing, ...]
    robots: tuple[Path, ...]
    """Files of other robots, one for each robot."""
    mount_shift_m: float
    """Largest displacement of the camera along each axis of the robot."""
    mount_turn_rad: float
    """Largest angle about each axis."""
    calibration: float
    """Standard deviations of the calibration that count as one; 0: the camera as calibrated."""

    @property
    def classes(self) -> tuple[str, ...]:
        """Classes of what stands in free space."""
        names = {one.class_name for one in self.things}
        return tuple(sorted(names | ({DISTRACTOR_CLASS} if self.distractors else set())))


@dataclass(frozen=True, slots=True)
class RandomPoses:
    """Poses drawn in free space."""

    clearance_m: float
    """Distance that must be free around the robot's base."""
    max_tries: int
    x_m: ValueRange | None
    """None: the extent of the world's floor."""
    y_m: ValueRange | None
    yaw_rad: ValueRange
    speed_m_s: ValueRange
    """Forward speed during the exposure, which blurs and feeds no flow."""
    yaw_rate_rad_s: ValueRange
    where: SourceLocation


@dataclass(frozen=True, slots=True)
class GivenPose:
    """Pose that the recipe states."""

    pose: PlanarPose
    where: SourceLocation
    """Line that an error names."""


@dataclass(frozen=True, slots=True)
class GivenPoses:
    """Poses of a grid or of a path, in order."""

    poses: tuple[GivenPose, ...]
    is_path: bool
    """Whether consecutive poses follow each other in time: only then there is a flow."""
    interval_s: float
    """Time between two poses of a path; 0 of a grid."""
    speed_m_s: float
    """Forward speed along a path; 0 of a grid."""


@dataclass(frozen=True, slots=True)
class DrivePoses:
    """Poses of drives with the robot's own skid steer, from random free places."""

    start: RandomPoses
    num_samples: int
    """Samples of one drive."""
    interval_s: float
    """Time between two samples, a multiple of the tick."""
    wheel_speed_rad_s: ValueRange
    """Of each side, drawn anew after each hold."""
    hold_s: ValueRange
    """Time for which wheel speeds are held."""


PoseRecipe = RandomPoses | GivenPoses | DrivePoses


def follow_each_other(poses: PoseRecipe) -> bool:
    """Whether consecutive samples are one motion, so that there is an optical flow."""
    return isinstance(poses, DrivePoses) or (isinstance(poses, GivenPoses) and poses.is_path)


@dataclass(frozen=True, slots=True)
class BrightnessLevels:
    """Factors of all lights of a world; each level needs another renderer."""

    low: float
    high: float
    levels: int

    def level(self, number: int) -> float:
        """Factor of a level, evenly spaced."""
        if self.levels == 1:
            return self.low
        return self.low + (self.high - self.low) * number / (self.levels - 1)


@dataclass(frozen=True, slots=True)
class EffectOverrides:
    """Modes and parameters that replace the robot files', effect by effect."""

    modes: tuple[tuple[str, str], ...] = ()
    """Name of an effect, and the mode."""
    values: tuple[tuple[str, ValueRange], ...] = ()
    """Parameter, and the range."""
    where: SourceLocation = SourceLocation("")
    curves: tuple[tuple[str, str], ...] = ()
    """Key of a curve, and its name or file."""


def draw_effects(
    overrides: EffectOverrides,
    own: EffectSettings,
    generator: np.random.Generator,
    *,
    has_mirror: bool,
    has_viewpoint: bool,
) -> EffectSettings:
    """Settings of one sample: the camera's, or the recipe's where stated.

    Args:
        overrides: Effects of the recipe.
        own: Effects of the camera's own file.
        generator: Random numbers of the sample's effects.
        has_mirror: Whether the camera has a mirror.
        has_viewpoint: Whether the mirror has a single viewpoint.

    Raises:
        ConfigError: Drawn parameters cannot be drawn together.
    """
    if not overrides.modes:
        return own
    drawn = {key: values.draw(generator) for key, values in overrides.values}
    wanted = _read_settings(overrides, drawn, has_mirror=has_mirror, has_viewpoint=has_viewpoint)
    by_name = {one.effect.name: one for one in (*own.settings, *wanted.settings)}
    ordered = tuple(by_name[name] for name in EFFECT_TYPES if name in by_name)
    return EffectSettings(
        ordered,
        max_change=own.max_change,
        visible_share=own.visible_share,
        threshold_px=own.threshold_px,
        basis=own.basis,
    )


def _read_settings(
    overrides: EffectOverrides,
    drawn: Mapping[str, float],
    *,
    has_mirror: bool,
    has_viewpoint: bool,
) -> EffectSettings:
    """Settings of drawn parameters, by the readers of robot files: one place has all checks."""
    modes = [
        (name, mode)
        for name, mode in overrides.modes
        if _is_possible(EFFECT_TYPES[name], has_mirror=has_mirror, has_viewpoint=has_viewpoint)
    ]
    texts = (*modes, *overrides.curves, *((key, repr(value)) for key, value in drawn.items()))
    entries = [Entry(key, text, "", overrides.where) for key, text in texts]
    section = SectionReader(_EFFECTS_SECTION, overrides.where, entries)
    return read_effect_settings(section, has_mirror=has_mirror, has_viewpoint=has_viewpoint)


def _is_possible(kind: EffectType, *, has_mirror: bool, has_viewpoint: bool) -> bool:
    if not has_mirror:
        return not kind.needs_mirror
    return has_viewpoint or not kind.needs_viewpoint


def read_effects(file: IniFile) -> EffectOverrides:
    """Effects of a recipe; none without a section.

    Raises:
        ConfigError: For an unknown mode, or a parameter whose range is empty or out of bounds.
    """
    section = file.get_section(_EFFECTS_SECTION)
    modes, values = [], []
    for name in EFFECT_TYPES:
        mode = section.get_choice(name, [mode.value for mode in EffectMode], "")
        if mode:
            modes.append((name, mode))
    for parameter in _parameters():
        low, high = parameter.min_value, parameter.max_value
        if section.get_str(parameter.key, ""):
            found = read_range(
                section, parameter.key, ValueRange(0.0, 0.0), min_value=low, max_value=high
            )
            values.append((parameter.key, found))
    keys = (kind.curve_key for kind in EFFECT_TYPES.values() if kind.curve_key)
    curves = tuple((key, text) for key in keys if (text := section.get_str(key, "")))
    overrides = EffectOverrides(tuple(modes), tuple(values), section.where, curves)
    # Combinations that cannot be drawn are found now, not in the middle of the data set.
    for end in ("low", "high"):
        drawn = {key: float(getattr(values, end)) for key, values in overrides.values}
        for has_mirror in (True, False):
            _read_settings(overrides, drawn, has_mirror=has_mirror, has_viewpoint=True)
    return overrides


def _parameters() -> Iterator[EffectParameter]:
    """Yield the parameters of all effects, one that several share once."""
    seen: set[str] = set()
    for kind in EFFECT_TYPES.values():
        for parameter in kind.parameters:
            if parameter.key not in seen:
                seen.add(parameter.key)
                yield parameter


def read_range(
    section: SectionReader,
    key: str,
    default: ValueRange,
    *,
    min_value: float = -math.inf,
    max_value: float = math.inf,
) -> ValueRange:
    """Range of a number: a struct such as (Min=0,Max=1), or one number for a fixed value.

    Args:
        section: The section.
        key: The key, in any case.
        default: Result for a missing key, not checked against the bounds.
        min_value: Smallest accepted value.
        max_value: Largest accepted value.

    Raises:
        ConfigError: For no range, one beyond the bounds, or an empty one.
    """
    text = section.get_str(key, "")
    if not text:
        return default
    if not text.startswith("("):
        value = section.get_float(key, min_value=min_value, max_value=max_value)
        return ValueRange(value, value)
    return read_range_struct(
        section, key, section.get_struct(key, example=_EXAMPLE), min_value, max_value
    )


def read_range_struct(
    section: SectionReader,
    key: str,
    struct: SectionReader,
    min_value: float = -math.inf,
    max_value: float = math.inf,
) -> ValueRange:
    """Range of a struct with Min and Max."""
    low = struct.get_float("Min", min_value=min_value, max_value=max_value)
    high = struct.get_float("Max", min_value=min_value, max_value=max_value)
    if low > high:
        raise section.make_error(key, expected=f"a range with Min at most Max, as {_EXAMPLE}")
    return ValueRange(low, high)


def read_words(
    section: SectionReader, key: str, allowed: Sequence[str], default: tuple[str, ...]
) -> tuple[str, ...]:
    """Words with commas between, each once, in the order of `allowed`; `all` for all.

    Raises:
        ConfigError: For an unknown word, with the one that was probably meant.
    """
    if not section.get_str(key, ""):
        return default
    words = [word.strip().lower() for word in section.get_str(key).split(",") if word.strip()]
    if words == ["all"]:
        return tuple(allowed)
    for word in words:
        if word not in allowed:
            close = suggest_name(word, allowed)
            hint = f"; did you mean {close}?" if close else ""
            expected = f"words of {', '.join(allowed)}, with commas between, or all{hint}"
            raise section.make_error(key, expected=expected)
    return tuple(word for word in allowed if word in words)
