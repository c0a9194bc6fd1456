"""Entry of the table of figures, and figures.json, the index of a folder of drawn figures.

figures.json holds `figures`, a list of file, paper_reference, title, caption and alt; and
`metrics`, by file name without suffix: every number in a caption, so that no reader parses prose;
and `timings` in the same form, which differ from run to run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.simulation.robot_description import DriveBase, PlanarPose
from catoptra_studies.commands import ProgressDisplay
from catoptra_studies.plot_style import Page, open_page
from catoptra_studies.reports import write_json
from catoptra_studies.study_subject import (
    FIGURE_RENDERERS,
    StudySubject,
    first_start_pose,
    open_study_subject,
    study_poses,
)

Metrics = dict[str, float]

# Along a pixel's side. With fewer a thin line is broken by aliasing, which is no fault of a mesh.
FIGURE_SAMPLES = 4


@dataclass(frozen=True, slots=True)
class FigureInputs:
    """Subjects that a figure may render."""

    subject: StudySubject
    """The camera in the world to show."""

    rings: StudySubject
    """The same camera among circles of equal incidence angle."""

    rooms: StudySubject
    """The same camera in the second map of Figure 10."""

    drive: DriveBase
    """Drive of the robot, which carries the scanner of Figure 10."""

    num_timed_frames: int
    """Frames of each payload that Figure 10 times."""


@dataclass(frozen=True, slots=True)
class FigureCaption:
    """Texts and numbers of a drawn figure."""

    title: str
    caption: str

    alt: str
    """Description for readers who cannot see the figure."""

    metrics: Metrics
    """Every number in the caption, by name."""

    timings: Metrics = field(default_factory=dict)
    """Measured times by name: of this machine, and others in every run."""


@dataclass(frozen=True, slots=True)
class FigureSpec:
    """One entry of the table of figures."""

    file: str

    paper_reference: str
    """Figure, equation or section of the paper that this one reproduces."""

    width_px: int
    height_px: int

    draw: Callable[[Page, FigureInputs], FigureCaption]


@contextmanager
def open_figure_inputs(
    robot_file: Path,
    world_file: Path,
    rings_file: Path,
    rooms_file: Path,
    *,
    pose: PlanarPose | None = None,
    resolution_scale: float = 1.0,
    num_timed_frames: int = 15,
) -> Iterator[FigureInputs]:
    """Read the files and start the renderers of all subjects.

    Args:
        robot_file: Robot with an omnidirectional camera.
        world_file: World to show.
        rings_file: World with circles of equal incidence angle around the first start.
        rooms_file: Second map of Figure 10.
        pose: Pose of the robot in the world; None stands near the world's first start.
        resolution_scale: Factor on the sizes of all frames but the rings', which are measured.
        num_timed_frames: Frames of each payload that Figure 10 times.

    Raises:
        ConfigError: A file cannot be read.
        CatoptraError: The robot has no omnidirectional camera.
    """
    # The first pose of the cost study, so that figures and COST.md show the same view.
    poses = (pose or study_poses(read_world(world_file)[0])[0],)
    # The circles are concentric about the first start, so the camera must be exactly there.
    centre = (first_start_pose(read_world(rings_file)[0]),)
    with (
        open_study_subject(
            robot_file, world_file, poses=poses, kinds=FIGURE_RENDERERS,
            resolution_scale=resolution_scale,
        ) as subject,
        open_study_subject(
            robot_file, rings_file, poses=centre, kinds=FIGURE_RENDERERS
        ) as rings,
        open_study_subject(
            robot_file, rooms_file, num_poses=len(poses), kinds=FIGURE_RENDERERS
        ) as rooms,
    ):  # fmt: skip
        drive = read_robot(robot_file)[0].drive
        yield FigureInputs(subject, rings, rooms, drive, num_timed_frames)


def write_figures(
    figures: Sequence[FigureSpec], inputs: FigureInputs, folder: Path, progress: ProgressDisplay
) -> None:
    """Draw figures into a folder, made where missing, and then write figures.json.

    The experiment waits for that file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    advance = progress.add_task("figures of the camera", len(figures))
    entries, metrics, timings = [], {}, {}
    for figure in figures:
        with open_page(folder / figure.file, figure.height_px, figure.width_px) as page:
            caption = figure.draw(page, inputs)
        entries.append(
            {
                "file": figure.file,
                "paper_reference": figure.paper_reference,
                "title": caption.title,
                "caption": caption.caption,
                "alt": caption.alt,
            }
        )
        metrics[Path(figure.file).stem] = caption.metrics
        if caption.timings:
            timings[Path(figure.file).stem] = caption.timings
        advance()
    index = {"figures": entries, "metrics": metrics, "timings": timings}
    write_json(folder / "figures.json", index, ensure_ascii=False)
