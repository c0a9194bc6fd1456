"""A robot with a real camera, end to end: noise, self-view, motion blur, and their decisions."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_protocol.stream.requests import ImageEncoding
from helpers.configs import OMNI_ROBOT, Edit, write_edited_copy
from helpers.server_process import start_server

CLASS = "USARBot.OmniP2AT"
SENSOR = "\n".join(("Samples=2", "ShotNoise=auto", "ReadNoise=auto", "Quantisation=auto"))


SELF_VIEW = "\n".join(("Samples=1", "Fog=auto", "FogDensity=0.0"))


def write_noisy_robot(folder: Path) -> Path:
    return write_robot_with(folder, SENSOR)


def write_robot_with(folder: Path, effects: str) -> Path:
    return write_edited_copy(
        OMNI_ROBOT,
        folder,
        Edit("ResolutionX=360", "ResolutionX=64"),
        Edit("ResolutionY=360", "ResolutionY=64"),
        Edit("Samples=2", effects),
    )


def render_images(folder: Path, *arguments: str, viewers: int = 1) -> list[bytes]:
    """Bytes of three frames of a robot at rest, one step apart, under lockstep."""
    folder.mkdir()
    options = ("--clock", "lockstep", *arguments)
    images = []
    with start_server(folder, *options, robot=write_noisy_robot(folder)) as server:
        with server.connect_stream() as client:
            client.spawn(CLASS, name="Still", start_pose="Centre")
            for _ in range(3):
                client.step(0.2)
                for _ in range(viewers):
                    frame = client.get_frame(encoding=ImageEncoding.RAW, robot="Still")
                images.append(frame.rgb.tobytes())
                effects = {effect.name: effect for effect in frame.effects}
                assert [name for name, effect in effects.items() if effect.enabled] == [
                    "SelfView",
                    "ShotNoise",
                    "ReadNoise",
                ]
                assert (effects["ShotNoise"].duration_ms or 0.0) > 0.0
                assert effects["Quantisation"].duration_ms is None
                assert "12 bits" in effects["Quantisation"].reason
                assert frame.stage_ms is not None
                assert {"ShotNoise", "ReadNoise", "encode"} <= set(frame.stage_ms)
                assert np.ptp(frame.rgb) > 100
    return images


def test_noise_when_the_run_is_repeated_is_the_same_with_any_number_of_requests(
    tmp_path: Path,
) -> None:
    first = render_images(tmp_path / "first")
    assert len(set(first)) == 3
    assert render_images(tmp_path / "more", viewers=2) == first
    assert not set(render_images(tmp_path / "seed", "--seed", "1")) & set(first)


def test_self_view_when_in_the_file_shows_the_robot_and_states_its_extent(tmp_path: Path) -> None:
    robot = write_robot_with(tmp_path, SELF_VIEW)
    with start_server(tmp_path, "--clock", "lockstep", robot=robot) as server:
        with server.connect_stream() as client:
            client.spawn(CLASS, name="Self", start_pose="Centre")
            client.drive(2.0, 1.0)
            client.step(0.2)
            frame = client.get_frame(encoding=ImageEncoding.RAW, robot="Self")
    own, fog = frame.effects
    assert (own.name, own.enabled, own.duration_ms) == ("SelfView", True, None)
    assert own.reason.endswith("the robot is in view up to 46.7 degrees from the axis")
    assert (fog.name, fog.enabled, fog.reason) == ("Fog", False, "the air is clear")
    # Dark where the field is green.
    deck, field = frame.rgb[32, 34].astype(int), frame.rgb[32, 45].astype(int)
    assert np.ptp(deck) < 20
    assert np.ptp(field) > 40


def test_motion_blur_is_enabled_while_the_robot_turns(tmp_path: Path) -> None:
    robot = write_robot_with(
        tmp_path, "\n".join(("Samples=1", "MotionBlur=auto", "ExposureTime=0.1"))
    )
    effects, stages = [], []
    with start_server(tmp_path, "--clock", "lockstep", robot=robot) as server:
        with server.connect_stream() as client:
            client.spawn(CLASS, name="Dancer", start_pose="Centre")
            for speed in (0.0, 3.0, 0.0):
                client.drive(speed, -speed)
                client.step(0.2)
                frame = client.get_frame(encoding=ImageEncoding.RAW, robot="Dancer")
                effects += [one for one in frame.effects if one.name == "MotionBlur"]
                stages.append(frame.stage_ms or {})
    assert [(one.name, one.enabled) for one in effects] == [
        ("MotionBlur", False),
        ("MotionBlur", True),
        ("MotionBlur", False),
    ]
    assert effects[0].reason == effects[2].reason == "nothing moves"
    assert "turns by up to" in effects[1].reason
    # By the native kernel, or by any other renderer.
    is_blurred = [bool({"MotionBlur", "accumulate"} & one.keys()) for one in stages]
    assert is_blurred == [False, True, False]
