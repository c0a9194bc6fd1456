"""Servers of the browser tests, and the robots on them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from browser.stream_probe import StreamProbe, connect_probe
from helpers.configs import CAMERAS, FIELD, OMNI_ROBOT, ROBOTS, Edit, write_edited_copy
from helpers.server_process import RunningServer, start_server

# The capture camera of OmniP2AT.
CAMERA = "OmniCamPillar_Link4"


@dataclass(frozen=True, slots=True)
class LiveServer:
    """A server with a live page."""

    server: RunningServer
    url: str
    """Address of the page."""
    probe: StreamProbe
    """A stream client without a robot, until a test spawns one."""

    @property
    def view_port(self) -> int:
        """Port of the page."""
        port = urlsplit(self.url).port
        assert port is not None, f"{self.url} has no port"
        return port


@dataclass(frozen=True, slots=True)
class OwnedServer:
    """A server with the client that owns its robot."""

    live: LiveServer
    owner: StreamProbe


@contextmanager
def start_live_server(
    folder: Path, robot: Path, *arguments: str, world: Path = FIELD, view_port: int = 0
) -> Iterator[LiveServer]:
    """Serve a page for the length of a block.

    Args:
        folder: Receives server.log.
        robot: Robot file.
        arguments: Further options of the command line.
        world: World file.
        view_port: Port of the page; 0: a free one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    options = ("--threads", "0", "--view", str(view_port), *arguments)
    with (
        start_server(folder, *options, robot=robot, world=world) as server,
        connect_probe(server.stream_port) as probe,
    ):
        yield LiveServer(server, _read_link(server), probe)


def _read_link(server: RunningServer) -> str:
    """Address of the page, from the line that the server prints after that of its ports."""
    assert server.process.stdout is not None, "stdout is a pipe"
    line = server.process.stdout.readline()
    found = re.fullmatch(r"live page: (http://\S+)\n", line)
    assert found, f"the server printed no address of a live page: {line!r}"
    return found[1]


def write_plain_robot(folder: Path, *edits: Edit, size_px: int = 640) -> Path:
    """Write the bundled robot with 20 frames a second."""
    return write_edited_copy(
        OMNI_ROBOT,
        folder,
        Edit("ResolutionX=360", f"ResolutionX={size_px}"),
        Edit("ResolutionY=360", f"ResolutionY={size_px}"),
        Edit("FrameInterval=0.0 ", "FrameInterval=0.05"),
        *edits,
    )


def write_parabolic_robot(folder: Path) -> Path:
    """Write the bundled robot with a parabolic mirror and a camera of 640 x 640 px."""
    return write_plain_robot(
        folder,
        Edit("class'Catoptra.HyperbolicMirror'", "class'Catoptra.ParabolicMirror'"),
        Edit("[Catoptra.HyperbolicMirror]", "[Catoptra.ParabolicMirror]\nHorizonRadius=0.5"),
        Edit("K=11.546", ""),
        Edit("C=2.321", ""),
    )


def write_fisheye_robot(folder: Path, *edits: Edit) -> Path:
    """Write the bundled robot with two fish-eyes: 220 degrees hanging, 185 looking ahead."""
    return write_edited_copy(
        ROBOTS / "p2at_fisheye.ini",
        folder,
        Edit("BasedOn=p2at.ini", f"BasedOn={ROBOTS / 'p2at.ini'}"),
        *edits,
    )


def write_tilted_robot(folder: Path) -> Path:
    """Write the robot with two fish-eyes; that in front rolled, raised, and turned to the right."""
    mount = "Position=(X=0.24,Y=0,Z=-0.20),Direction="
    edit = Edit(f"{mount}(X=0,Y=0,Z=0)", f"{mount}(X=0.15,Y=-0.35,Z=0.5)")
    return write_fisheye_robot(folder, edit)


def write_sphere_robot(folder: Path, *edits: Edit, base: Path = OMNI_ROBOT) -> Path:
    """Write the robot with a ball for a mirror, without a single viewpoint; exact rays always."""
    return write_edited_copy(
        ROBOTS / "p2at_sphere.ini",
        folder,
        Edit("BasedOn=p2at_omni.ini", f"BasedOn={OMNI_ROBOT}\nBasedOn={base}"),
        Edit(
            "[Catoptra.SphericalMirror]",
            "[Catoptra.OmniCaptureCamera]\nResolutionX=640\nResolutionY=640\n\n"
            "[Catoptra.SphericalMirror]",
        ),
        Edit("Central=auto", "Central=never"),
        *edits,
    )


def write_cone_robot(folder: Path) -> Path:
    """Write the robot with a cone for a mirror, which does not show the directions at its axis."""
    return write_sphere_robot(
        folder,
        Edit("class'Catoptra.SphericalMirror'", "class'Catoptra.ConicalMirror'"),
        Edit(
            "[Catoptra.SphericalMirror]",
            "[Catoptra.ConicalMirror]\nCentral=never\n\n[Catoptra.SphericalMirror]",
        ),
        base=CAMERAS / "conical.ini",
    )


def write_decentred_robot(folder: Path) -> Path:
    """Write the robot with two fish-eyes; the hanging one is that of KITTI-360, with p1 and p2."""
    return write_fisheye_robot(
        folder,
        Edit("class'Catoptra.HangingFisheye'", "class'Catoptra.Kitti360'"),
        Edit("BasedOn=", f"BasedOn={CAMERAS / 'kitti_360.ini'}\nBasedOn="),
        # Of 1400 px: with more samples the tests take minutes.
        Edit(
            "[Catoptra.HangingFisheye]", "[Catoptra.Kitti360]\nSamples=1\n[Catoptra.HangingFisheye]"
        ),
    )


def write_full_robot(folder: Path, size_px: int = 360) -> Path:
    """Write a robot with all sensors, two cameras, and all image effects of `p2at_omni_real`."""
    real = (ROBOTS / "p2at_omni_real.ini").read_text(encoding="utf-8")
    _, _, effects = real.partition("ResolutionY=480\n")
    assert effects.lstrip().startswith("Shadows"), "p2at_omni_real.ini has another order of keys"
    text = (
        f"[Configuration]\nBasedOn={ROBOTS / 'p2at_omni_full.ini'}\n\n"
        f"[Catoptra.OmniCaptureCamera]\nResolutionX={size_px}\nResolutionY={size_px}\n"
        f"FrameInterval=0.05\n{effects}"
    )
    path = folder / "full.ini"
    path.write_text(text, encoding="utf-8")
    return path
