"""Recipe of a data set: frozen data, as read by `recipe_file`. Metres, radians, seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_protocol.errors import SourceLocation
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.simulation.robot_description import PlanarPose


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
class CameraChoice:
    """Camera of a robot, or a camera file that the robot carries in place of its own camera."""

    robot_file: Path
    camera: str
    """Name of the robot's camera in any case; empty for the first."""
    model_file: Path | None
    """Camera file to be carried; None: the robot's own camera."""
    size_px: tuple[int, int] | None
    """Width and height that the image is scaled to fit; None: the camera's own."""
    where: SourceLocation


@dataclass(frozen=True, slots=True)
class WorldChoice:
    """World of a recipe."""

    file: Path
    where: SourceLocation

    @property
    def name(self) -> str:
        """Name in samples: that of the file, without suffix."""
        return self.file.stem


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
    """Factors of all lights of a world; each level has a renderer of its own."""

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
    """Modes and parameters that replace those of the robot files, effect by effect."""

    modes: tuple[tuple[str, str], ...] = ()
    """Name of an effect, and its mode."""
    values: tuple[tuple[str, ValueRange], ...] = ()
    """Parameter, and its range."""
    where: SourceLocation = SourceLocation("")


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
    effects: EffectOverrides
    channels: tuple[str, ...]
    """Names of channels of ground truth beside the picture."""
    formats: tuple[str, ...]
    """Files beside the shards: of FORMATS."""
    renderer: str
    instruction_set: str

    @property
    def num_shards(self) -> int:
        """Number of shards, the last one perhaps smaller."""
        return -(-self.num_samples // self.samples_per_shard)

    def shard_samples(self, shard: int) -> range:
        """Indices of the samples of a shard."""
        first = shard * self.samples_per_shard
        return range(first, min(first + self.samples_per_shard, self.num_samples))

    def sample_key(self, index: int) -> str:
        """Name of a sample in files: its index, in as many digits for all."""
        return f"{index:0{max(6, len(str(self.num_samples - 1)))}d}"
