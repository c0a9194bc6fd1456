"""Checks of pictures beside servers that are slow to show what has changed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from conformance import image_checks
from conformance.check import CheckFailed, ServerUnderTest

BLACK = np.zeros((64, 64, 3), dtype=np.uint8)
SCENE = np.random.default_rng(1).integers(0, 255, (64, 64, 1), dtype=np.uint8).repeat(3, axis=2)
SCENE[:32] //= 4
SERVER = cast(ServerUnderTest, SimpleNamespace(robot_class="Any", addresses={}))


def deliver(monkeypatch: pytest.MonkeyPatch, *pictures: np.ndarray[Any, Any]) -> None:
    """Stand in for a server with a camera whose image port sends pictures in turn."""
    remaining = iter(pictures)

    @contextmanager
    def open_with(value: object) -> Iterator[object]:
        yield value

    control = SimpleNamespace(query=lambda _: [{"Name": "Camera"}])
    images = SimpleNamespace(get_picture=lambda: next(remaining))
    monkeypatch.setattr(image_checks, "spawn_robot", lambda _: open_with(control))
    monkeypatch.setattr(image_checks, "connect_images", lambda _: open_with(images))


@pytest.mark.parametrize("num_early", [0, 1, 2])
def test_frames_from_before_the_spawn_are_skipped(
    monkeypatch: pytest.MonkeyPatch, num_early: int
) -> None:
    deliver(monkeypatch, *[BLACK] * num_early, SCENE, SCENE)
    image_checks.check_picture(SERVER)


def test_pictures_that_stay_black_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    deliver(monkeypatch, *[BLACK] * 3)
    with pytest.raises(CheckFailed, match="64 x 64 px in one colour"):
        image_checks.check_picture(SERVER)
