"""Camera files, configs/cameras/*.ini, and the robots that carry their cameras.

A camera file has the sections of a lens or a mirror, as in a robot file, and a section
[Camera]: `ItemClass` is the class of the lens's or mirror's section, `Title`, `Source` and
`Licence` are texts. Another camera is another file.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import bundled_files, find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.simulation.robot_description import OmniCameraDescription

# The robot of the paper's simulated drive.
_BASE_ROBOT = "p2at_omni_sim"
# Section of the capture camera of a robot with a mirror.
_CAPTURE_CLASS = "Catoptra.OmniCaptureCamera"


@dataclass(frozen=True, slots=True)
class CameraFile:
    """One camera file."""

    path: Path

    item_class: str
    """Class of the section with the lens or the mirror."""

    title: str
    source: str
    """Where the model or its calibration is from."""

    licence: str
    is_lens: bool

    keeps_size: bool
    """Whether the parameters are in pixels of the file's own image, as those of calibrations."""

    @property
    def name(self) -> str:
        """Name of the file without suffix."""
        return self.path.stem


def read_camera_file(path: Path) -> CameraFile:
    """Read the section [Camera] of a camera file.

    Raises:
        ConfigError: The file cannot be read, or a key is missing.
    """
    file = IniFile(path)
    camera = file.get_section("Camera")
    item_class = camera.get_str("ItemClass")
    item = file.get_section(item_class)
    return CameraFile(
        path=path,
        item_class=item_class,
        title=camera.get_str("Title"),
        source=camera.get_str("Source"),
        licence=camera.get_str("Licence"),
        is_lens=item.has_key("Lens") or item.has_key("CalibrationFile"),
        keeps_size=item.has_key("FocalLength") or item.has_key("CalibrationFile"),
    )


def read_camera_files(names: Sequence[str]) -> tuple[CameraFile, ...]:
    """Camera files by their paths or bundled names; all bundled ones for no name.

    Raises:
        ConfigError: There is no such file, or no camera in the file.
        CatoptraError: Two cameras have one name: results are distinguished by name.
    """
    paths = [find_configuration("cameras", name) for name in names] or bundled_files("cameras")
    files = tuple(read_camera_file(path) for path in paths)
    if len({file.name for file in files}) < len(files):
        raise CatoptraError("two cameras have one name: " + ", ".join(f.name for f in files))
    return files


def carry_camera(
    camera: CameraFile,
    path: Path,
    *,
    size_px: int | None = None,
    base_robot: str = _BASE_ROBOT,
    shows_robot: bool = False,
) -> OmniCameraDescription:
    """Write a robot file in which a robot carries the camera in place of the mirror.

    A lens hangs where the mirror's viewpoint was and looks down.

    Args:
        camera: Camera to carry.
        path: Robot file to write.
        size_px: Width and height of the image; None, and cameras whose parameters are in pixels,
            keep the size of the camera file.
        base_robot: Robot with the paper's camera elements: a path or a bundled name.
        shows_robot: Whether a mirror shows the robot itself as the base robot's does; no mirror
            does otherwise, so that cameras are compared by what their optics show.

    Returns:
        The camera as a server reads the file.

    Raises:
        ConfigError: One of the files is wrong.
        CatoptraError: The base robot has no mirror.
    """
    base_file = find_configuration("robots", base_robot)
    robot = read_robot(base_file)[0]
    base = robot.omni_camera
    if base is None or not base.camera.has_mirror:
        raise CatoptraError(f"{base_file}: {robot.class_name} has no mirror to replace")
    lines = [
        "[Configuration]",
        f"BasedOn={base_file.resolve()}",
        f"BasedOn={camera.path.resolve()}",
        f"[{robot.class_name}]",
        *(_lens_items(camera, base) if camera.is_lens else _mirror_items(camera)),
        f"[{camera.item_class if camera.is_lens else _CAPTURE_CLASS}]",
        *([] if camera.is_lens or shows_robot else ["SelfView=never"]),
    ]
    if size_px is not None and not camera.keeps_size:
        lines += [f"ResolutionX={size_px}", f"ResolutionY={size_px}"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    description = read_robot(path)[0].omni_camera
    assert description is not None, "the items above are an omnidirectional camera"
    return description


def _lens_items(camera: CameraFile, base: OmniCameraDescription) -> list[str]:
    x_m, y_m, z_m = base.robot_from_mirror.translation
    # Pitched by -90 degrees: the lens looks down, with forward at the top of the image.
    return [
        "!StaticMeshes=",
        "!CamTexActors=",
        f"Cameras=(ItemClass=class'{camera.item_class}',ItemName=\"{base.name}\","
        f"Position=(X={x_m:.6f},Y={y_m:.6f},Z={z_m:.6f}),Direction=(X=0,Y=-1.5707963267948966,Z=0))",
    ]


def _mirror_items(camera: CameraFile) -> list[str]:
    # Viewpoint and capture camera stay as on the base robot.
    return [
        f"StaticMeshes=(ItemClass=class'{camera.item_class}',ItemName=\"OmniMirror\","
        'Parent="OmniCam",Position=(X=0,Y=0,Z=0),Direction=(X=0,Y=0,Z=0))'
    ]
