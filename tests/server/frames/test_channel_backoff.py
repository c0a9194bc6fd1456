"""Pauses of channels whose frames fail."""

from __future__ import annotations

from catoptra_server.frames.frame import IMAGE_PORT, CameraChannel
from catoptra_server.frames.render_thread import ChannelBackoff

CAMERA = CameraChannel("R", "")


class _Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_channel_when_failing_is_paused_for_longer_and_longer() -> None:
    clock = _Clock()
    backoff = ChannelBackoff(clock)
    for pause_s in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0):
        assert backoff.find_reason(CAMERA) == ""
        backoff.record_failure(CAMERA, "broken")
        clock.now_s += pause_s - 0.001
        assert backoff.find_reason(CAMERA) == "broken"
        assert backoff.find_reason(IMAGE_PORT) == ""
        clock.now_s += 0.002


def test_channel_after_a_success_begins_anew() -> None:
    clock = _Clock()
    backoff = ChannelBackoff(clock)
    backoff.record_failure(CAMERA, "broken")
    backoff.record_failure(CAMERA, "broken")
    backoff.record_success(CAMERA)
    assert backoff.find_reason(CAMERA) == ""
    backoff.record_failure(CAMERA, "broken")
    clock.now_s = 1.001
    assert backoff.find_reason(CAMERA) == ""


def test_pauses_of_many_channels_are_limited() -> None:
    backoff = ChannelBackoff(_Clock())
    for number in range(1000):
        backoff.record_failure(CameraChannel("R", str(number)), "no camera")
    assert len(backoff._pauses) == 64
