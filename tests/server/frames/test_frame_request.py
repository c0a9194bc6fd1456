"""Channels: equal by value, and which of them show a variant."""

from __future__ import annotations

from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    ImagePortChannel,
    is_variant,
)
from catoptra_server.frames.plan.camera import CameraVariant


def test_channels_are_equal_by_value() -> None:
    assert ImagePortChannel() == IMAGE_PORT
    first, second = (CameraChannel("R", "", CameraVariant(samples=1)) for _ in range(2))
    assert len({first, second, CameraChannel("R", "")}) == 2


def test_variant_is_a_camera_by_other_settings() -> None:
    assert is_variant(CameraChannel("R", "Omni", CameraVariant()))
    assert not is_variant(CameraChannel("R", "Omni"))
    assert not is_variant(IMAGE_PORT)
