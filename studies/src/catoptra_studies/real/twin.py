"""The twin of a photograph, drawn by the server's code, and the camera that is fitted to draw it.

A twin is a board in a room of one colour. Files for the server say all of it, so a twin can be
served as it is: a world for each photograph (`catoptra-server --robot twin.ini --world NAME.ini`),
and a camera on a tripod at the origin, whose mirror frame is the world's. What is known of the
scene is drawn and nothing else: squares and margin of the board in the colours that its patches
have in the photograph, and the room's mean colour all around. Everything is shown at that light
whatever the lights (unlit): one light, the photograph's own.

A lens whose picture is mirrored stands for a mirror. `write_mirror_camera` makes that mirror of its
image radii (Chahl & Srinivasan 1997), with a focal length of the capture lens, so that defocus and
vignetting are those of a lens below a mirror.

Photographs of boards allow these parameters of a real camera:

* Blur. Widths of edges by incidence, less those of a twin without blur, are discs of defocus: a
  disc of diameter d has the deviation d / 4 along a line. The lens below the mirror has an f-number
  and a focus; the mirror's shape follows from the image radii and from the focal length of the
  lens, the third number. The size of the mirror and the pitch of pixels are taken as given: each
  scales the f-number alone.
* Noise. Patches of white and of black squares give two numbers, the full well and the read noise.
  Coding takes noise away and adds its own, so both are found by drawing, coding and measuring
  twins, and scaling the variances until they agree.
* Lateral colour: corners found again in red and in blue.

What cannot be told apart: diffraction and a demosaicing filter are blur that does not depend on the
incidence, and are in the f-number here; the lens's shading is not separated from the gradient of
the room's light; exposure, glare and black level are one level of black.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.camera_file import CameraFile, carry_camera, read_camera_file
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.kernels.lens_blur import Aperture, circle_of_confusion
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
from catoptra_studies.real.picture_measures import PictureMeasures, linear_light

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


PIXEL_PITCH_M = 7.4e-6
VERTEX_M = 0.1
"""Assumed: they scale the f-number alone."""
FOCAL_LENGTHS_PX = (400.0, 600.0, 800.0, 1200.0, 2000.0)
_SIGMA_PER_WIDTH = 1.0 / 2.5631
_BINS_DEG = np.arange(50.0, 121.0, 7.0)
_MIN_EDGES = 12
# Depths from the pinhole at which the lens may be sharp, over the viewpoint's.
_NUM_FOCI, _FOCUS_REACH = 60, (0.7, 6.0)
_F_NUMBERS = (0.7, 64.0)


@dataclass(frozen=True, slots=True)
class CameraParameters:
    """Parameters of effects, fitted or assumed."""

    focal_px: float = 800.0
    f_number: float = 4.0
    focus_m: float = 0.0
    full_well_e: float = 3000.0
    read_noise_e: float = 2.0
    red: float = 1.0
    blue: float = 1.0
    mean_light: float = 0.18
    """Of the photographs, for automatic exposure."""
    jpeg_quality: int | None = None

    def lens_lines(self) -> tuple[str, ...]:
        """Lines of the lens that effects share."""
        return (
            f"FNumber={self.f_number:.3f}",
            f"PixelPitch={PIXEL_PITCH_M}",
            f"FocusDistance={self.focus_m:.5f}",
        )

    def noise_lines(self) -> tuple[str, ...]:
        """Lines of the sensor's noise."""
        return (
            f"FullWell={self.full_well_e:.1f}",
            f"ReadNoiseElectrons={self.read_noise_e:.3f}",
        )


@dataclass(frozen=True, slots=True, eq=False)
class _BlurProfile:
    """Mean squares of edges' deviations by incidence, px^2, in bins with enough edges."""

    incidence_rad: Floats
    variance_px2: Floats


