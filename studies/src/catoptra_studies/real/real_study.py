"""The study: check photographs, draw their twins with each effect, fit the camera, compare.

Photographs are independent of each other, so processes share them; every number follows from the
files and from fixed seeds, whatever the number of processes. A lens camera whose picture is
mirrored becomes the mirror of its image radii for the twins (`twin`); another lens stays one,
without the effects of mirrors.
"""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from catoptra_client.landmarks import Viewpoint, label_frame, world_from_mirror
from catoptra_client.landmarks.classifier import ColourClassifier, label_image
from catoptra_client.landmarks.training import train
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.known_names import find_configuration
from catoptra_server.render.renderer import PerPixel, RenderSettings
from catoptra_server.simulation.robot_description import OmniCameraDescription, PlanarPose
from catoptra_studies.plot_style import Image
from catoptra_studies.real.gap_table import (
    CLEAN,
    GapRow,
    Sample,
    TransferRow,
    compare_pictures,
    judge_transfer,
)
from catoptra_studies.real.photographs import (
    Board,
    BoardPose,
    Calibration,
    Photograph,
    PhotographSet,
    calibrate,
    code_picture,
    cross_validate,
    find_corners,
    find_pose,
    have_other_hand,
    measure_straightness_px,
    order_corners,
    read_photographs,
)
from catoptra_studies.real.picture_measures import (
    PictureMeasures,
    linear_light,
    measure_lateral_colour,
    measure_picture,
    pixel_directions,
)
from catoptra_studies.real.twin import (
    FOCAL_LENGTHS_PX,
    VERTEX_M,
    CameraParameters,
    TwinCamera,
    TwinScene,
    describe_camera,
    draw_twins,
    fit_camera,
    write_mirror_camera,
    write_world,
)
from catoptra_studies.study_subject import FIGURE_RENDERERS, open_study_subject

_VIGNETTING = "Vignetting=always"
ALL, FITTED = "all effects", "fitted camera"
EFFECTS = (
    "defocus", "diffraction", "noise", "mosaic", "vignetting", "lateral colour", "exposure",
    "glare", "dust", "holder",
)  # fmt: skip
# Photographs of which the camera's scales are fitted by drawing.
_NUM_FITTED = 6
_NUM_TRAINING_FRAMES, _TRAINING_PX = 20, 360


@dataclass(frozen=True, slots=True)
class StudyOptions:
    """Folder, camera and board of a study."""

    folder: Path
    camera_file: Path
    board: Board
    out: Path
    effects: tuple[str, ...] = EFFECTS
    """Those to force on alone, and together."""
    num_processes: int = field(default=2, compare=False)


@dataclass(frozen=True, slots=True, eq=False)
class StudyResult:
    """Everything that the report says."""

    photographs: PhotographSet
    calibration: Calibration
    validated: tuple[BoardPose, ...]
    """Poses by cameras that were fitted to the other half."""
    straightness_px: Floats
    """(n,) corners off their straight rows."""
    corner_incidence_rad: Floats
    twin_corner_rms_px: float
    """Corners of the clean twin off their projections."""
    parameters: CameraParameters
    left_by_focal: Mapping[float, float]
    camera_lines: tuple[str, ...]
    """Effects of the fitted camera, with their sources."""
    rows: tuple[GapRow, ...]
    transfer: tuple[TransferRow, ...]
    examples: Mapping[str, Image]
    """Pictures of the first photograph's twins."""
    samples: Mapping[str, Sequence[Sample]]


def run_study(options: StudyOptions, *, on_step: Callable[[], None] = lambda: None) -> StudyResult:
    """Run the study; files of the twins are left in the folder of the output.

    Args:
        options: What to study.
        on_step: Called after each step of `num_steps`.

    Raises:
        CatoptraError: The photographs or the camera cannot be studied; the text says why.
    """
    with _open_workers(options.num_processes) as run:
        return _run_study(options, run, on_step)


