"""A tachometer: how fast the driven wheels spin. UDK's; its order is that of the P3AT's wheels.

Vel is the spin of the last tick, where UDK tells the mean since its last report: so a reading does
not depend on who else has read.
"""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_protocol.usarsim.reports import ScanIntervalConfiguration, TachometerReading
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, TachometerDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext

_SIDE_OF_WHEEL = (1, 0)  # front right, front left, back right, back left. Source: P3AT.uc


class TachometerSensor:
    """Follow the wheels of both sides: what they turn, and how fast they did so last."""

    type = "Tachometer"

    def __init__(
        self, description: TachometerDescription, base: DriveBase, stream: RandomSource
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description
        self._wheel_radius_m = base.wheel_radius_m
        self._spins_rad_s = (0.0, 0.0)  # left, right
        self._angles_rad = (0.0, 0.0)

    @property
    def parts(self) -> Sequence[Part]:
        """Return the sensor."""
        told = ScanIntervalConfiguration(self.type, self.name, self.interval_s)
        return (MountedPart(self.type, self.name, self._description.mount, told),)

    def update(self, motion: MotionStep) -> None:
        """Turn the wheels."""
        # In one division, as the way was made in one product: half of 1.0 prints as 0.5000.
        m_per_rad_s = self._wheel_radius_m * motion.duration_s
        left, right = (
            motion.wheel_travel.left_m / m_per_rad_s,
            motion.wheel_travel.right_m / m_per_rad_s,
        )
        self._spins_rad_s = (left, right)
        turned_left, turned_right = self._angles_rad
        self._angles_rad = (
            turned_left + left * motion.duration_s,
            turned_right + right * motion.duration_s,
        )

    def read(self, context: SensorContext) -> TachometerReading:
        """Return rad/s and radians of each wheel; forward is positive."""
        return TachometerReading(
            time_s=context.time_s,
            name=self.name,
            velocities_rad_s=self._expand_to_wheels(self._spins_rad_s),
            positions_rad=self._expand_to_wheels(self._angles_rad),
        )

    def _expand_to_wheels(self, sides: tuple[float, float]) -> tuple[float, ...]:
        return tuple(
            sides[_SIDE_OF_WHEEL[wheel % 2]] for wheel in range(self._description.num_wheels)
        )
