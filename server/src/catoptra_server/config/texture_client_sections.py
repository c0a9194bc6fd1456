"""Texture clients of an omnidirectional camera, a section each."""

from __future__ import annotations

import logging
import math

from catoptra_protocol.optics.cube_map import Face
from catoptra_server.config.ini_file import IniFile
from catoptra_server.simulation.robot_description import TextureClient

log = logging.getLogger(__name__)

# Of a face; as of an image.
_MAX_SIDE_PX = 8192


def read_texture_clients(file: IniFile) -> tuple[TextureClient, ...]:
    """Texture clients N, E, S, W, C, as USARSim spawns them, and U where the file has one."""
    names = {face: f"USARBot.USARCameraTextureClient{face.name}" for face in Face}
    missing = [n for face, n in names.items() if face is not Face.U and not file.has_section(n)]
    if missing:
        log.warning(
            "%s: no section %s: a texture client renders one side of what the mirror shows; it is "
            "served with FOV=90 and TextureSize=0; add the section with these lines to state them",
            file.path,
            ", ".join(f"[{name}]" for name in missing),
        )
    clients = []
    for face in Face:
        section = file.get_section(names[face])
        if face is Face.U and not file.has_section(section.name):
            continue
        # USARSim's key; another value than 90 leaves gaps between the faces or lets them overlap.
        fov = section.get_float("FOV", 90.0)
        if abs(fov - 90.0) > 1e-6:
            raise section.make_error("FOV", expected="90: the faces of a cube")
        clients.append(
            TextureClient(
                face=face,
                texture=section.get_str("DestTexture", f"OmniCam{face.name}"),
                fov_rad=math.radians(fov),
                size_px=section.get_int("TextureSize", 0, max_value=_MAX_SIDE_PX),
            )
        )
    return tuple(clients)