def _run_study(options: StudyOptions, run: _Workers, on_step: Callable[[], None]) -> StudyResult:
    board, folder = options.board, options.out
    file_camera = TwinCamera(options.camera_file, folder, "tripod").camera
    found = read_photographs(options.folder, board, (file_camera.width_px, file_camera.height_px))
    boards = found.with_boards
    corners = [one.corners_px for one in boards if one.corners_px is not None]
    if have_other_hand(file_camera, corners, board):
        raise CatoptraError(
            f"{options.folder}: the photographs are turned round left to right against "
            f"{options.camera_file}: their boards fit its mirrored picture; turn them back, or "
            "change Picture= and CentreU= of the camera"
        )
    calibration = calibrate(file_camera, corners, board)
    validated = cross_validate(file_camera, corners, board)
    on_step()
    twins = _Twins.make(options, run, file_camera, calibration, found, boards)
    start = twins.start_parameters()
    parameters, left = _fit(twins, start)
    on_step()
    has_mirror = twins.camera(parameters.focal_px).has_mirror
    variants = list_variants(parameters, has_mirror=has_mirror, effects=options.effects)
    each = twins.measure_all(variants, parameters.focal_px)
    on_step()
    samples = {"photographs": twins.photograph_samples(validated)}
    samples |= {name: _with_calibration(twins, each, name) for name in variants}
    clean = [one[CLEAN].corner_offset_px for one in each]
    return StudyResult(
        found,
        calibration,
        validated,
        np.concatenate([measure_straightness_px(calibration.camera, c, board) for c in corners]),
        np.concatenate([pose.incidence_rad for pose in calibration.poses]),
        math.sqrt(float(np.nanmean(np.square(clean)))),
        parameters,
        left,
        describe_camera(parameters, left, len(boards)),
        compare_pictures(samples),
        judge_transfer(samples),
        {name: one.rgb for name, one in each[0].items() if one.rgb is not None},
        samples,
    )


NUM_STEPS = 3


def list_variants(
    p: CameraParameters, *, has_mirror: bool, effects: Sequence[str] = EFFECTS
) -> dict[str, tuple[tuple[str, ...], int | None]]:
    """Lines of the camera's section, and quality of the coding, by the name of the effects."""
    lens, noise = p.lens_lines(), p.noise_lines()
    colour = (f"RedMagnification={p.red:.6f}", f"BlueMagnification={p.blue:.6f}")
    single: dict[str, tuple[str, ...]] = {
        "defocus": ("Defocus=always", "DefocusByDepth=always", *lens),
        "diffraction": ("Diffraction=always", *lens),
        "noise": ("ShotNoise=always", "ReadNoise=always", *noise),
        "mosaic": ("Bayer=always",),
        "vignetting": (_VIGNETTING,),
        "lateral colour": ("ChromaticAberration=always", *colour),
        "exposure": ("AutoExposure=always", f"AutoExposureTarget={p.mean_light:.5f}"),
        "glare": ("VeilingGlare=always",),
        "dust": ("MirrorDust=always", *lens),
        "holder": ("MirrorHolder=always", *lens),
    }
    chosen = ("defocus", "noise", "vignetting", "lateral colour")
    fitted = tuple(dict.fromkeys(line for name in chosen for line in single[name]))
    of_mirror = ("dust", "holder")
    single = {name: lines for name, lines in single.items()
              if name in effects and (has_mirror or name not in of_mirror)}  # fmt: skip
    # A key that two effects share is stated once.
    everything = tuple(dict.fromkeys(line for lines in single.values() for line in lines))
    plain: dict[str, tuple[tuple[str, ...], int | None]] = {CLEAN: ((), None)}
    plain |= {name: (lines, None) for name, lines in single.items()}
    if p.jpeg_quality is not None:
        plain["JPEG"] = ((), p.jpeg_quality)
    return plain | {ALL: (everything, p.jpeg_quality), FITTED: (fitted, p.jpeg_quality)}


@dataclass(frozen=True, slots=True, eq=False)
class _TwinSample:
    """One twin as measured."""

    sample: Sample
    corners_px: Floats | None
    corner_offset_px: float
    """Rms of found corners off their projections; NaN without corners."""
    rgb: Image | None
    """The picture, of the first photograph alone."""


_Workers = Callable[[Sequence["_Task"]], list[dict[str, _TwinSample]]]
"""Draws and measures the twins of tasks, in their order."""


@contextmanager
def _open_workers(count: int) -> Iterator[_Workers]:
    if count == 1:
        yield lambda tasks: [_measure_twins(task) for task in tasks]
        return
    # Spawned: a forked process would share the locks of a library's threads.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, mp_context=context) as pool:
        yield lambda tasks: list(pool.map(_measure_twins, tasks))


