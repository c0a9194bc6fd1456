"""Whose turn it is to drive a robot that viewers may drive, too. Pure functions.

The server executes the newest command of anyone. The wheel speeds that it reports are compared
with those commanded here: other ones are a viewer's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

WheelSpeeds = tuple[float, float]

# A viewer who taps keys, or changes hands, keeps the robot.
RESUME_AFTER_S = 3.0
# The last ones: a state may be older than the newest command.
_NUM_RECENT = 4
_TOLERANCE_RAD_S = 1e-3


@dataclass(frozen=True, slots=True)
class SharedControl:
    """The newest commands, and the latest activity of a viewer."""

    recent_speeds: tuple[WheelSpeeds, ...] = ((0.0, 0.0),)
    """Left and right wheel speeds commanded here, rad/s."""

    foreign_speeds: WheelSpeeds | None = None
    """Wheel speeds of the viewer who drives or has driven last; None where nobody does."""

    foreign_since_s: float = 0.0
    """Time of the viewer's latest activity."""

    @property
    def is_foreign(self) -> bool:
        """Whether a viewer drives, or has stopped a moment ago."""
        return self.foreign_speeds is not None


def record_command(control: SharedControl, speeds: WheelSpeeds) -> SharedControl:
    """Control after a command sent from here."""
    return replace(control, recent_speeds=(*control.recent_speeds, speeds)[-_NUM_RECENT:])


def observe_speeds(control: SharedControl, speeds: WheelSpeeds, time_s: float) -> SharedControl:
    """Control after a look at the robot's wheel speeds.

    A viewer keeps the robot while the wheels turn by other commands than those sent from here, and
    for `RESUME_AFTER_S` from the last change.

    Args:
        control: Control before.
        speeds: Left and right wheel speeds that the server reports, rad/s.
        time_s: Time of a clock.
    """
    if not control.is_foreign:
        if any(_are_equal(speeds, own) for own in control.recent_speeds):
            return control
        return replace(control, foreign_speeds=speeds, foreign_since_s=time_s)
    if any(speeds) or speeds != control.foreign_speeds:
        return replace(control, foreign_speeds=speeds, foreign_since_s=time_s)
    if time_s - control.foreign_since_s < RESUME_AFTER_S:
        return control
    # The viewer's last command was to stand.
    return SharedControl()


def _are_equal(speeds: WheelSpeeds, own: WheelSpeeds) -> bool:
    return all(
        math.isclose(a, b, abs_tol=_TOLERANCE_RAD_S) for a, b in zip(speeds, own, strict=True)
    )
