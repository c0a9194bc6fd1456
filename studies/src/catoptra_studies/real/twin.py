"""The twin of a photograph: its board in a room of one colour, drawn by the server's code.

Files for the server say all of it, so a twin can be served as it is: a world for each photograph
(`catoptra-server --robot twin.ini --world NAME.ini`), and a camera on a tripod at the origin, whose
mirror frame is the world's. What is known of the scene is drawn and nothing else: squares and
margin of the board in the colours that its patches have in the photograph, and the room's mean
colour all around. Everything is shown at that light whatever the lights (unlit): one light, the
photograph's own.

A lens whose picture is mirrored stands for a mirror. `write_mirror_camera` makes that mirror of its
image radii (Chahl & Srinivasan 1997), with a focal length of the capture lens, so that defocus and
vignetting are those of a lens below a mirror.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.camera_file import CameraFile, carry_camera, read_camera_file
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.image_port import mounted_camera_state
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.simulation.robot_description import OmniCameraDescription
from catoptra_server.world.objects import NoiseSeed
from catoptra_server.world.scene_mesh import build_scene
from catoptra_studies.plot_style import Image
from catoptra_studies.real.photographs import Board

# Black squares lie this far before the white board: no ray of a board as near sees the step.
_LIFT_M = 2e-5
# Of the white board around its squares, in squares; measured in the Kaidan photographs.
_BOARD_MARGIN = 1.0
_KNOT_DEG = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class TwinScene:
    """What is drawn for one photograph."""

    name: str
    mirror_from_board: Pose
    white: Floats
    """(3,) sRGB levels."""
    black: Floats
    room: Floats
    black_parity: int
    """Of column + row of the black squares, counted from the first inner corner."""


def write_world(path: Path, scene: TwinScene, board: Board) -> None:
    """Write the world of a twin."""
    where = scene.mirror_from_board
    is_behind = bool(where.rotation[:, 2] @ where.translation < 0.0)
    # Half a turn about the board's x axis, so that a rectangle's upper side, -z, is the front.
    facing = where.rotation @ np.diag((1.0, -1.0, -1.0)) if is_behind else where.rotation
    roll, pitch, yaw = Pose(facing, where.translation).to_rpy()

    def rectangle(name: str, place: Floats, size: Floats, colour: Floats) -> str:
        x, y, z = where.transform_points(place)
        return (
            f'Rectangles=(Name="{name}",Position=(X={x:.7f},Y={y:.7f},Z={z:.7f}),'
            f"Direction=(X={roll:.8f},Y={pitch:.8f},Z={yaw:.8f}),Size=(X={size[0]:.6f},"
            f"Y={size[1]:.6f}),Colour={_colour(colour)},Unlit=true)"
        )

    side = board.square_m
    middle = 0.5 * side * np.array((board.columns - 1, board.rows - 1, 0.0))
    size = side * (np.array((board.columns, board.rows)) + 1.0 + 2.0 * _BOARD_MARGIN)
    lines = [
        "; The twin of a photograph: frame of the camera's mirror, z along its axis.",
        "[Catoptra.World]",
        f"Background={_colour(scene.room)}",
        rectangle("BoardWhite", middle, size, scene.white),
    ]
    lift_m = _LIFT_M if is_behind else -_LIFT_M
    lines += [
        rectangle("BoardBlack", np.array((side * (x + 0.5), side * (y + 0.5), lift_m)),
                  np.array((side, side)), scene.black)
        for x in range(-1, board.columns)
        for y in range(-1, board.rows)
        if (x + y) % 2 == scene.black_parity
    ]  # fmt: skip
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_mirror_camera(
    path: Path,
    camera: OmniCamera,
    *,
    focal_px: float,
    vertex_m: float,
    effects: Sequence[str] = (),
    origin: CameraFile | None = None,
) -> None:
    """Write the camera file of the mirror that has a camera's image radii.

    Args:
        path: File to write.
        camera: Camera model; its tangential distortion is left out.
        focal_px: Focal length of the capture lens.
        vertex_m: Distance from the capture lens's pinhole to the mirror's vertex.
        effects: Further lines of the capture camera's section.
        origin: File of the camera whose twin it is, for title and licence.
    """
    title, licence = (origin.title, origin.licence) if origin else ("A lens", "none")
    rim_deg = math.degrees(camera.rim_rad)
    angles = np.linspace(0.0, rim_deg, math.ceil(rim_deg / _KNOT_DEG) + 1)
    radii = camera.radius_px_from_t(np.tan(0.5 * np.radians(angles)))
    lines = [
        "; Written by `make real IMAGES=FOLDER UPDATE=yes`: see docs/real-mirror.md.",
        "[Camera]",
        "ItemClass=Catoptra.RadialTableMirror",
        f'Title="{title}, as a mirror below its capture lens"',
        'Source="catoptra-studies real; the source of each number is beside it"',
        f'Licence="{licence}"',
        "",
        "[Catoptra.RadialTableMirror]",
        "Angles=" + ",".join(f"{angle:.6f}" for angle in angles),
        "Radii=" + ",".join(f"{radius:.4f}" for radius in radii),
        f"FocalLength={focal_px:.3f}       ; px, capture lens: edges hardly tell it from others",
        f"VertexDistance={vertex_m:g}          ; assumed, m: scales FNumber alone",
        f"RimAngle={rim_deg - 1e-4:.4f}",
        "Central=always",
        "",
        "[Catoptra.OmniCaptureCamera]",
        f"ResolutionX={camera.width_px}",
        f"ResolutionY={camera.height_px}",
        f"CentreU={camera.centre_px[0]:.6f}",
        f"CentreV={camera.centre_px[1]:.6f}",
        f"FocalLength={focal_px:.3f}",
        f"FocalLengthY={focal_px * camera.plane.stretch[3]:.3f}",
        f"Picture={camera.picture.value}",
        "Samples=3",
        *effects,
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


class TwinCamera:
    """A camera file on a tripod, with one set of effects after another."""

    def __init__(self, camera_file: Path, folder: Path, name: str = "twin") -> None:
        """Write the tripod's file.

        Raises:
            ConfigError: The camera file is wrong.
        """
        self._file = read_camera_file(camera_file)
        self._path = folder.resolve() / f"{name}.ini"
        self.description = carry_camera(self._file, self._path, base_robot="tripod")

    @property
    def camera(self) -> OmniCamera:
        """Camera model."""
        return self.description.camera

    def with_effects(self, lines: Sequence[str]) -> OmniCameraDescription:
        """The camera with effects by further lines of its section."""
        section = self._file.item_class if self._file.is_lens else "Catoptra.OmniCaptureCamera"
        path = self._path.with_name(f"{self._path.stem}_effects.ini")
        text = ("[Configuration]", f"BasedOn={self._path}", f"[{section}]", *lines)
        path.write_text("\n".join(text) + "\n", encoding="utf-8")
        description = read_robot(path)[0].omni_camera
        assert description is not None, "the tripod carries the camera"
        return description


def draw_twins(
    world_file: Path, cameras: Mapping[str, OmniCameraDescription], *, exposure: int
) -> dict[str, Image]:
    """Pictures of one world by the same camera with different effects.

    Args:
        world_file: World of a photograph's twin.
        cameras: Camera by the name of its effects.
        exposure: Number of the exposure, by which noise differs.
    """
    world, _ = read_world(world_file)
    scene = build_scene(world)
    choice = choose_renderer("trace", scene, world, threads=1, is_reproducible=True)
    views = ViewCache(RenderPlanner(RendererPool(choice)), SceneSummarizer(scene, world))
    with closing(views):
        return {
            name: views.render(
                ViewRequest(
                    OmniCameraSpec(one.camera, one.render_settings, one.effects),
                    mounted_camera_state(
                        Pose.identity(),
                        one.robot_from_mirror,
                        noise_seed=NoiseSeed((7, 45), exposure),
                    ),
                )
            ).image.rgb.copy()
            for name, one in cameras.items()
        }


def _colour(levels: Floats) -> str:
    red, green, blue = (round(float(level)) for level in levels)
    return f"(R={red},G={green},B={blue})"
