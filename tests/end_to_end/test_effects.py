"""A robot with a real sensor: its noise is in the frames, keyed, told of, and the same again."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_protocol.wire.stream_requests import Encoding
from helpers.configs import OMNI_ROBOT, Edit, edited_copy
from helpers.server_process import running_server

CLASS = "USARBot.OmniP2AT"
SENSOR = "\n".join(("Samples=2", "ShotNoise=auto", "ReadNoise=auto", "Quantisation=auto"))


def noisy_robot(folder: Path) -> Path:
    return edited_copy(
        OMNI_ROBOT,
        folder,
        Edit("ResolutionX=360", "ResolutionX=64"),
        Edit("ResolutionY=360", "ResolutionY=64"),
        Edit("Samples=2", SENSOR),
    )


def pictures(folder: Path, *arguments: str, viewers: int = 1) -> list[bytes]:
    """Return three pictures of a robot that stands still, a step apart, in lockstep."""
    folder.mkdir()
    options = ("--clock", "lockstep", *arguments)
    shown = []
    with running_server(folder, *options, robot=noisy_robot(folder)) as server:
        with server.stream() as client:
            client.spawn(CLASS, name="Still", start="Centre")
            for _ in range(3):
                client.step(0.2)
                for _ in range(viewers):
                    frame = client.frame(encoding=Encoding.RAW, robot="Still")
                shown.append(frame.rgb.tobytes())
                told = {effect.name: effect for effect in frame.effects}
                assert [name for name, effect in told.items() if effect.is_on] == [
                    "ShotNoise",
                    "ReadNoise",
                ]
                assert (told["ShotNoise"].ms or 0.0) > 0.0
                assert told["Quantisation"].ms is None
                assert "12 bits" in told["Quantisation"].reason
                assert frame.stage_ms is not None
                assert {"ShotNoise", "ReadNoise", "encode"} <= set(frame.stage_ms)
                assert np.ptp(frame.rgb) > 100
    return shown


def test_noise_when_the_run_is_repeated_is_the_same_whoever_asks_for_more(tmp_path: Path) -> None:
    first = pictures(tmp_path / "first")
    assert len(set(first)) == 3
    assert pictures(tmp_path / "again") == first
    assert pictures(tmp_path / "more", viewers=2) == first
    assert not set(pictures(tmp_path / "seed", "--seed", "1")) & set(first)
