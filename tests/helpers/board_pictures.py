"""Pictures of boards in known poses, by a camera whose effects are known: for photographs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image as PillowImage

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_studies.real.photographs import Board
from catoptra_studies.real.twin import TwinCamera, TwinScene, draw_twins, write_world

BOARD = Board(6, 5, 0.05)
WHITE, BLACK, ROOM = 170.0, 30.0, 110.0


def write_lens(path: Path, width_px: int) -> Path:
    """Camera file of the Kaidan mirror in pictures of another width."""
    scale = width_px / 640.0
    path.write_text(
        "[Camera]\nItemClass=Catoptra.Small\nTitle=t\nSource=s\nLicence=l\n[Catoptra.Small]\n"
        "Lens=unified\nXi=0.98\nK1=-0.155\nK2=0.0168\nP1=0.001\nP2=0.0004\n"
        f"FocalLength={158.2 * scale}\nFocalLengthY={158.0 * scale}\nCentreU={326.0 * scale}\n"
        f"CentreV={246.6 * scale}\nFieldOfView=242\nPicture=mirrored\nSamples=3\n"
        f"ResolutionX={width_px}\nResolutionY={round(480 * scale)}\n",
        encoding="utf-8",
    )
    return path


@dataclass(frozen=True, slots=True, eq=False)
class KnownPictures:
    """Pictures in a folder, and what they show."""

    folder: Path
    camera: OmniCamera
    poses: tuple[Pose, ...]


def known_poses(count: int, board: Board = BOARD, distance_m: float = 0.3) -> tuple[Pose, ...]:
    """Poses of boards around the mirror, seen at 55 to 120 degrees."""
    middle = 0.5 * board.square_m * np.array((board.columns - 1, board.rows - 1, 0.0))
    poses = []
    for number in range(count):
        azimuth = 2.0 * math.pi * number / count + 0.3
        theta = math.radians((76.0, 97.0, 85.0)[number % 3])
        away = np.array(
            (math.sin(theta) * math.cos(azimuth), math.sin(theta) * math.sin(azimuth),
             math.cos(theta))
        )  # fmt: skip
        across = np.cross((0.0, 0.0, 1.0), away)
        across /= np.linalg.norm(across)
        tilt = 0.25 * ((number % 4) - 1.5)
        frame = np.stack((across, np.cross(away, across), away), axis=1)
        turn = np.array(((math.cos(tilt), 0.0, math.sin(tilt)), (0.0, 1.0, 0.0),
                         (-math.sin(tilt), 0.0, math.cos(tilt))))  # fmt: skip
        rotation = frame @ turn
        poses.append(Pose(rotation, distance_m * away - rotation @ middle))
    return tuple(poses)


def write_pictures(
    folder: Path,
    camera_file: Path,
    poses: Sequence[Pose],
    *,
    effects: Sequence[str] = (),
    board: Board = BOARD,
) -> KnownPictures:
    """Draw boards and write the pictures as PNG, into a folder of their own."""
    pictures = folder / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    twin = TwinCamera(camera_file, folder, "own")
    camera = twin.with_effects(effects)
    grey = [np.full(3, level) for level in (WHITE, BLACK, ROOM)]
    for number, pose in enumerate(poses):
        write_world(folder / "own_world.ini", TwinScene("own", pose, *grey, 0), board)
        rgb = draw_twins(folder / "own_world.ini", {"own": camera}, exposure=100 + number)["own"]
        PillowImage.fromarray(rgb).save(pictures / f"picture{number}.png")
    return KnownPictures(pictures, camera.camera, tuple(poses))
