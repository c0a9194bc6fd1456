"""All checks of the control port."""

from __future__ import annotations

from conformance.check import Check
from conformance.control_clock_checks import CLOCK_CHECKS
from conformance.control_motion_checks import MOTION_CHECKS
from conformance.control_range_checks import RANGE_CHECKS
from conformance.control_text_checks import TEXT_CHECKS

CONTROL_CHECKS: tuple[Check, ...] = (*TEXT_CHECKS, *CLOCK_CHECKS, *MOTION_CHECKS, *RANGE_CHECKS)
