"""Annotations of the objects in an image: one record per object, as arrays and as JSON.

A record has the corners of the object's box in the image, by the camera model, each with its
validity. Masks and boxes on the sphere come from `masks` and `spherical_box`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from catoptra_protocol.labels import GroundTruth, LabelledObject
from catoptra_protocol.labels.masks import (
    ObjectMask,
    Polygon,
    find_masks,
    find_objects_at_border,
    trace_outlines,
)
from catoptra_protocol.labels.spherical_box import ANYWHERE, PixelSphere, SphericalBox
from catoptra_protocol.optics.camera_rays import pixel_from_point
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass


def project_boxes(
    labelled: Sequence[LabelledObject],
    camera: OmniCamera | PerspectiveCamera,
    world_from_camera: Pose,
) -> tuple[Floats, Bools]:
    """(n, 8, 2) pixels of the corners of n boxes, nan where invalid, and (n, 8) validity.

    A corner is valid if the camera's domain and image hold its pixel; other things may hide it. The
    order is that of `LabelledObject.corners`.
    """
    corners = np.array([one.corners() for one in labelled]).reshape(-1, 8, 3)
    in_camera = world_from_camera.inverse().transform_points(corners)
    if isinstance(camera, PerspectiveCamera):
        pixels, valid = camera.pixel_from_direction(in_camera)
    else:
        pixels, valid = pixel_from_point(camera, in_camera)
    size = (camera.width_px, camera.height_px)
    valid = valid & ((pixels >= 0.0) & (pixels <= size)).all(axis=-1)
    return np.where(valid[..., None], pixels, np.nan), valid


_UNKNOWN: Mapping[int, float] = {}


@dataclass(frozen=True, slots=True, eq=False)
class ObjectAnnotation:
    """One object in an image."""

    labelled: LabelledObject
    mask: ObjectMask
    polygons: Sequence[Polygon]
    """Outlines of the mask and of its holes, corners (column, row) of pixels' edges."""
    spherical_box: SphericalBox
    corners_px: Floats
    """(8, 2) corners of the object's box in the image, nan where invalid."""
    corners_valid: Bools
    """(8,) whether the image holds each corner."""
    is_truncated: bool
    """Whether the object reaches the border of the image or of the camera's domain."""
    occluded_fraction: float | None
    """Fraction of the object's own pixels that others hide; None if unknown."""

    def to_json(self) -> dict[str, Any]:
        """Plain numbers and texts: angles in radians, lengths in metres, pixels as in masks."""
        labelled, box = self.labelled, self.spherical_box
        return {
            "id": labelled.number,
            "name": labelled.name,
            "class": labelled.class_name,
            "class_id": labelled.class_number,
            "area_px": self.mask.area_px,
            "box_px": list(self.mask.box_px),
            "mask": {
                "size": [self.mask.height_px, self.mask.width_px],
                "counts": self.mask.counts,
            },
            "polygons": [polygon.tolist() for polygon in self.polygons],
            "spherical_box": {
                "azimuth_from_rad": box.azimuth_from_rad,
                "azimuth_width_rad": box.azimuth_width_rad,
                "elevation_from_rad": box.elevation_from_rad,
                "elevation_to_rad": box.elevation_to_rad,
            },
            "cone": {
                "axis": box.cone.axis.tolist(),
                "half_angle_rad": box.cone.half_angle_rad,
            },
            "box_3d": {
                "position_m": labelled.world_from_box.translation.tolist(),
                "rotation": labelled.world_from_box.rotation.reshape(-1).tolist(),
                "half_size_m": labelled.half_size_m.tolist(),
                # JSON has no nan.
                "corners_px": [
                    corner if valid else None
                    for corner, valid in zip(
                        self.corners_px.tolist(), self.corners_valid.tolist(), strict=True
                    )
                ],
            },
            "truncated": self.is_truncated,
            "occluded_fraction": self.occluded_fraction,
        }


def annotate_objects(
    truth: GroundTruth,
    camera: OmniCamera | PerspectiveCamera,
    world_from_camera: Pose,
    sphere: PixelSphere,
    occluded_fractions: Mapping[int, float] = _UNKNOWN,
) -> tuple[ObjectAnnotation, ...]:
    """Annotate all objects in view, by ascending number.

    Args:
        truth: Ground truth with the channels `ids` and `valid`.
        camera: Camera of the image.
        world_from_camera: Pose of the mirror frame, or of an ordinary camera's.
        sphere: Directions of the camera's pixels.
        occluded_fractions: Hidden fraction of objects by number, where known.
    """
    ids = truth.channels["ids"]
    objects = {one.number: one for one in truth.objects}
    masks = find_masks(ids)
    in_view = [objects[mask.number] for mask in masks]
    corners_px, corners_valid = project_boxes(in_view, camera, world_from_camera)
    truncated = find_objects_at_border(ids, truth.channels["valid"].astype(bool))
    outlines, boxes = trace_outlines(ids), sphere.enclose(ids)
    return tuple(
        ObjectAnnotation(
            one,
            mask,
            outlines[mask.number],
            # Of pixels of a displaced camera that the exact one does not show.
            boxes.get(mask.number, ANYWHERE),
            corners_px[row],
            corners_valid[row],
            mask.number in truncated,
            occluded_fractions.get(mask.number),
        )
        for row, (one, mask) in enumerate(zip(in_view, masks, strict=True))
    )
