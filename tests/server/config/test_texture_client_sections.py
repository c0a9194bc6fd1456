"""Texture clients: five faces and, where the file has it, the sixth."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.cube_map import Face
from catoptra_server.config.camera_sections import read_texture_clients
from catoptra_server.config.ini_file import IniFile


def write_clients(folder: Path, faces: str, line: str = "FOV=90") -> IniFile:
    path = folder / "clients.ini"
    path.write_text("".join(f"[USARBot.USARCameraTextureClient{f}]\n{line}\n" for f in faces))
    return IniFile(path)


def test_clients_have_the_size_and_texture_of_their_sections(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    clients = read_texture_clients(write_clients(tmp_path, "NESWCU", "TextureSize=64"))
    assert [client.face for client in clients] == list(Face)
    assert {client.size_px for client in clients} == {64}
    assert clients[0].texture == "OmniCamN"
    assert clients[0].fov_rad == pytest.approx(math.pi / 2)
    assert not caplog.messages


def test_clients_without_sections_are_named_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        clients = read_texture_clients(write_clients(tmp_path, "NSC"))
    assert len(clients) == 5, "the sixth is optional"
    (message,) = caplog.messages
    assert "[USARBot.USARCameraTextureClientE], [USARBot.USARCameraTextureClientW]" in message


def test_client_with_another_angle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="90: the faces of a cube"):
        read_texture_clients(write_clients(tmp_path, "NESWC", "FOV=80"))