def _measure_blur(measures: Sequence[PictureMeasures]) -> _BlurProfile:
    """Blur by incidence of pictures together."""
    angle = np.concatenate([one.edge_incidence_rad for one in measures])
    variance = np.square(
        _SIGMA_PER_WIDTH * np.concatenate([one.edge_widths_px for one in measures])
    )
    number = np.digitize(np.degrees(angle), _BINS_DEG)
    kept = [n for n in range(1, len(_BINS_DEG)) if (number == n).sum() >= _MIN_EDGES]
    return _BlurProfile(
        np.array([angle[number == n].mean() for n in kept]),
        # Medians: an edge beside a hand is no edge of the board.
        np.array([np.median(variance[number == n]) for n in kept]),
    )


def _fit_blur(
    start: CameraParameters,
    cameras: Mapping[float, OmniCamera],
    photographs: _BlurProfile,
    base: _BlurProfile,
    range_m: float,
) -> tuple[CameraParameters, dict[float, float]]:
    """F-number, focus and focal length whose discs make the photographs' edges of the base's.

    Args:
        start: Parameters to change.
        cameras: Mirror camera by the focal length of its capture lens.
        photographs: Blur of the photographs.
        base: Blur of twins without defocus.
        range_m: Distance of the boards.

    Returns:
        The parameters, and the rms of what is left of the widths, px, by focal length.
    """
    there = np.interp(photographs.incidence_rad, base.incidence_rad, base.variance_px2)
    excess = np.maximum(photographs.variance_px2 - there, 0.0)
    best, left_by_focal = (math.inf, start), {}
    for focal_px, camera in cameras.items():
        radius = camera.radius_px_from_t(np.tan(0.5 * photographs.incidence_rad))
        found = math.inf, 1.0, 1.0
        vertex_m = camera.mirror.pinhole_distance_m
        low, high = (reach * vertex_m for reach in _FOCUS_REACH)
        # The best of a coarse grid, then of a fine one around it.
        for _ in range(2):
            grid = np.geomspace(low, high, _NUM_FOCI)
            each = [_fit_aperture(camera, radius, range_m, excess, focus) for focus in grid]
            found = min(found, *each)
            step = grid[1] / grid[0]
            low, high = found[2] / step, found[2] * step
        total, f_number, focus_m = found
        left_by_focal[focal_px] = total
        if total < best[0]:
            best = total, replace(start, focal_px=focal_px, f_number=f_number, focus_m=focus_m)
    return best[1], left_by_focal


def _fit_aperture(
    camera: OmniCamera, radius_px: Floats, range_m: float, excess: Floats, focus_m: float
) -> tuple[float, float, float]:
    """Rms left of the deviations, px, and the best f-number of one focus."""
    aperture = Aperture(1.0, PIXEL_PITCH_M, float(focus_m))
    discs = circle_of_confusion(aperture, camera, radius_px).diameter_px(np.array(range_m))
    variance = np.square(discs) / 16.0
    scale = float(variance @ excess) / max(float(variance @ variance), 1e-12)
    f_number = float(np.clip(1.0 / math.sqrt(max(scale, 1e-9)), *_F_NUMBERS))
    model = variance / (f_number * f_number)
    left = np.sqrt(model) - np.sqrt(excess)
    return math.sqrt(float(left @ left) / len(left)), f_number, float(focus_m)


def _refine_aperture(
    start: CameraParameters, photographs: _BlurProfile, drawn: _BlurProfile, base: _BlurProfile
) -> CameraParameters:
    """F-number scaled so that what defocus adds to the drawn edges is what photographs have."""

    def excess(one: _BlurProfile) -> float:
        there = np.interp(one.incidence_rad, base.incidence_rad, base.variance_px2)
        return float(np.maximum(one.variance_px2 - there, 1e-4).mean())

    factor = math.sqrt(excess(drawn) / excess(photographs))
    return replace(start, f_number=float(np.clip(start.f_number * factor, *_F_NUMBERS)))


