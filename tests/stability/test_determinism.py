"""Determinism: the same seed gives the same bytes, for images and filter."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.opengl import device_or_skip
from helpers.trace_engines import ENGINES, open_renderer
from helpers.worlds import (
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
)
from stability.consistency import run

WORLD = make_test_world(lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT))
CAMERA = make_omni_camera(width_px=96)
POSES = [Pose.from_rpy((0.1 * i, 0.05 * i, -0.6), (0.01 * i, -0.02 * i, 0.3 * i)) for i in range(6)]
HASH_OF_A_RUN = (
    "import hashlib, sys; sys.path[:0] = sys.argv[1:]; from stability.consistency import run;"
    "print(hashlib.sha256(run(3, believed=1.0).tobytes()).hexdigest())"
)


def pictures(renderer: Renderer) -> bytes:
    """Bytes of all poses' pictures, with robots in half of them."""
    view = renderer.prepare(CAMERA, make_plan(CAMERA, samples=2))
    exposures = [
        CameraState(pose, TWO_ROBOTS if index % 2 else ()) for index, pose in enumerate(POSES)
    ]
    drawn = b"".join(view.render(exposure).rgb.tobytes() for exposure in exposures)
    view.close()
    return drawn


@pytest.fixture(scope="module")
def device() -> Iterator[GlDevice]:
    device = device_or_skip()
    yield device
    device.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_traced_images_are_the_same_with_any_number_of_threads(engine: EngineName) -> None:
    drawn = []
    for threads in (1, 1, 2, 5):
        with open_renderer(engine, WORLD, threads=threads) as renderer:
            drawn.append(pictures(renderer))
    assert len(set(drawn)) == 1


def test_raster_images_are_the_same_twice_on_one_device(device: GlDevice) -> None:
    scene = build_scene(WORLD)
    once, again = (pictures(RasterRenderer(scene, WORLD, device=device)) for _ in range(2))
    assert once == again


@pytest.mark.parametrize("engine", ENGINES)
def test_image_does_not_depend_on_earlier_images(engine: EngineName) -> None:
    with open_renderer(engine, WORLD, threads=2) as renderer:
        view = renderer.prepare(CAMERA, make_plan(CAMERA))
        forwards = [view.render(CameraState(pose)).rgb for pose in POSES]
        backwards = [view.render(CameraState(pose)).rgb for pose in reversed(POSES)]
    assert all(map(np.array_equal, forwards, reversed(backwards)))


def test_filter_gives_the_same_bytes_in_several_threads_at_once() -> None:
    alone = [run(seed, believed=1.0).tobytes() for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        together = pool.map(lambda seed: run(seed, believed=1.0).tobytes(), range(4))
        assert list(together) == alone
    assert len(set(alone)) == 4


@pytest.mark.parametrize("hash_seed", ["0", "1", "4711"])
def test_filter_gives_the_same_bytes_in_another_process(hash_seed: str) -> None:
    answer = subprocess.run(
        [sys.executable, "-c", HASH_OF_A_RUN, *sys.path],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
        check=True,
    )
    expected = hashlib.sha256(run(3, believed=1.0).tobytes()).hexdigest()
    assert answer.stdout.strip() == expected
