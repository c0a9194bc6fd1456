"""One sample of a data set: described by recipe and index alone, and rendered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy.typing as npt

from catoptra_protocol.labels.channels import LabelledObject
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.dataset_stage import DatasetStage, RecipeCamera
from catoptra_server.datasets.effect_ranges import draw_effects
from catoptra_server.datasets.pose_sources import PoseSource, RobotMotion, seed_noise
from catoptra_server.datasets.sampling import (
    SamplePlace,
    draw_brightness,
    find_place,
    random_source,
)
from catoptra_server.frames.image_port import mounted_camera_state
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.render.renderer import Image
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.objects import DynamicObject


@dataclass(frozen=True, slots=True, eq=False)
class SampleDescription:
    """All that a sample's picture and labels follow from."""

    place: SamplePlace
    key: str
    """Name in files."""
    camera: RecipeCamera
    spec: OmniCameraSpec
    """Camera with the effects of this sample."""
    state: CameraState
    next_state: CameraState | None
    """Camera at the next sample of the sequence, for the flow; None without one."""
    motion: RobotMotion
    brightness: float
    """Factor of all lights."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderedSample:
    """A sample as it is stored."""

    key: str
    rgb: Image
    """(h, w, 3) uint8."""
    channels: Mapping[str, npt.NDArray[Any]]
    """Channels of ground truth by name, as in `labels/channels`."""
    metadata: Mapping[str, Any]
    """Content of the sample's JSON file: numbers, texts, lists and maps."""
    objects: tuple[LabelledObject, ...] = ()
    """Objects of the world, where channels were asked for."""


class SampleDescriber:
    """Descriptions of the samples of a recipe, for one process."""

    def __init__(self, stage: DatasetStage) -> None:
        self._stage = stage
        self._poses = PoseSource(stage)

    def describe_sample(self, index: int) -> SampleDescription:
        """Description of a sample.

        Raises:
            CatoptraError: There is no free space for a random pose, or drawn parameters of effects
                cannot be drawn together.
        """
        recipe = self._stage.recipe
        place = find_place(recipe, index)
        camera = self._stage.cameras[place.camera]
        motion = self._poses.find_motion(place)
        optics = camera.spec.camera
        effects = draw_effects(
            recipe.effects,
            camera.spec.effect_settings,
            random_source(recipe, "effects").generator(index),
            has_mirror=optics.has_mirror,
            has_viewpoint=not optics.has_mirror or optics.mirror.is_central,
        )
        return SampleDescription(
            place=place,
            key=recipe.sample_key(index),
            camera=camera,
            spec=replace(camera.spec, effect_settings=effects),
            state=self._camera_state(camera, motion.now, place),
            next_state=self._camera_state(camera, motion.next, place) if motion.next else None,
            motion=motion.now,
            brightness=draw_brightness(recipe, index),
        )

    def _camera_state(
        self, camera: RecipeCamera, motion: RobotMotion, place: SamplePlace
    ) -> CameraState:
        ego_body = None
        if camera.ego_mesh is not None:
            ego_body = DynamicObject(
                camera.ego_mesh,
                motion.world_from_robot,
                motion.twist,
                name=camera.robot.model_name,
                number=1,
            )
        return mounted_camera_state(
            motion.world_from_robot,
            camera.sensor.robot_from_camera({}),
            twist=motion.twist,
            ego_body=ego_body,
            noise_seed=seed_noise(self._stage, place),
        )
