"""The self-test: within its bound on this machine, and sensitive to a displaced image."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.commands.doctor import self_test as module
from catoptra_server.commands.doctor.self_test import max_error_px, run_self_test
from helpers.opengl import device_or_skip


def test_self_test_when_trace_renders_is_within_its_bound() -> None:
    values = run_self_test("trace")
    assert 0.0 < values["error_px"] <= values["bound_px"] < 0.5
    assert "Embree" in values["renderer"]


def test_self_test_when_raster_renders_is_within_its_bound() -> None:
    device_or_skip().close()
    values = run_self_test("raster")
    assert 0.0 < values["error_px"] <= values["bound_px"] < 0.5


def test_error_when_the_frame_is_shifted_is_the_shift() -> None:
    directions = module._disc_directions()
    rgb = render_discs()
    shifted = np.roll(rgb, 2, axis=1)
    assert max_error_px(shifted, module._CAMERA, directions) == pytest.approx(2.0, abs=0.3)


def test_error_when_the_frame_is_black_is_infinite() -> None:
    black = np.zeros((360, 360, 3), np.uint8)
    assert max_error_px(black, module._CAMERA, module._disc_directions()) == np.inf


def render_discs() -> np.ndarray:
    """Frame of the self-test, rendered by trace."""
    from catoptra_protocol.optics.transforms import Pose
    from catoptra_server.frames.plan.plans import plan_from_settings
    from catoptra_server.frames.plan.renderers import choose_renderer
    from catoptra_server.world.camera_state import CameraState
    from catoptra_server.world.scene_mesh import build_scene

    world = module._disc_world(module._disc_directions())
    choice = choose_renderer("trace", build_scene(world), world, threads=1)
    plan = plan_from_settings(
        module._RENDER_SETTINGS, module._CAMERA, kind=choice.kind, reason="test"
    )
    return choice.renderer.prepare(module._CAMERA, plan).render(CameraState(Pose.identity())).rgb
