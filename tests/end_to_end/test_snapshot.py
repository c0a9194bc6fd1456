"""`catoptra-client snapshot` against a server process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.__main__ import main
from catoptra_client.frame import Pixels, rgb_from_image_bytes
from catoptra_client.frame_pictures import make_panorama
from catoptra_client.frame_sources.frame_source import open_frame_source
from catoptra_server.__main__ import main as server_main
from helpers.gazebo_house import write_house
from helpers.server_process import RunningServer, start_server, write_small_robot


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """Server under lockstep, in which nothing moves."""
    folder = tmp_path_factory.mktemp("snapshot")
    with start_server(folder, "--clock", "lockstep", robot=write_small_robot(folder)) as running:
        yield running
        assert running.terminate() == 0


def take_snapshot(server: RunningServer, path: Path, *options: str) -> int:
    """Exit status of the command."""
    port = str(server.stream_port)
    return main(["snapshot", "--out", str(path), "--stream-port", port, *options])


def read_image(path: Path) -> Pixels:
    return rgb_from_image_bytes(path.read_bytes())


def test_snapshot_holds_the_frame_or_its_panorama(
    server: RunningServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", name="A", start_pose="Centre")
        source = open_frame_source(f"zmq://127.0.0.1:{server.stream_port}?robot=A&encoding=png")
        with source:
            frame = source.get_frame()
        assert take_snapshot(server, tmp_path / "a.png", "--robot", "A") == 0
        assert take_snapshot(server, tmp_path / "b.png", "--robot", "A", "--panorama") == 0
        client.reset()
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), frame.rgb)
    np.testing.assert_array_equal(read_image(tmp_path / "b.png"), make_panorama(frame))
    assert f"{tmp_path / 'a.png'}: {frame.rgb.shape[1]} x" in capsys.readouterr().out


def test_snapshot_without_any_robot_fails_instead_of_saving_a_black_picture(
    server: RunningServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert take_snapshot(server, tmp_path / "a.png") == 1
    assert "no robot with a camera has been spawned" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_snapshot_of_a_robot_that_does_not_exist_fails_with_a_reason(
    server: RunningServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert take_snapshot(server, tmp_path / "a.png", "--robot", "Nobody") == 1
    assert "catoptra-client snapshot: " in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_snapshot_spawns_a_robot_for_itself(
    server: RunningServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spawned = "--spawn", "USARBot.OmniP2AT"
    assert take_snapshot(server, tmp_path / "a.png", *spawned, "--start", "CornerCyanLeft") == 0
    assert take_snapshot(server, tmp_path / "b.png", *spawned) == 0
    first, second = read_image(tmp_path / "a.png"), read_image(tmp_path / "b.png")
    assert (first != second).any()
    with server.connect_stream() as client:
        assert client.get_state().robots == ()  # gone with the picture
    for words, hint in (
        (("--spawn", "USARBot.OmniP2A"), "this server has USARBot.OmniP2AT"),
        ((*spawned, "--start", "Center"), "did you mean Centre?"),
        ((*spawned, "--camera", "OmniCamPilar_Link4"), "have OmniCamPillar_Link4"),
    ):
        assert take_snapshot(server, tmp_path / "c.png", *words) == 1
        assert hint in capsys.readouterr().err
    assert not (tmp_path / "c.png").exists()


def test_snapshot_of_an_imported_world_shows_its_walls_around_its_start(tmp_path: Path) -> None:
    placements = write_house(tmp_path, num_models=5, num_placements=9, num_segments=2)
    path, out = tmp_path / "arena.world", tmp_path / "house.ini"
    # From the panorama's left border: behind, left, ahead and right, in Gazebo's axes.
    walls = {(0, 0, 1): (-40, 0), (1, 1, 0): (0, 40), (1, 0, 0): (40, 0), (0, 1, 0): (0, -40)}
    text = "<include><uri>model://ground_plane</uri></include>"
    for (r, g, b), (x, y) in walls.items():
        size = "1 81 20" if x else "81 1 20"
        text += (
            f"<model name='{r}{g}{b}'><pose>{x} {y} 10 0 0 0</pose><link name='l'><visual name='v'>"
            f"<geometry><box><size>{size}</size></box></geometry><material><diffuse>0 0 0</diffuse>"
            f"<emissive>{r} {g} {b}</emissive></material></visual></link></model>"
        )
    path.write_text(path.read_text().replace("</world>", f"{text}</world>"))
    models = str(tmp_path / "models")
    assert server_main(["import", str(path), "--models", models, "--out", str(out)]) == 0
    assert out.read_text().count("\nMeshes=") == len(placements)
    with start_server(tmp_path, "--clock", "lockstep", world=out) as running:
        spawned = "--spawn", "USARBot.OmniP2AT", "--panorama"
        assert take_snapshot(running, tmp_path / "a.png", *spawned) == 0
    picture = read_image(tmp_path / "a.png")
    columns = picture.shape[1] // 8
    # Behind is in the middle of the first quarter, once the picture is turned by an eighth.
    quarters = np.split(np.roll(picture, columns, axis=1)[:, : 8 * columns], 4, axis=1)
    for quarter, colour in zip(quarters, walls, strict=True):
        middle = quarter[:, columns // 2 : -columns // 2]
        shares = {
            other: float((np.abs(middle - 255.0 * np.array(other)) < 12).all(axis=-1).mean())
            for other in walls
        }
        assert shares.pop(colour) > 0.1
        assert max(shares.values()) == 0.0