def _refine_noise(
    start: CameraParameters,
    photographs: Sequence[PictureMeasures],
    drawn: Sequence[PictureMeasures],
) -> CameraParameters:
    """Full well and read noise scaled so that patches of both colours have their noise.

    Variance of light is s L + q: s of shot noise, q of read noise.
    """
    light, factor = [], []
    for is_white in (True, False):
        levels = [one.patch_levels[one.patch_is_white == is_white] for one in photographs]
        light.append(float(np.median(linear_light(np.concatenate(levels)))))
        each = [_mean_noise(group, is_white) for group in (photographs, drawn)]
        factor.append((each[0] / max(each[1], 0.05)) ** 2)
    s = 1.0 / start.full_well_e
    q = (start.read_noise_e / start.full_well_e) ** 2
    # A step changes a variance ninefold at most.
    wanted = [np.clip(f, 1 / 9, 9.0) * (s * at + q) for f, at in zip(factor, light, strict=True)]
    s = max((wanted[0] - wanted[1]) / max(light[0] - light[1], 1e-6), 1e-9)
    q = max(wanted[1] - s * light[1], 0.0)
    if q == 0.0:
        s = wanted[0] / light[0]
    return replace(start, full_well_e=1.0 / s, read_noise_e=math.sqrt(q) / s)


def _mean_noise(measures: Sequence[PictureMeasures], is_white: bool) -> float:
    return float(np.nanmean([one.noise(is_white) for one in measures]))


def describe_camera(
    parameters: CameraParameters, left_by_focal: Mapping[float, float], count: int
) -> tuple[str, ...]:
    """Lines of effects of the fitted camera's file, each number with its source."""
    p = parameters
    ties = ", ".join(f"{f:.0f}: {left:.3f}" for f, left in left_by_focal.items())
    lines = (
        ("DefocusByDepth=always", ""),
        ("Defocus=always", ""),
        (f"FNumber={p.f_number:.3f}", "fitted to edges; diffraction and demosaicing are in it"),
        (f"PixelPitch={PIXEL_PITCH_M}", "assumed: scales FNumber alone, as VertexDistance does"),
        (f"FocusDistance={p.focus_m:.5f}", "fitted to edges by incidence: m from the pinhole"),
        ("ChromaticAberration=always", ""),
        (f"RedMagnification={p.red:.6f}", "corners in red over those in green"),
        (f"BlueMagnification={p.blue:.6f}", "corners in blue over those in green"),
        ("Vignetting=always", "by the focal length; not told apart from the room's light"),
        ("ShotNoise=always", ""),
        (f"FullWell={p.full_well_e:.1f}", "fitted to white patches, through the coding"),
        ("ReadNoise=always", ""),
        (f"ReadNoiseElectrons={p.read_noise_e:.3f}", "fitted to black patches, likewise"),
    )
    return (
        f"; {count} photographs. Rms left of edges' deviations, px, by focal length, px: {ties}",
        *(f"{line:<28}; {source}" if source else line for line, source in lines),
    )


Draw = Callable[[CameraParameters], Sequence[PictureMeasures]]
"""Measures of the same photographs' twins, drawn and coded with parameters."""


def fit_camera(
    start: CameraParameters,
    cameras: Mapping[float, OmniCamera],
    photographs: Sequence[PictureMeasures],
    *,
    base: Sequence[PictureMeasures],
    draw: Draw,
    range_m: float,
    num_rounds: int = 2,
) -> tuple[CameraParameters, dict[float, float]]:
    """Parameters of a camera: blur in closed form, then both scales by drawing.

    Args:
        start: Parameters to begin with.
        cameras: Mirror camera by focal length.
        photographs: Measures of photographs.
        base: Measures of their twins without blur, coded.
        draw: Draws twins.
        range_m: Distance of the boards.
        num_rounds: Rounds of drawing.

    Returns:
        The parameters, and the rms left of edges by focal length.
    """
    blur, clean = _measure_blur(photographs), _measure_blur(base)
    fitted, left = _fit_blur(start, cameras, blur, clean, range_m)
    for _ in range(num_rounds):
        drawn = draw(fitted)
        fitted = _refine_aperture(fitted, blur, _measure_blur(drawn), clean)
        fitted = _refine_noise(fitted, photographs, drawn)
    return fitted, left
