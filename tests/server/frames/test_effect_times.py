from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.commands.explain import EffectTimes, measure_effect_times
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import read_startup_config
from catoptra_server.effects.effect import DecisionBasis, EffectMode, EffectSettings
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.views import RenderedView
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.world.camera_state import CameraState
from helpers.robots import make_rendered_view

IMAGE = np.zeros((1, 1, 3), dtype=np.uint8)
STAGES = {"Bayer", "Defocus"}


def make_request() -> ViewRequest:
    robot, world = (
        find_configuration(kind, name)
        for kind, name in (("robots", "p2at_omni_real"), ("worlds", "incidence_rings"))
    )
    omni = read_startup_config([robot], world).robots[0].omni_camera
    assert omni is not None
    spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
    return ViewRequest(spec, CameraState(Pose.identity()))


class FakeMachine:
    """Frames whose time is known: so much for each effect, by a clock that shows it."""

    def __init__(self, costs_ms: Mapping[str, float], *, measured: str = "") -> None:
        self.costs_ms = costs_ms
        self.measured = measured
        self.now_s = 0.0
        self.jitter_ms = iter(())

    def render(self, request: ViewRequest) -> RenderedView:
        assert isinstance(request.camera, OmniCameraSpec)
        settings: EffectSettings = request.camera.effect_settings
        on = [
            one.effect.name
            for one in settings.settings
            if one.mode is not EffectMode.NEVER and one.effect.name in self.costs_ms
        ]
        frame_ms = 10.0 + sum(self.costs_ms[name] for name in on) + next(self.jitter_ms, 0.0)
        self.now_s += 1e-3 * frame_ms
        decisions = tuple(
            EffectDecision(
                effect=name,
                enabled=name != self.measured,
                bound=1.0,
                threshold=0.5,
                reason="",
                basis=DecisionBasis.MEASURED if name == self.measured else DecisionBasis.PROVED,
                **({"unit": ""} if "unit" in EffectDecision.__dataclass_fields__ else {}),
            )
            for name in on
        )
        stages = {name: self.costs_ms[name] for name in on if name in STAGES} | {"trace": 10.0}
        return make_rendered_view(RenderedImage(IMAGE, stages), request, decisions=decisions)

    def measure(self) -> EffectTimes:
        return measure_effect_times(
            self.render, make_request(), num_frames=3, clock=lambda: self.now_s
        )


def test_effects_without_a_stage_are_differences_of_frames() -> None:
    costs = {"SelfView": 2.0, "Shadows": 5.0, "MotionBlur": 40.0, "Defocus": 3.0, "Bayer": 1.5}
    times = FakeMachine(costs).measure()
    assert times.effect_ms == pytest.approx(costs)
    assert list(times.effect_ms) == list(costs), "in optical order"
    assert times.other_ms == pytest.approx(10.0)
    assert times.frame_ms == pytest.approx(10.0 + sum(costs.values()))


def test_effect_that_a_frame_drew_to_measure_it_has_a_time() -> None:
    times = FakeMachine({"Shadows": 5.0, "Bayer": 1.0}, measured="Shadows").measure()
    assert times.effect_ms["Shadows"] == pytest.approx(5.0)


def test_no_effect_takes_less_than_nothing_and_the_sum_is_the_frame() -> None:
    machine = FakeMachine({"SelfView": 2.0, "Shadows": 0.0})
    # One frame to begin with, then three kinds by turns, of which the one without shadows is slow.
    machine.jitter_ms = iter([0.0, *[0.0, 3.0, 0.0] * 5])
    times = machine.measure()
    assert times.effect_ms == pytest.approx({"SelfView": 2.0, "Shadows": 0.0})
    assert times.frame_ms == pytest.approx(12.0)


def test_view_is_that_with_all_effects() -> None:
    times = FakeMachine({"SelfView": 2.0, "Bayer": 1.0}).measure()
    assert [one.effect for one in times.view.effect_decisions] == ["SelfView", "Bayer"]


def test_camera_without_effects_has_a_time_of_its_own() -> None:
    request = make_request()
    assert isinstance(request.camera, OmniCameraSpec)
    bare = replace(request, camera=replace(request.camera, effect_settings=EffectSettings()))
    machine = FakeMachine({"Bayer": 1.0})
    times = measure_effect_times(machine.render, bare, num_frames=1, clock=lambda: machine.now_s)
    assert times.effect_ms == {}
    assert times.frame_ms == pytest.approx(10.0)
