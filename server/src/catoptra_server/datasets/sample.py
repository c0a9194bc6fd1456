"""One sample of a data set: described by recipe and index alone, annotated, and encoded to files.

**Sample i follows from the recipe and i.** Random numbers are counted, keyed by seed, purpose and
index; plans follow settings; no library has a last bit in a sample (`optics/elementary.py`). What
depends on order or machine (threads, measured costs, encoders) is fixed or refused.

Ids and classes are never interpolated or compressed with loss: small integers are PNG, all else has
NumPy's format. Normals are halved to float16: their angle stays within 0.03 degrees.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.camera_conf import pairs_from_omni_camera
from catoptra_protocol.labels import GroundTruth, LabelledObject
from catoptra_protocol.labels.annotations import annotate_objects
from catoptra_protocol.labels.spherical_box import PixelSphere
from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.shards import CHANNEL_FILES, METADATA, PICTURE, compress_arrays
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.dataset_stage import DatasetStage, RecipeCamera, RecipeWorld
from catoptra_server.datasets.png_files import encode_png
from catoptra_server.datasets.poses import (
    PoseSource,
    RobotMotion,
    SamplePlace,
    Surroundings,
    draw_brightness,
    draw_group_brightness,
    find_place,
    seed_noise,
)
from catoptra_server.datasets.randomise import (
    draw_calibration,
    draw_lights,
    draw_mount,
    random_source,
)
from catoptra_server.datasets.recipe import FORMATS, Recipe, draw_effects
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.image_port import mounted_camera_state
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.views import RenderedView
from catoptra_server.render.renderer import Image
from catoptra_server.simulation.sensors import SensorEnvironment
from catoptra_server.simulation.sight import compute_landmark_visibility
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.world_description import DirectionalLight, PointLight

NEEDED_CHANNELS = frozenset({"ids", "valid"})
"""Channels that annotations are made of, stored by the recipe or not."""
# Directions of a camera of 640 px are 39 MB, and take 0.2 s.
_MAX_SPHERE_BYTES = 512 * 2**20
# Types in files that differ from the channel's.
_STORED_DTYPES = {"normal": np.dtype("<f2")}


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
    group_brightness: Mapping[str, float]
    """Factors of groups of lights by name, beside that of all."""
    robot_from_camera: Pose
    sun: DirectionalLight | None
    """In place of the world's directional lights; None: those."""
    lamps: tuple[PointLight, ...]
    """Beside the world's."""
    imu: Floats | None
    """As of `poses.py:measure_motion`, from this sample to the next; None without."""


class SampleDescriber:
    """Descriptions of the samples of a recipe, for one process."""

    def __init__(self, stage: DatasetStage) -> None:
        self._stage = stage
        self._poses = PoseSource(stage)
        self._surroundings = Surroundings(stage, self._poses)

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
        if camera.calibration is not None:
            drawn = draw_calibration(recipe, index, camera.omni.camera, camera.calibration)
            optics = camera.fit(drawn)
        own_mount = camera.sensor.robot_from_camera({})
        mount = draw_mount(recipe, index, own_mount)
        state = self._camera_state(camera, motion.now, place, mount)
        # Of the mount as described: another mount moves no lamp.
        viewpoint = motion.now.world_from_robot.transform_points(own_mount.translation)
        caster = self._stage.world(place.world).caster
        floor_z_m = float(viewpoint[2]) + camera.robot.viewpoint_height_m(camera.omni)
        sun, lamps = draw_lights(recipe, index, viewpoint, floor_z_m, caster)
        next_state = None
        if motion.next is not None:
            next_state = self._camera_state(camera, motion.next, place, mount, after=1)
        effects = draw_effects(
            recipe.effects,
            camera.spec.effect_settings,
            random_source(recipe, "effects").generator(index),
            has_mirror=optics.has_mirror,
            has_viewpoint=optics.is_central,
        )
        return SampleDescription(
            place=place,
            key=recipe.sample_key(index),
            camera=camera,
            spec=replace(camera.spec, camera=optics, effect_settings=effects),
            state=state,
            next_state=next_state,
            motion=motion.now,
            brightness=draw_brightness(recipe, index),
            group_brightness=draw_group_brightness(recipe, index),
            robot_from_camera=mount,
            sun=sun,
            lamps=lamps,
            imu=motion.imu,
        )

    def _camera_state(
        self,
        camera: RecipeCamera,
        motion: RobotMotion,
        place: SamplePlace,
        robot_from_camera: Pose,
        *,
        after: int = 0,
    ) -> CameraState:
        body: tuple[DynamicObject, ...] = ()
        is_left_out = dict(self._stage.recipe.effects.modes).get("SelfView") == "never"
        if camera.ego_mesh is not None and not is_left_out:
            name, pose = camera.robot.model_name, motion.world_from_robot
            body = (DynamicObject(camera.ego_mesh, pose, motion.twist, name=name, number=1),)
        # A lens has no effect that adds the body: one that a robot carries in place of its mirror
        # shows it like any object.
        is_object = camera.choice.model_file is not None and not camera.spec.camera.has_mirror
        return mounted_camera_state(
            motion.world_from_robot,
            robot_from_camera,
            twist=motion.twist,
            objects=(
                *self._surroundings.find_objects(place, after),
                *(body if is_object else ()),
            ),
            ego_body=body[0] if body and not is_object else None,
            noise_seed=seed_noise(self._stage, place),
        )


