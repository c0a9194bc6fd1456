"""All checks of the stream."""

from __future__ import annotations

from conformance.check import Check
from conformance.stream_camera_checks import CAMERA_CHECKS
from conformance.stream_label_checks import LABEL_CHECKS
from conformance.stream_motion_checks import MOTION_CHECKS
from conformance.stream_picture_checks import PICTURE_CHECKS
from conformance.stream_plan_checks import PLAN_CHECKS
from conformance.stream_state_checks import STATE_CHECKS

STREAM_CHECKS: tuple[Check, ...] = (
    *PICTURE_CHECKS,
    *CAMERA_CHECKS,
    *MOTION_CHECKS,
    *STATE_CHECKS,
    *LABEL_CHECKS,
    *PLAN_CHECKS,
)
