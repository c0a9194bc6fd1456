"""A tachometer of UDK: spin and angle of the driven wheels, in the order of the P3AT's wheels.

Vel is the spin of the last tick, where UDK reports the mean since its last report: a reading does
not depend on the readings of other clients.
"""

from __future__ import annotations

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import TachometerReading
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)

# Indices into (left, right): front right, front left, back right, back left. Source: P3AT.uc
_SIDE_OF_WHEEL = (1, 0)


@dataclass(frozen=True, slots=True)
class TachometerDescription:
    """A tachometer of all driven wheels."""

    name: str
    interval_s: float
    mount: Mount
    num_wheels: int = 4
    """Number of driven wheels, right and left alternating from the front."""


class _TachometerSensor:
    """Spin in the last tick and rotation since the spawn, of the wheels of both sides."""

    def __init__(
        self, description: TachometerDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self._description = description
        self._wheel_radius_m = base.wheel_radius_m
        self._spins_rad_s = (0.0, 0.0)  # left, right
        # Two sides, not four wheels: the wheels of a side spin alike.
        self._angles_rad = (0.0, 0.0)

    def update(self, motion: MotionStep) -> None:
        """Integrate the wheel travel of one tick."""
        # One division, as the travel is one product: half of 1.0 rad/s prints as 0.5000.
        m_per_rad_s = self._wheel_radius_m * motion.duration_s
        left = motion.wheel_travel.left_m / m_per_rad_s
        right = motion.wheel_travel.right_m / m_per_rad_s
        self._spins_rad_s = (left, right)
        angle_left, angle_right = self._angles_rad
        self._angles_rad = (
            angle_left + left * motion.duration_s,
            angle_right + right * motion.duration_s,
        )

    def read(self, context: SensorContext) -> TachometerReading:
        """Spin and angle of each wheel; forward is positive."""
        return TachometerReading(
            time_s=context.time_s,
            name=self._description.name,
            velocities_rad_s=self._expand_to_wheels(self._spins_rad_s),
            positions_rad=self._expand_to_wheels(self._angles_rad),
        )

    def _expand_to_wheels(self, sides: tuple[float, float]) -> tuple[float, ...]:
        wheels = range(self._description.num_wheels)
        return tuple(sides[_SIDE_OF_WHEEL[wheel % 2]] for wheel in wheels)


def _read_description(item: ConfiguredSensor) -> TachometerDescription:
    num_wheels = item.section.get_int("Wheels", 4, min_value=1, max_value=64)
    return TachometerDescription(item.name, item.interval_s, item.mount, num_wheels)


TACHOMETER = SensorKind(
    "Tachometer", TachometerDescription, _TachometerSensor, {"tachometer": _read_description}
)