@dataclass(frozen=True, slots=True, eq=False)
class RenderedSample:
    """A sample as stored."""

    key: str
    rgb: Image
    """(h, w, 3) uint8."""
    channels: Mapping[str, npt.NDArray[Any]]
    """Channels of ground truth by name, as in `labels/__init__.py`."""
    metadata: Mapping[str, Any]
    """Content of the sample's JSON file: numbers, texts, lists and maps."""
    objects: tuple[LabelledObject, ...] = ()
    """Objects of the world, where channels were asked for."""


class SampleAnnotator:
    """Annotations by the cameras of a recipe, whose directions are computed once."""

    def __init__(self) -> None:
        # By camera and mount, the last used at the end.
        self._spheres: dict[tuple[Any, ...], PixelSphere] = {}

    def annotate(
        self,
        description: SampleDescription,
        image: LabelledImage,
        truth: GroundTruth,
        labels: LabelRenderer,
    ) -> list[dict[str, Any]]:
        """Records of all objects in view, by ascending number.

        Args:
            description: The sample.
            image: The labelled image.
            truth: Ground truth with NEEDED_CHANNELS.
            labels: Renderer of that ground truth.
        """
        annotations = annotate_objects(
            truth,
            description.spec.camera,
            image.camera_state.world_from_mirror,
            self._find_sphere(description),
            labels.measure_occlusion(image, truth),
        )
        return [annotation.to_json() for annotation in annotations]

    def _find_sphere(self, description: SampleDescription) -> PixelSphere:
        # Up is the robot's, also on a slope: computed once for a camera as it is mounted.
        turn = description.robot_from_camera.rotation
        key = (description.spec.camera, turn.tobytes())
        sphere = self._spheres.pop(key, None) or PixelSphere(description.spec.camera, turn)
        self._spheres[key] = sphere
        while len(self._spheres) > 1 and self._num_bytes > _MAX_SPHERE_BYTES:
            self._spheres.pop(next(iter(self._spheres)))
        return sphere

    @property
    def _num_bytes(self) -> int:
        return sum(sphere.directions.nbytes for sphere in self._spheres.values())


def wants_annotations(recipe: Recipe) -> bool:
    """Whether a recipe's samples have annotations: with the channel ids, or for a format."""
    return "ids" in recipe.channels or any(FORMATS[name] for name in recipe.formats)


