"""The header of a frame, which is followed by a second part, the image.

A new field gets a default where peers of an earlier release do not send it.
"""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.label_records import LabelsRecord
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.stream.transform import Transform


@dataclass(frozen=True, slots=True)
class EffectRecord:
    """Decision about one image effect in a frame."""

    name: str
    enabled: bool
    bound: float
    """Largest change of any pixel that the effect can cause, encoded grey levels of 255."""
    threshold: float
    """Change up to which `auto` disables the effect, grey levels."""
    reason: str
    duration_ms: float | None = None
    """Duration in this frame; None for a disabled effect and for one that changes the scene, whose
    duration is part of the stages that render the scene."""
    basis: str = "proved"
    """What decided: `proved`, the bound alone; `measured`, the frame's own pixels."""
    change: float | None = None
    """Largest change of any pixel of this frame, grey levels, where measured."""
    displacement_px: float | None = None
    """Largest displacement of light; None for an effect that displaces none."""


@dataclass(frozen=True, slots=True)
class PlanAlternative:
    """A neighbour of the current plan on the Pareto front of error bound and cost."""

    plan: str
    error_bound_px: float
    cost_ms: float


@dataclass(frozen=True, slots=True)
class DifferenceRecord:
    """Difference of a picture from a reference, the right half of the image that shows both."""

    reference_plan: str
    """Description of the reference's rendering plan."""
    max_levels: int
    """Largest absolute difference of an encoded value."""
    rms_levels: float
    """Root mean square over all pixels and colours."""
    changed_fraction: float
    """Fraction of the pixels that differ in a colour."""


@dataclass(frozen=True, slots=True)
class FrameHeader:
    """Metadata of the image in the next part."""

    KIND: ClassVar[str] = "frame"

    version: int
    id: int
    robot: str
    """Robot with the camera; empty where several robots, or none, share the image."""
    class_name: str
    camera: str
    """Camera; empty where several cameras share the image."""
    sequence: int
    """Number of the frame on its channel, from 1."""
    time_s: float
    """Simulation time of the exposure."""
    world_from_robot: Transform
    """Pose of the robot at the exposure."""
    robot_from_mirror: Transform | None
    """Pose of the effective viewpoint (pinhole of an ordinary camera); None without one camera."""
    camera_model: dict[str, str] | None
    """Pairs of CONF; None without one camera."""
    plan: str | None
    """Description of the rendering plan; None if unknown."""
    error_bound_px: float | None
    """Bound on the displacement of any outline; None if unknown."""
    stage_ms: dict[str, float]
    """Duration of each rendering stage by name."""
    encoding: ImageEncoding
    width_px: int
    height_px: int
    age_s: float
    """Time from the exposure to the sending."""
    missed_frames: int
    """Frames of the channel rendered and not sent to this client, in total."""
    dropped_frames: int
    """Frames requested by this client that it did not read, in total."""
    # Defaults from here on: servers of an earlier release do not send these fields.
    error_bounds: dict[str, float] | None = None
    """`error_bound_px` and its parts by name (SPEC.md 9.5)."""
    effects: tuple[EffectRecord, ...] = ()
    """Decisions about the effects that the robot file names, in optical order."""
    predicted_ms: float | None = None
    """Predicted duration of a frame; None without an accuracy target."""
    target_met: bool = True
    """Whether the plan meets the accuracy target."""
    more_accurate: PlanAlternative | None = None
    """Next more accurate plan; None without an accuracy target."""
    faster: PlanAlternative | None = None
    """Next cheaper plan, likewise."""
    difference: DifferenceRecord | None = None
    """Set where the request names a reference: the image is twice as wide as the picture."""
    labels: LabelsRecord | None = None
    """Set where the request names channels, which follow the image in parts of their own."""

    def __str__(self) -> str:
        # Without the pairs of the camera model, which would fill the log of every frame.
        return (
            f"frame {self.sequence} of {self.camera!r}, {self.width_px} x {self.height_px} px "
            f"{self.encoding.value}, {1000.0 * self.age_s:.1f} ms old"
        )