@dataclass(frozen=True, slots=True, eq=False)
class _Twins:
    """Photographs with boards, and the cameras and worlds of their twins."""

    options: StudyOptions
    run: _Workers
    calibration: Calibration
    quality: int | None
    photographs: tuple[Photograph, ...]
    measures: tuple[PictureMeasures, ...]
    cameras: Mapping[float, TwinCamera]
    """By focal length; one camera for all where the file's own is drawn."""

    @classmethod
    def make(
        cls,
        options: StudyOptions,
        run: _Workers,
        file_camera: OmniCamera,
        calibration: Calibration,
        found: PhotographSet,
        boards: Sequence[Photograph],
    ) -> _Twins:
        board, folder = options.board, options.out
        cameras: dict[float, TwinCamera] = {}
        is_mirror_as_lens = not file_camera.has_mirror and file_camera.picture is Picture.MIRRORED
        for focal_px in FOCAL_LENGTHS_PX if is_mirror_as_lens else (0.0,):
            path = options.camera_file
            if is_mirror_as_lens:
                path = folder / f"camera_{focal_px:.0f}px.ini"
                write_mirror_camera(path, calibration.camera, focal_px=focal_px, vertex_m=VERTEX_M)
            cameras[focal_px] = TwinCamera(path, folder, f"twin_{focal_px:.0f}px")
        measures = tuple(
            measure_picture(one.rgb, calibration.camera, pose.mirror_from_board, board)
            for one, pose in zip(boards, calibration.poses, strict=True)
        )
        return cls(options, run, calibration, found.jpeg_quality, tuple(boards), measures, cameras)

    def camera(self, focal_px: float) -> OmniCamera:
        """Camera model of a focal length."""
        return self._twin_camera(focal_px).camera

    def _twin_camera(self, focal_px: float) -> TwinCamera:
        return self.cameras.get(focal_px) or next(iter(self.cameras.values()))

    def start_parameters(self) -> CameraParameters:
        """Parameters that the photographs state without a fit."""
        colours = [
            measure_lateral_colour(one.rgb, one.corners_px, self.calibration.camera)
            for one in self.photographs
            if one.corners_px is not None
        ]
        red, blue = np.median(colours, axis=0)
        return CameraParameters(
            focal_px=next(iter(self.cameras)),
            red=float(np.clip(red, 0.95, 1.05)),
            blue=float(np.clip(blue, 0.95, 1.05)),
            mean_light=float(
                np.mean(
                    [linear_light(one.rgb.astype(np.float64)).mean() for one in self.photographs]
                )
            ),
            jpeg_quality=self.quality,
        )

    def photograph_samples(self, validated: Sequence[BoardPose]) -> list[Sample]:
        """What the photographs themselves give to the table."""
        return [
            Sample(measures, pose.mean_square_px, other.mean_square_px, _false_share(one.rgb,
                   self.calibration.camera))
            for one, measures, pose, other in zip(
                self.photographs, self.measures, self.calibration.poses, validated, strict=True
            )
        ]  # fmt: skip

    def measure_all(
        self,
        variants: Mapping[str, tuple[tuple[str, ...], int | None]],
        focal_px: float,
        chosen: Sequence[int] | None = None,
    ) -> list[dict[str, _TwinSample]]:
        """Draw and measure the twins of all photographs, or of chosen ones."""
        camera = self._twin_camera(focal_px)
        cameras = {name: camera.with_effects(lines) for name, (lines, _) in variants.items()}
        qualities = {name: quality for name, (_, quality) in variants.items()}
        shaded = frozenset(name for name, (lines, _) in variants.items() if _VIGNETTING in lines)
        tasks = [
            _Task(*self._scenes(number, camera.camera), shaded, number, cameras, qualities,
                  self.options)
            for number in (chosen if chosen is not None else range(len(self.photographs)))
        ]  # fmt: skip
        return self.run(tasks)

    def _scenes(self, number: int, camera: OmniCamera) -> tuple[TwinScene, TwinScene]:
        """Scene in the photograph's colours, and in those that vignetting makes of them."""
        photograph, measures = self.photographs[number], self.measures[number]
        assert photograph.corners_px is not None, "of photographs with boards"
        pose = find_pose(camera, photograph.corners_px, self.options.board).mirror_from_board

        def shade(radius: Floats) -> Floats:
            return camera.relative_illumination(np.minimum(radius, 1.0) * camera.rim_radius_px)

        plain, shaded = (
            TwinScene(photograph.name, pose, measures.colour(True, by), measures.colour(False, by),
                      measures.room(by), measures.black_parity)
            for by in (np.ones_like, shade)
        )  # fmt: skip
        return plain, shaded


