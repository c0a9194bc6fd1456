"""Worlds and cameras of a recipe, loaded: the input of poses and of renderers, with a digest.

Each process loads all once. The digest covers all that samples follow from, so that a worker on
another machine, with copies of the files, can be compared with the driver.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from catoptra_protocol.errors import CatoptraError, ConfigError
from catoptra_protocol.names import list_names, suggest_name
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.commands.calibration import find_camera
from catoptra_server.config.camera_file import carry_camera, read_camera_file
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import report_unknown_names
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.datasets.randomise import draw_calibration
from catoptra_server.datasets.recipe import CameraChoice, Recipe, WorldChoice
from catoptra_server.datasets.worker_environment import WorkerRefusedError
from catoptra_server.frames.multi_view import Tile
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.costs import hash_scene
from catoptra_server.render.trace.occlusion import occlusion_cache
from catoptra_server.render.trace.ray_caster import SceneRayCaster, commit_to_kernel
from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.robot_bodies import build_ego_mesh
from catoptra_server.simulation.robot_description import OmniCameraDescription, RobotDescription
from catoptra_server.simulation.sensors.omni_camera import OmniCameraSensor
from catoptra_server.world.objects import ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import ROBOT_CLASS, MeshFile, World


class DatasetStage:
    """All worlds and cameras of a recipe; worlds are read at their first use."""

    def __init__(self, recipe: Recipe) -> None:
        """Read the cameras.

        Raises:
            ConfigError: A file is wrong.
            CatoptraError: Two cameras have one name, or a plan would depend on measured times.
        """
        self.recipe = recipe
        self._files: list[Path] = []
        self.cameras = tuple(self._read_cameras())
        names = [camera.name for camera in self.cameras]
        for camera in self.cameras:
            if names.count(camera.name) > 1:
                raise CatoptraError(f"{camera.choice.where}: a second camera {camera.name}")
        self.other_robots = tuple(self._read_other_robots())
        """Robots that drive beside the camera's, of one file the same object."""
        self._worlds: dict[str, RecipeWorld] = {}
        self._groups: set[str] = set()

    def world(self, number: int) -> RecipeWorld:
        """World by number in the recipe."""
        choice = self.recipe.worlds[number]
        if choice.name not in self._worlds:
            self._worlds[choice.name] = self._read_world(choice)
        return self._worlds[choice.name]

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that the samples follow from, whatever the paths of the files."""
        digest = hashlib.sha256(self.recipe.text.encode())
        worlds = [self.world(number) for number in range(len(self.recipe.worlds))]
        for name in self.recipe.group_brightness.keys() - self._groups:
            raise CatoptraError(
                f"{self.recipe.path}: [Catoptra.Lights] Groups: no world has lights of Group={name}"
            )
        self._check_classes([world.scene for world in worlds])
        # Sorted: in whatever order worlds were loaded.
        for file_hash in sorted(hashlib.sha256(path.read_bytes()).digest() for path in self._files):
            digest.update(file_hash)
        # Meshes and textures as read, and calibrated cameras as understood.
        for world in worlds:
            for scene_hash in (hash_scene(world.scene), occlusion_cache.hash_scene(world.scene)):
                digest.update(scene_hash.encode())
            if world.world.sky is not None:
                digest.update(world.world.sky.texels.tobytes())
        with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
            for camera in self.cameras:
                digest.update(f"{camera.name} {camera.spec!r}".encode())
        return digest.hexdigest()

    def require_digest(self, expected: str) -> None:
        """Check that this process has read what a driver has read.

        Raises:
            WorkerRefusedError: A file differs, or cannot be read here.
        """
        try:
            digest = self.digest
        except (ConfigError, OSError) as error:
            raise WorkerRefusedError(
                f"a file of the recipe cannot be read here: {error}"
            ) from error
        if digest != expected:
            raise WorkerRefusedError(
                "recipe, worlds, robots or cameras differ from those of the driver"
            )

    def _read_other_robots(self) -> Iterator[RobotDescription]:
        varied = self.recipe.randomisation
        if varied is None:
            return
        self._files += [one for one in varied.textures if isinstance(one, Path)]
        read: dict[Path, RobotDescription] = {}
        for path in varied.robots:
            if path not in read:
                read[path], file = read_robot(path)
                report_unknown_names(file.unknown_names())
                self._note_files(file)
            yield read[path]

    def _check_classes(self, scenes: list[SceneMesh]) -> None:
        """Check that classes which the recipe names exist, and that all have the numbers it fixes.

        Raises:
            CatoptraError: A class of no world, or one without a number.
        """
        numbers, varied = self.recipe.class_numbers, self.recipe.randomisation
        classes = {one.class_name for scene in scenes for one in scene.objects} | {ROBOT_CLASS}
        kept = () if varied is None else varied.kept_classes
        for name in kept:
            if varied is not None and name not in classes:
                known = list_names(name, sorted(classes))
                raise CatoptraError(f"{varied.where}: Keep: {name} is no class of a world: {known}")
        classes |= {*varied.classes} if varied else set()
        if numbers is not None and (missing := sorted(classes - numbers.keys())):
            spare = sorted(numbers.keys() - classes)
            close = suggest_name(missing[0], spare)
            raise CatoptraError(
                f"{self.recipe.path}: [Catoptra.Classes]: no number for {', '.join(missing)}"
                + (f"; is {close} meant to be {missing[0]}?" if close else "")
            )

    def _read_cameras(self) -> Iterator[RecipeCamera]:
        for choice in self.recipe.cameras:
            robot, base, name = self._read_robot(choice)
            try:
                omni = find_camera(robot, choice.camera)
            except CatoptraError as error:
                raise CatoptraError(f"{choice.where}: Cameras: {error}") from error
            if omni.render_settings.accuracy_target.is_set:
                raise CatoptraError(
                    f"{choice.where}: Cameras: {omni.name} has an accuracy target, whose plan "
                    "follows measured times: state Samples in its file instead"
                )
            sensor = OmniCameraSensor(omni, robot)
            camera = RecipeCamera(
                choice=choice,
                name=name or f"{choice.robot_file.stem}.{omni.name}",
                robot=robot,
                omni=omni,
                sensor=sensor,
                spec=sensor.camera_spec(Tile(0, 0, *choice.size_px) if choice.size_px else None),
                ego_mesh=build_ego_mesh(base),
                calibration=self._find_calibration(choice, omni),
            )
            yield camera

    def _find_calibration(self, choice: CameraChoice, omni: OmniCameraDescription) -> Path | None:
        """Calibration file that cameras are drawn from; None where none is drawn.

        Raises:
            ConfigError: It states no covariance.
        """
        varied = self.recipe.randomisation
        if varied is None or not varied.calibration:
            return None
        file = IniFile(choice.model_file or choice.robot_file)
        for section in file.sections():
            if section.has_key("CalibrationFile"):
                path = section.get_path("CalibrationFile", file.path.parent)
                draw_calibration(self.recipe, 0, omni.camera, path)
                return path
        raise CatoptraError(
            f"{varied.where}: Calibration: {omni.name} of {choice.where} has no CalibrationFile "
            "with a catoptra_covariance"
        )

    def _read_robot(self, choice: CameraChoice) -> tuple[RobotDescription, RobotDescription, str]:
        """Robot of a choice, the one of its file, and the name that a camera file has."""
        robot, file = read_robot(choice.robot_file)
        report_unknown_names(file.unknown_names())
        self._note_files(file)
        if choice.model_file is None:
            return robot, robot, ""
        camera_file = read_camera_file(choice.model_file)
        self._note_files(IniFile(choice.model_file))
        with tempfile.TemporaryDirectory(prefix="catoptra-") as folder:
            path = Path(folder, "robot.ini")
            base_file = str(choice.robot_file)
            carry_camera(camera_file, path, base_robot=base_file, shows_robot=True)
            return read_robot(path)[0], robot, camera_file.name

    def _read_world(self, choice: WorldChoice) -> RecipeWorld:
        world, file = read_world(choice.file)
        report_unknown_names(file.unknown_names())
        self._note_files(file)
        # For the names of nodes, which are labels; geometry and looks count as read.
        meshes = {one.shape.path for one in world.items if isinstance(one.shape, MeshFile)}
        self._files += sorted(meshes - {*self._files})
        self._groups |= {*world.light_groups}
        scene = build_scene(world, MemoryBudget())
        lit = occlusion_cache.light_scene(scene, world)
        caster = commit_to_kernel(lit.scene)
        index = CollisionIndex(lit.scene, caster)
        return RecipeWorld(choice, lit.world, lit.scene, caster, index, lit.mix)

    def _note_files(self, file: IniFile) -> None:
        self._files += [path for path in file.paths if path not in self._files]


@dataclass(frozen=True, slots=True, eq=False)
class RecipeWorld:
    """A world, loaded."""

    choice: WorldChoice
    world: World
    scene: SceneMesh
    caster: SceneRayCaster
    ground: CollisionIndex
    """What robots stand on."""
    mix: Callable[[Mapping[str, float]], tuple[SceneMesh, World]] | None
    """As of `occlusion_cache.LitWorld`."""

    @property
    def name(self) -> str:
        """Name in samples."""
        return self.choice.name


@dataclass(frozen=True, slots=True, eq=False)
class RecipeCamera:
    """A camera on a robot."""

    choice: CameraChoice
    name: str
    """Name in samples: of the camera file, or of robot file and camera."""
    robot: RobotDescription
    omni: OmniCameraDescription
    sensor: OmniCameraSensor
    spec: OmniCameraSpec
    """Camera at the size of the images, with the camera's own effects."""
    ego_mesh: ObjectMesh | None
    """The robot itself, where the camera's effects may show it."""
    calibration: Path | None
    """File with a covariance that each sample's camera is drawn from; None: all have the same."""

    def fit(self, camera: OmniCamera) -> OmniCamera:
        """Another calibration of the camera at the size of the images."""
        sensor = OmniCameraSensor(replace(self.omni, camera=camera), self.robot)
        return sensor.camera_for_tile(Tile(0, 0, *size) if (size := self.choice.size_px) else None)
