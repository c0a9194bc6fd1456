"""Annotations of a sample's objects: masks, boxes, cones and occluded fractions as JSON."""

from __future__ import annotations

from typing import Any

from catoptra_protocol.labels.annotations import annotate_objects
from catoptra_protocol.labels.channels import GroundTruth
from catoptra_protocol.labels.spherical_box import PixelSphere
from catoptra_server.datasets.recipe import Recipe
from catoptra_server.datasets.sample import SampleDescription
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.frames.labels.labels import DrawnExposure

NEEDED_CHANNELS = frozenset({"ids", "valid"})
"""Channels that annotations are made of, whether the recipe stores them or not."""

# Directions of a camera of 640 px are 39 MB, and take 0.2 s.
_MAX_SPHERE_BYTES = 512 * 2**20


def wants_annotations(recipe: Recipe) -> bool:
    """Whether a recipe's samples have annotations: with the channel ids, or for a COCO file."""
    return "ids" in recipe.channels or "coco" in recipe.formats


class SampleAnnotator:
    """Annotations by the cameras of a recipe, whose directions are computed once."""

    def __init__(self) -> None:
        self._spheres: dict[int, PixelSphere] = {}  # by camera, the last used at the end

    def annotate(
        self,
        description: SampleDescription,
        drawn: DrawnExposure,
        truth: GroundTruth,
        labels: LabelRenderer,
    ) -> list[dict[str, Any]]:
        """Records of all objects in view, by ascending number.

        Args:
            description: The sample.
            drawn: Its exposure.
            truth: Ground truth with NEEDED_CHANNELS.
            labels: Renderer of that ground truth.
        """
        annotations = annotate_objects(
            truth,
            description.spec.camera,
            drawn.camera_state.world_from_mirror,
            self._find_sphere(description),
            labels.measure_occlusion(drawn, truth),
        )
        return [annotation.to_json() for annotation in annotations]

    def _find_sphere(self, description: SampleDescription) -> PixelSphere:
        number = description.place.camera
        sphere = self._spheres.pop(number, None)
        if sphere is None:
            # Up is the robot's: a camera's mount, with the robot level.
            mount = description.camera.sensor.robot_from_camera({})
            sphere = PixelSphere(description.spec.camera, mount.rotation)
        self._spheres[number] = sphere
        while len(self._spheres) > 1 and self._num_bytes > _MAX_SPHERE_BYTES:
            self._spheres.pop(next(iter(self._spheres)))
        return sphere

    @property
    def _num_bytes(self) -> int:
        return sum(sphere.directions.nbytes for sphere in self._spheres.values())
