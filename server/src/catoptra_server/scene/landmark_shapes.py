"""Shapes of landmarks, beacons and goals, each built from one row of the landmark file.

The file is `catoptra_protocol.landmarks`, from which clients localize: rendered shapes and promised
positions have one source.
"""

from __future__ import annotations

import math

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.scene.world_description import Box, Cylinder, Item, Material, Rgb

WHITE: Rgb = (0.80, 0.80, 0.80)
GOAL_WALL_THICKNESS_M = 0.02


def items_from_landmark(landmark: Landmark, albedos: dict[str, Rgb]) -> tuple[Item, ...]:
    """Items of a landmark, with a linear albedo for each colour name."""
    return {"beacon": _beacon_items, "goal": _goal_items}[landmark.kind](landmark, albedos)


def _beacon_items(landmark: Landmark, albedos: dict[str, Rgb]) -> tuple[Item, ...]:
    """Beacon: a white post below the band, then the band's lower and upper colour."""
    centre = landmark.band_centre_m
    parts = [
        ("post", 0.0, landmark.band_bottom_m, WHITE),
        ("lower", landmark.band_bottom_m, centre, albedos[landmark.lower_colour]),
        ("upper", centre, landmark.band_top_m, albedos[landmark.upper_colour]),
    ]
    return tuple(
        Item(
            name=f"{landmark.name}.{part}",
            shape=Cylinder(radius_m=0.5 * landmark.width_m, height_m=top - bottom),
            world_from_item=Pose.from_rpy((landmark.x_m, landmark.y_m, -0.5 * (bottom + top))),
            material=Material(albedo),
            object_name=landmark.name,
            class_name=landmark.kind,
        )
        for part, bottom, top, albedo in parts
        # A band that begins at the floor has no post.
        if top > bottom
    )


def _goal_items(landmark: Landmark, albedos: dict[str, Rgb]) -> tuple[Item, ...]:
    """Goal: a back and two sides, open towards the world's origin, without floor and top."""
    # The mouth faces the origin along x: +1 for a goal at positive x, whose back is at larger x.
    outward = math.copysign(1.0, landmark.x_m)
    half, height = 0.5 * landmark.width_m, landmark.band_top_m
    back_x = landmark.x_m + outward * (landmark.depth_m + 0.5 * GOAL_WALL_THICKNESS_M)
    side_x = landmark.x_m + outward * 0.5 * landmark.depth_m
    boards = [
        (
            "back",
            back_x,
            0.0,
            (GOAL_WALL_THICKNESS_M, landmark.width_m + 2 * GOAL_WALL_THICKNESS_M, height),
        ),
        (
            "left",
            side_x,
            -half - 0.5 * GOAL_WALL_THICKNESS_M,
            (landmark.depth_m, GOAL_WALL_THICKNESS_M, height),
        ),
        (
            "right",
            side_x,
            half + 0.5 * GOAL_WALL_THICKNESS_M,
            (landmark.depth_m, GOAL_WALL_THICKNESS_M, height),
        ),
    ]
    material = Material(albedos[landmark.upper_colour])
    return tuple(
        Item(
            name=f"{landmark.name}.{board}",
            shape=Box(size),
            world_from_item=Pose.from_rpy((x, landmark.y_m + y, -0.5 * height)),
            material=material,
            object_name=landmark.name,
            class_name=landmark.kind,
        )
        for board, x, y, size in boards
    )