def _fit(twins: _Twins, start: CameraParameters) -> tuple[CameraParameters, dict[float, float]]:
    """Parameters of the photographs' camera; a camera without a mirror keeps its lens."""
    count = len(twins.photographs)
    chosen = sorted({round(n) for n in np.linspace(0, count - 1, min(count, _NUM_FITTED))})

    def draw(p: CameraParameters) -> list[PictureMeasures]:
        has_mirror = twins.camera(p.focal_px).has_mirror
        variant = {FITTED: list_variants(p, has_mirror=has_mirror)[FITTED]}
        each = twins.measure_all(variant, p.focal_px, chosen)
        return [one[FITTED].sample.measures for one in each]

    base = twins.measure_all({CLEAN: ((), start.jpeg_quality)}, start.focal_px, chosen)
    cameras = {focal: one.camera for focal, one in twins.cameras.items() if one.camera.has_mirror}
    distances = [np.linalg.norm(pose.vector[3:]) for pose in twins.calibration.poses]
    return fit_camera(
        start,
        cameras,
        [twins.measures[number] for number in chosen],
        base=[one[CLEAN].sample.measures for one in base],
        draw=draw,
        range_m=float(np.median(distances)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """Twins of one photograph."""

    scene: TwinScene
    shaded_scene: TwinScene
    shaded: frozenset[str]
    """Names of twins with vignetting, which darkens its scene to the photograph's colours."""
    number: int
    cameras: Mapping[str, OmniCameraDescription]
    qualities: Mapping[str, int | None]
    options: StudyOptions


def _measure_twins(task: _Task) -> dict[str, _TwinSample]:
    board = task.options.board
    pictures: dict[str, Image] = {}
    # The plain scene's file last: it stays for a server.
    for scene, is_shaded in ((task.shaded_scene, True), (task.scene, False)):
        cameras = {n: one for n, one in task.cameras.items() if (n in task.shaded) is is_shaded}
        if cameras:
            world_file = task.options.out / f"{scene.name}.ini"
            write_world(world_file, scene, board)
            pictures |= draw_twins(world_file, cameras, exposure=task.number)
    found = {}
    for name in task.cameras:
        rgb = code_picture(pictures[name], task.qualities[name])
        found[name] = _measure_twin(rgb, task, task.cameras[name].camera)
    return found


def _measure_twin(rgb: Image, task: _Task, camera: OmniCamera) -> _TwinSample:
    board, pose = task.options.board, task.scene.mirror_from_board
    corners = find_corners(rgb, board)
    square = offset = math.nan
    if corners is not None:
        corners = order_corners(corners, camera, pose, board)
        points = pose.transform_points(board.points_m)
        off = corners - camera.pixel_from_direction(points)[0]
        offset = math.sqrt(float(np.square(off).sum(axis=1).mean()))
        square = find_pose(camera, corners, board).mean_square_px
    measures = measure_picture(rgb, camera, pose, board)
    sample = Sample(measures, square, math.nan, _false_share(rgb, camera))
    return _TwinSample(sample, corners, offset, rgb if task.number == 0 else None)


def _with_calibration(
    twins: _Twins, each: Sequence[Mapping[str, _TwinSample]], name: str
) -> list[Sample]:
    """Samples of one kind of twins, with the residuals of cameras calibrated by them."""
    kept = [number for number, one in enumerate(each) if one[name].corners_px is not None]
    samples = [one[name].sample for one in each]
    corners = [c for one in each if (c := one[name].corners_px) is not None]
    if len(kept) < 4:
        return samples
    poses = cross_validate(twins.calibration.camera, corners, twins.options.board)
    for number, pose in zip(kept, poses, strict=True):
        samples[number] = replace(samples[number], calibration_square_px=pose.mean_square_px)
    return samples


def _false_share(rgb: Image, camera: OmniCamera) -> float:
    """Share of the pixels in view that the landmark classifier takes for a landmark's colour."""
    codes = label_image(_landmark_classifier(), rgb)
    return float((codes[pixel_directions(camera)[1]] != 0).mean())


@lru_cache(maxsize=1)
def _landmark_classifier() -> ColourClassifier:
    """The classifier that the paper's experiment trains: Eq. 3 on clean frames of the field."""
    return train(_training_frames())


def _training_frames() -> Iterator[tuple[Image, Image]]:
    generator = np.random.Generator(np.random.Philox(key=0))
    poses = [
        PlanarPose(float(generator.uniform(-2.0, 2.0)), float(generator.uniform(-1.3, 1.3)),
                   float(generator.uniform(-math.pi, math.pi)))
        for _ in range(_NUM_TRAINING_FRAMES)
    ]  # fmt: skip
    with open_study_subject(
        find_configuration("robots", "p2at_omni"),
        find_configuration("worlds", "four_legged_2006"),
        size_px=_TRAINING_PX,
        poses=poses,
        kinds=FIGURE_RENDERERS,
    ) as subject:
        for pose, state in zip(poses, subject.camera_states, strict=True):
            height_m = -float(state.world_from_mirror.translation[2])
            place = world_from_mirror(
                Viewpoint(height_m), np.array((pose.x_m, pose.y_m, pose.yaw_rad))
            )
            with closing(
                subject.prepare_view(FIGURE_RENDERERS[0], RenderSettings(PerPixel(), 2))
            ) as view:
                frame = view.render(state).rgb.copy()
            yield (
                frame,
                label_frame(subject.camera, subject.world.landmarks, world_from_mirror=place),
            )
