"""Pose, motion and surroundings of a camera during one exposure.

All that changes from frame to frame, and nothing else: camera model, plan and scene stay the same
and belong to a view. Effects, bounds and renderers read this one description.

Shutter: an image of a moving scene is the mean, in linear light, of sharp images. Row v of h is
exposed from t_v - T/2 to t_v + T/2, T the exposure time, t_v = R ((v + 1/2) / h - 1/2), R the
readout time; both are centred on the pose. The whole time, T + R, is divided into equal slots, and
one sharp image is rendered at the centre of each, with camera, objects, occlusion and shadows of
that time. A row's weight of a slot is the fraction of the row's exposure within the slot; the
weights sum to 1, so no light is lost.

Within a slot everything stands still. Steps of a pixel during the exposure leave less than a grey
level of rms against 64 time samples, since pixels are means already; a row that shows a single slot
is off by up to half a slot, so the displacement during the readout counts four times. Spreading one
image along each pixel's displacement came first: 1.3 to 2.3 grey levels of rms, in 330 to 720 ms.

Fog: L' = L exp(-beta D) + A (1 - exp(-beta D)), D the range, beta the extinction per metre, A the
airlight, the same in all directions. What is infinitely far away has the colour of the airlight.
Source: Koschmieder's law.

Noise: the seed is made of camera and tick, so an additional request changes nobody's noise, and two
channels that show one exposure agree.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.world_description import AT_REST, Twist


@dataclass(frozen=True, slots=True)
class NoiseSeed:
    """Key of a camera and of an exposure, for counter-based random numbers."""

    camera_key: tuple[int, int] = (0, 0)
    """Two 32-bit words that identify the camera."""
    tick: int = 0
    """Tick of the robot at the exposure; not a count of frames."""

    @classmethod
    def from_source(cls, source: RandomSource, tick: int) -> NoiseSeed:
        """Seed of the exposure at a tick, of the camera that a random source belongs to."""
        word = source.key[0]
        return cls((word & 0xFFFFFFFF, word >> 32), tick)


ZERO_SEED = NoiseSeed()


@dataclass(frozen=True, slots=True, eq=False)
class CameraState:
    """State of a camera in one exposure."""

    world_from_mirror: Pose
    """Mirror frame of an omnidirectional camera, its origin the effective viewpoint; the camera
    frame (x ahead, y right, z down) of a perspective camera."""
    objects: tuple[DynamicObject, ...] = ()
    """Dynamic objects in view beside the scene, without the robot that carries the camera."""
    noise_seed: NoiseSeed = ZERO_SEED
    """Seed of the image noise, read only by effects that draw random numbers."""
    twist: Twist = AT_REST
    """Motion of the frame in the world, referred to the frame's origin."""
    ego_body: DynamicObject | None = None
    """Robot that carries the camera; in view only after the effect `SelfView` has added this body
    to `objects`."""
    has_shadows: bool = False
    """Whether surfaces occlude directional and point lights."""
    fog: FogMedium | None = None
    """Air between camera and surfaces; None for clear air."""
    shutter: Shutter | None = None
    """Exposure and readout times; None for an exposure too short for any motion to show."""


def scene_twist_in_mirror(camera_state: CameraState) -> Twist:
    """Motion of the static scene as the camera sees it: in the mirror frame, at the viewpoint."""
    if camera_state.twist is AT_REST:
        return AT_REST
    # Plain floats: computed for every frame, and a tenth of the time of arrays of three.
    axes = camera_state.world_from_mirror.rotation.T.tolist()
    linear, angular = (
        tuple(-(a * x + b * y + c * z) for a, b, c in axes)
        for x, y, z in (camera_state.twist.linear_m_s, camera_state.twist.angular_rad_s)
    )
    return Twist(linear, angular)


