"""A robot with a real sensor, end to end: its noise, its own body, and what is told of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_protocol.stream.requests import ImageEncoding
from helpers.configs import OMNI_ROBOT, Edit, write_edited_copy
from helpers.server_process import start_server

CLASS = "USARBot.OmniP2AT"
SENSOR = "\n".join(("Samples=2", "ShotNoise=auto", "ReadNoise=auto", "Quantisation=auto"))


SELF_VIEW = "\n".join(("Samples=1", "SelfView=auto", "Fog=auto", "FogDensity=0.0"))


def noisy_robot(folder: Path) -> Path:
    return robot_with(folder, SENSOR)


def robot_with(folder: Path, effects: str) -> Path:
    return write_edited_copy(
        OMNI_ROBOT,
        folder,
        Edit("ResolutionX=360", "ResolutionX=64"),
        Edit("ResolutionY=360", "ResolutionY=64"),
        Edit("Samples=2", effects),
    )


def render_images(folder: Path, *arguments: str, viewers: int = 1) -> list[bytes]:
    """Return three pictures of a robot that stands still, a step apart, in lockstep."""
    folder.mkdir()
    options = ("--clock", "lockstep", *arguments)
    shown = []
    with start_server(folder, *options, robot=noisy_robot(folder)) as server:
        with server.connect_stream() as client:
            client.spawn(CLASS, name="Still", start_pose="Centre")
            for _ in range(3):
                client.step(0.2)
                for _ in range(viewers):
                    frame = client.get_frame(encoding=ImageEncoding.RAW, robot="Still")
                shown.append(frame.rgb.tobytes())
                told = {effect.name: effect for effect in frame.effects}
                assert [name for name, effect in told.items() if effect.enabled] == [
                    "ShotNoise",
                    "ReadNoise",
                ]
                assert (told["ShotNoise"].duration_ms or 0.0) > 0.0
                assert told["Quantisation"].duration_ms is None
                assert "12 bits" in told["Quantisation"].reason
                assert frame.stage_ms is not None
                assert {"ShotNoise", "ReadNoise", "encode"} <= set(frame.stage_ms)
                assert np.ptp(frame.rgb) > 100
    return shown


def test_noise_when_the_run_is_repeated_is_the_same_whoever_asks_for_more(tmp_path: Path) -> None:
    first = render_images(tmp_path / "first")
    assert len(set(first)) == 3
    assert render_images(tmp_path / "again") == first
    assert render_images(tmp_path / "more", viewers=2) == first
    assert not set(render_images(tmp_path / "seed", "--seed", "1")) & set(first)


def test_robot_when_its_file_asks_for_it_sees_itself_and_says_how_far(tmp_path: Path) -> None:
    robot = robot_with(tmp_path, SELF_VIEW)
    with start_server(tmp_path, "--clock", "lockstep", robot=robot) as server:
        with server.connect_stream() as client:
            client.spawn(CLASS, name="Self", start_pose="Centre")
            client.drive(2.0, 1.0)
            client.step(0.2)
            frame = client.get_frame(encoding=ImageEncoding.RAW, robot="Self")
    own, fog = frame.effects
    assert (own.name, own.enabled, own.unit, own.duration_ms) == ("SelfView", True, "px", None)
    assert own.reason == "the robot is seen up to 46.7 degrees from the axis"
    assert (fog.name, fog.enabled, fog.reason) == ("Fog", False, "the air is clear")
    # Dark where the field is green.
    deck, field = frame.rgb[32, 34].astype(int), frame.rgb[32, 45].astype(int)
    assert np.ptp(deck) < 20
    assert np.ptp(field) > 40


def test_robot_is_blurred_while_it_turns_and_sharp_again_when_it_stands(tmp_path: Path) -> None:
    robot = robot_with(tmp_path, "\n".join(("Samples=1", "MotionBlur=auto", "ExposureTime=0.1")))
    told, stages = [], []
    with start_server(tmp_path, "--clock", "lockstep", robot=robot) as server:
        with server.connect_stream() as client:
            client.spawn(CLASS, name="Dancer", start_pose="Centre")
            for speed in (0.0, 3.0, 0.0):
                client.drive(speed, -speed)
                client.step(0.2)
                frame = client.get_frame(encoding=ImageEncoding.RAW, robot="Dancer")
                told += frame.effects
                stages.append(frame.stage_ms or {})
    assert [(one.name, one.is_on, one.unit) for one in told] == [
        ("MotionBlur", False, "px"),
        ("MotionBlur", True, "px"),
        ("MotionBlur", False, "px"),
    ]
    assert told[0].reason == told[2].reason == "nothing moves"
    assert "turns by up to" in told[1].reason
    assert ["accumulate" in one for one in stages] == [False, True, False]
