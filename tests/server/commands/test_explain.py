"""Effects of a robot's cameras with their cost: the command, the camera's state, the times."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.__main__ import main
from catoptra_server.commands.explain import (
    ZERO_VELOCITY,
    PlanarVelocity,
    build_camera_state,
    measure_effect_times,
    stand_robot,
)
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import read_startup_config
from catoptra_server.effects import EFFECT_TYPES, DecisionBasis, EffectMode, EffectSettings
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.views import RenderedView
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import AT_REST
from helpers.motion_reference import relative_twist
from helpers.robots import make_rendered_view

WALL = PlanarPose(6.0, 0.0, 0.0)
QUESTION = ["--world", "incidence_rings", "--renderer", "trace"]


def test_camera_when_its_file_names_effects_is_explained_row_by_row(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["explain", "--robot", "p2at_omni_real", *QUESTION]) == 0
    printed = capsys.readouterr().out.splitlines()
    head, bound, _, *rows, cost = printed
    assert bound.startswith("error bound: max_px 0.0")
    assert head.startswith("USARBot.OmniP2AT OmniCamPillar_Link4: trace")
    names = [row.split()[0] for row in rows]
    assert names == [name for name in EFFECT_TYPES if name in names], "in optical order"
    assert {"Fog", "Vignetting", "ShotNoise"} <= set(names)
    assert any("a converter of 12 bits" in row and " off " in row for row in rows)
    # Names, states and milliseconds stand in columns; what is left out has no time.
    header = next(line for line in printed if line.startswith("effect "))
    end = header.index(" ms ") + 3
    times = {row.split()[0]: row[end - 7 : end].strip() for row in rows}
    on = {row.split()[0] for row in rows if row.split()[1] == "on"}
    assert on <= {name for name, ms in times.items() if ms}
    assert {"SelfView", "Vignetting"} <= on, "a scene effect and an image effect"
    match = re.fullmatch(
        r"a frame takes ([\d.]+) ms: ([\d.]+) ms for effects, ([\d.]+) ms for all else", cost
    )
    assert match is not None
    total, effects, other = map(float, match.groups())
    assert effects == pytest.approx(sum(float(ms) for ms in times.values() if ms), abs=1e-9)
    assert total == pytest.approx(effects + other, abs=1e-9)


def test_camera_without_effects_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "--robot", "p2at", *QUESTION]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("USARBot.P2AT Camera: trace")
    assert "no effects: the robot file names none" in printed


def test_mirror_without_a_viewpoint_has_its_near_limit_and_the_scene_s_clearance(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["explain", "--robot", "p2at_sphere", *QUESTION]) == 0
    first, _, second, *_ = capsys.readouterr().out.splitlines()
    assert "exact rays while anything is nearer than 1.39 m" in first
    assert re.fullmatch(
        r"no single viewpoint: rays miss the best one by up to 7.5 mm; "
        r"central to 0.25 px from 1.39 m; nothing is nearer than 0\.\d+ m here",
        second,
    )


def test_every_camera_of_a_robot_is_explained_the_omnidirectional_one_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = tmp_path / "robot.ini"
    robot.write_text(
        f"[Configuration]\nBasedOn={find_configuration('robots', 'p2at_omni_full')}\n"
        "[USARBot.RobotCamera]\nResolutionX=64\nResolutionY=48\nVignetting=auto\n"
        "MotionBlur=auto\nDefocus=auto\n"
    )
    drive = ["--velocity", "0.5,0,1", "--json"]
    assert main(["explain", "--robot", str(robot), *QUESTION, *drive]) == 0
    omni, lens = json.loads(capsys.readouterr().out)
    assert (omni["camera"], lens["camera"]) == ("OmniCamPillar_Link4", "Camera")
    enabled = {one["effect"]: one["enabled"] for one in lens["effects"]}
    # Focused at infinity, nothing is blurred; the corners are dark, and the robot turns.
    assert enabled == {"MotionBlur": True, "Defocus": False, "Vignetting": True}


def test_explanation_as_json_has_the_same_decisions(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--robot", "p2at_omni_real", *QUESTION, "--pose", "0.5,0,1", "--json"]
    assert main(["explain", *words]) == 0
    (report,) = json.loads(capsys.readouterr().out)
    running = {one["effect"] for one in report["effects"] if one["enabled"]}
    assert running <= set(report["effect_ms"]), "scene effects, too"
    assert min(report["effect_ms"].values()) >= 0.0
    assert report["other_ms"] > 0.0


def test_robot_without_a_camera_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "--robot", "kenaf", *QUESTION]) == 0
    assert capsys.readouterr().out == "no robot has a camera\n"


def test_cameras_are_explained_where_a_robot_stands(tmp_path: Path) -> None:
    # A deck of a metre at the only start, and a wall at another place.
    world = tmp_path / "deck.ini"
    world.write_text(
        "[Catoptra.World]\n"
        'PlayerStarts=(Tag="Deck",Location=(X=0,Y=0,Z=-1),Rotation=(X=0,Y=0,Z=0))\n'
        'Rectangles=(Name="Floor",Position=(X=0,Y=0,Z=0),Size=(X=20,Y=20))\n'
        'Boxes=(Name="Deck",Position=(X=0,Y=0,Z=-0.9),Size=(X=4,Y=4,Z=0.2))\n'
        'Boxes=(Name="Wall",Position=(X=6,Y=0,Z=-0.5),Size=(X=1,Y=1,Z=1))\n',
        encoding="utf-8",
    )
    robot = find_configuration("robots", "p2at")
    startup = read_startup_config([robot], world)
    ride_m = startup.robots[0].drive.ride_height_m
    for place, height_m in ((None, 1.0), (PlanarPose(4.0, 3.0, 0.0), 0.0), (WALL, 0.0)):
        base = stand_robot(startup, startup.robots[0], place)
        assert -base.translation[2] == pytest.approx(height_m + ride_m, abs=1e-6)


def test_missing_file_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "--robot", "nobody.ini", *QUESTION]) == 1
    assert "nobody.ini" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "text", "expected"),
    [
        *(
            ("--pose", text, "a pose is three numbers X,Y,YAW")
            for text in ("1,2", "a,b,c", "1,2,nan")
        ),
        *(
            ("--velocity", text, "a velocity is three numbers VX,VY,YAWRATE")
            for text in ("1", "a,b,c", "0,inf,0")
        ),
    ],
)
def test_malformed_numbers_are_rejected(
    option: str, text: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["explain", "--robot", "p2at_omni", *QUESTION, option, text])
    assert expected in capsys.readouterr().err


def camera_at(velocity: PlanarVelocity, *, yaw_rad: float = 0.0) -> CameraState:
    files = find_configuration("robots", "p2at_omni_real")
    (robot,) = read_startup_config([files], find_configuration("worlds", "incidence_rings")).robots
    assert robot.omni_camera is not None
    mount = Pose.from_rpy((0.2, 0.0, -0.4543))
    omni = replace(robot.omni_camera, robot_from_mirror=mount)
    return build_camera_state(robot, omni, PlanarPose(1.0, 2.0, yaw_rad), velocity)


def test_velocity_is_that_of_the_mirror_in_world_axes() -> None:
    # The robot faces y and turns clockwise: the mirror, 0.2 m ahead, also moves to the right.
    twist = camera_at(PlanarVelocity(0.5, 0.1, 0.7), yaw_rad=0.5 * math.pi).twist
    assert twist.linear_m_s == pytest.approx((-0.1 - 0.2 * 0.7, 0.5, 0.0))
    assert twist.angular_rad_s == pytest.approx((0.0, 0.0, 0.7))


def test_ego_body_of_a_moving_robot_is_at_rest_in_the_image() -> None:
    state = camera_at(PlanarVelocity(0.5, 0.1, 0.7), yaw_rad=0.3)
    assert state.ego_body is not None
    assert state.twist.speed_m_s > 0.4
    assert relative_twist(state, state.ego_body).speed_m_s == pytest.approx(0.0, abs=1e-15)


def test_robot_without_a_velocity_is_at_rest(capsys: pytest.CaptureFixture[str]) -> None:
    assert camera_at(ZERO_VELOCITY).twist == AT_REST
    assert main(["explain", "--robot", "p2at_omni_real", *QUESTION, "--velocity", "0.5,0,0.3"]) == 0
    printed = capsys.readouterr().out
    assert "the robot is in view up to 46.7 degrees from the axis" in printed


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

    def measure(self) -> tuple[RenderedView, dict[str, float], float]:
        return measure_effect_times(
            self.render, make_request(), num_frames=3, clock=lambda: self.now_s
        )


def test_effects_without_a_stage_are_differences_of_frames() -> None:
    costs = {"SelfView": 2.0, "Shadows": 5.0, "MotionBlur": 40.0, "Defocus": 3.0, "Bayer": 1.5}
    view, effect_ms, other_ms = FakeMachine(costs).measure()
    assert effect_ms == pytest.approx(costs)
    assert list(effect_ms) == list(costs), "in optical order"
    assert other_ms == pytest.approx(10.0)
    # The view is that with all effects.
    assert [one.effect for one in view.effect_decisions] == list(costs)


def test_effect_that_a_frame_drew_to_measure_it_has_a_time() -> None:
    _, effect_ms, _ = FakeMachine({"Shadows": 5.0, "Bayer": 1.0}, measured="Shadows").measure()
    assert effect_ms["Shadows"] == pytest.approx(5.0)


def test_no_effect_takes_less_than_nothing_and_the_sum_is_the_frame() -> None:
    machine = FakeMachine({"SelfView": 2.0, "Shadows": 0.0})
    # One frame to begin with, then three kinds by turns, of which the one without shadows is slow.
    machine.jitter_ms = iter([0.0, *[0.0, 3.0, 0.0] * 5])
    _, effect_ms, other_ms = machine.measure()
    assert effect_ms == pytest.approx({"SelfView": 2.0, "Shadows": 0.0})
    assert other_ms == pytest.approx(10.0)


def test_camera_without_effects_has_a_time_of_its_own() -> None:
    request = make_request()
    assert isinstance(request.camera, OmniCameraSpec)
    bare = replace(request, camera=replace(request.camera, effect_settings=EffectSettings()))
    machine = FakeMachine({"Bayer": 1.0})
    _, effect_ms, other_ms = measure_effect_times(
        machine.render, bare, num_frames=1, clock=lambda: machine.now_s
    )
    assert effect_ms == {}
    assert other_ms == pytest.approx(10.0)