@dataclass(frozen=True, slots=True)
class FogMedium:
    """Homogeneous fog of one density and colour."""

    density_per_m: float
    """Extinction beta; above 0."""
    airlight: tuple[float, float, float]
    """Linear radiance of an infinite depth of fog."""

    @np.errstate(under="ignore")  # exp of a large optical depth is 0, as intended
    def transmittance(self, range_m: Floats) -> Floats:
        """(...) fraction of light that passes (...) ranges, metres or inf."""
        return np.asarray(np.exp(-self.density_per_m * range_m))

    def mix(self, radiance: Floats, range_m: Floats) -> Floats:
        """(..., 3) linear radiance behind fog, of radiance at (...) ranges, metres or inf."""
        transmittance = self.transmittance(range_m)[..., None]
        mixed: Floats = radiance * transmittance + np.asarray(self.airlight) * (1.0 - transmittance)
        return mixed


# One time sample alone would be a sharp image, however far objects move.
_MIN_TIME_SAMPLES, MAX_TIME_SAMPLES = 2, 64
# Pixels between time samples; a quarter for rows with one slot alone (see above).
_MAX_STEP_PX, _MAX_ROW_STEP_PX = 1.0, 0.25

RowWeights = npt.NDArray[np.float32]  # (rows,)


@dataclass(frozen=True, slots=True)
class Shutter:
    """Exposure and readout times, with the displacement that the time samples have to resolve."""

    exposure_s: float
    """Exposure time of a row."""
    readout_s: float
    """Time between the exposures of the first row and of a row after the last; 0: all at once."""
    num_steps: float
    """Displacement during both times, in steps that a slot may have; any number."""
    max_time_samples: int = MAX_TIME_SAMPLES
    """Limit of the number of slots; fewer than there are steps blur the image in steps."""

    def add_exposure(self, exposure_s: float, displacement_px: float) -> Shutter:
        """Shutter with an exposure time, for the largest displacement in that time."""
        num_steps = self.num_steps + displacement_px / _MAX_STEP_PX
        return replace(self, exposure_s=exposure_s, num_steps=num_steps)

    def add_readout(self, readout_s: float, displacement_px: float) -> Shutter:
        """Shutter with a readout time, for the displacement from the first row to the last."""
        num_steps = self.num_steps + displacement_px / _MAX_ROW_STEP_PX
        return replace(self, readout_s=readout_s, num_steps=num_steps)

    @property
    def num_time_samples(self) -> int:
        """Number of slots, each one rendering."""
        # Rounded here and not in each step: two effects that need 1.5 slots each need 3, not 4.
        return max(math.ceil(min(self.num_steps, self.max_time_samples)), _MIN_TIME_SAMPLES)

    @property
    def times_s(self) -> tuple[float, ...]:
        """Centres of the slots, seconds from the pose."""
        total_s, count = self.exposure_s + self.readout_s, self.num_time_samples
        return tuple(((i + 0.5) / count - 0.5) * total_s for i in range(count))

    def row_weights(self, num_rows: int) -> npt.NDArray[np.float32]:
        """(num_time_samples, num_rows) weight of each slot in each row."""
        total_s, count = self.exposure_s + self.readout_s, self.num_time_samples
        centre_s = self.readout_s * ((np.arange(num_rows) + 0.5) / num_rows - 0.5)
        edges_s = (np.arange(count + 1) / count - 0.5) * total_s
        # A row of no duration shows exactly one slot; the fraction below would be 0 / 0.
        if self.exposure_s == 0.0:
            slot = np.searchsorted(edges_s[1:-1], centre_s, side="right")
            return np.equal.outer(np.arange(count), slot).astype(np.float32)
        begin_s, end_s = centre_s - 0.5 * self.exposure_s, centre_s + 0.5 * self.exposure_s
        within_s = np.diff(np.clip(edges_s[:, None], begin_s, end_s), axis=0)
        fractions: npt.NDArray[np.float32] = (within_s / self.exposure_s).astype(np.float32)
        return fractions


# Start of the effects that lengthen an exposure: neither time lasts yet.
INSTANTANEOUS = Shutter(0.0, 0.0, 0.0)