def describe_sample_metadata(
    description: SampleDescription, view: RenderedView, world: RecipeWorld
) -> dict[str, Any]:
    """Content of a sample's JSON file, without the objects that labels add.

    Args:
        description: The sample.
        view: The picture as drawn.
        world: The world of the sample.
    """
    place, camera, state = description.place, description.camera, description.state
    optics = description.spec.camera
    height_m = camera.robot.viewpoint_height_m(camera.omni)
    twist = description.motion.twist
    return {
        "key": description.key,
        "index": place.index,
        "sequence": place.sequence,
        "step": place.step,
        "time_s": description.motion.time_s,
        "world": world.name,
        "camera": camera.name,
        "robot": camera.robot.class_name,
        "size_px": [optics.width_px, optics.height_px],
        "camera_model": [list(p) for p in pairs_from_omni_camera(optics, height_m)],
        "world_from_camera": _describe_pose(state.world_from_mirror),
        "world_from_robot": _describe_pose(description.motion.world_from_robot),
        "linear_m_s": [float(one) for one in twist.linear_m_s],
        "angular_rad_s": [float(one) for one in twist.angular_rad_s],
        **({} if description.imu is None else {"imu": description.imu.tolist()}),
        "brightness": description.brightness,
        **({"groups": {**groups}} if (groups := description.group_brightness) else {}),
        **_describe_lights(description),
        "noise_seed": [*state.noise_seed.camera_key, state.noise_seed.tick],
        "plan": view.frame_plan.plan_text,
        "error_bound_px": {k: _finite(v) for k, v in (view.frame_plan.bounds or {}).items()},
        "landmarks": _describe_landmarks(description, world),
        "effects": [_describe_decision(one) for one in view.effect_decisions],
    }


def _describe_lights(description: SampleDescription) -> dict[str, Any]:
    """Sun and lamps of the sample alone: irradiance and way, place and irradiance at 1 m."""
    sun, lamps = description.sun, description.lamps
    found: dict[str, Any] = {}
    if sun is not None:
        found["sun"] = {"direction": [*sun.direction], "irradiance": [*sun.irradiance]}
    if lamps:
        found["lamps"] = [
            {"position_m": [*one.position_m], "intensity": [*one.intensity]} for one in lamps
        ]
    return found


def _describe_pose(pose: Pose) -> dict[str, list[float]]:
    """Position in metres, and unit quaternion x, y, z, w, of a frame in the world (SAE)."""
    return {
        "position_m": [float(one) for one in pose.translation],
        "quaternion_xyzw": [float(one) for one in pose.quaternion],
    }


def _describe_landmarks(description: SampleDescription, world: RecipeWorld) -> list[dict[str, Any]]:
    """Name, pixel (None outside the image), visibility and distance of each landmark's band."""
    world_from_camera = description.state.world_from_mirror
    found = compute_landmark_visibility(
        description.spec, world_from_camera, world.world.landmarks, SensorEnvironment(world.caster)
    )
    x_m, y_m, z_m = world_from_camera.translation.tolist()
    return [
        {
            "name": one.landmark.name,
            "pixel": None if one.pixel is None else [*one.pixel],
            "visible": one.is_visible,
            "distance_m": hypot(
                x_m - one.landmark.x_m, y_m - one.landmark.y_m, z_m + one.landmark.band_centre_m
            ),
        }
        for one in found
    ]


def _describe_decision(decision: EffectDecision) -> dict[str, Any]:
    return {
        "effect": decision.effect,
        "enabled": decision.enabled,
        "bound": _finite(decision.bound),
        "threshold": _finite(decision.threshold),
        "displacement_px": _finite(decision.displacement_px),
        "change": _finite(decision.change),
        "share_threshold": decision.share_threshold,
        "visible_share": decision.visible_share,
        "reason": decision.reason,
    }


def _finite(value: float | None) -> float | None:
    """The number; None, which JSON has a text for, for any that is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def encode_sample(sample: RenderedSample, compression: str = "none") -> dict[str, bytes]:
    """Content of a sample's files by suffix, sorted: the same bytes for the same sample.

    Args:
        sample: The sample.
        compression: Of COMPRESSIONS.
    """
    files = {PICTURE: encode_png(sample.rgb), METADATA: _encode_json(sample.metadata)}
    for name, array in sample.channels.items():
        files[CHANNEL_FILES[name]] = _encode_channel(name, array)
    return dict(sorted((files if compression == "none" else compress_arrays(files)).items()))


def _encode_channel(name: str, array: npt.NDArray[Any]) -> bytes:
    if CHANNEL_FILES[name].endswith(".png"):
        return encode_png(array)
    stored = np.ascontiguousarray(array, dtype=_STORED_DTYPES.get(name, array.dtype))
    file = io.BytesIO()
    # Version 1.0 of the format: a header of text, then the values as in memory.
    np.lib.format.write_array(file, stored, version=(1, 0), allow_pickle=False)
    return file.getvalue()


def _encode_json(content: Any) -> bytes:
    """JSON with sorted keys and without spaces; floats as the shortest text that reads back.

    Raises:
        ValueError: A number is not finite, which JSON has no text for.
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text.encode()
