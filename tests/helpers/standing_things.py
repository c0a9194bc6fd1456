"""Scenes in which things stand on a floor, with their occlusion maps, and the exact factors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.occlusion.baking import bake_occlusion, occluder_weights
from catoptra_server.render.trace.ray_caster import commit_to_reference
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import (
    Box,
    HemisphereLight,
    Item,
    Light,
    Material,
    Rectangle,
    World,
)

SKY = HemisphereLight((0.8, 0.8, 0.8), (0.4, 0.4, 0.4))
FLOOR = Item("floor", Rectangle((8, 8)), Pose.identity(), Material((0.5, 0.5, 0.5)))


def make_box_world(
    size_m: tuple[float, float, float] = (0.5, 0.4, 0.6), *, lights: tuple[Light, ...] = (SKY,)
) -> World:
    """A floor, and a box at its middle."""
    pose = Pose.from_rpy((0.0, 0.0, -0.5 * size_m[2]))
    box = Item("box", Box(size_m), pose, Material((0.6, 0.3, 0.2)))
    return World("standing", (FLOOR, box), lights=lights)


def bake_scene(world: World, *, threads: int = 1) -> SceneMesh:
    """Scene of a world with its occlusion map."""
    scene = build_scene(world)
    caster = commit_to_reference(scene)
    return replace(scene, occlusion=bake_occlusion(scene, caster, threads=threads))


def bend_scene(scene: SceneMesh) -> SceneMesh:
    """Scene with smooth, two-sided and shining triangles: two thirds of them are each."""
    rng = np.random.default_rng(5)
    normals = scene.normals[:, None] + rng.normal(0.0, 0.3, scene.corners.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    third = np.arange(len(scene)) % 3
    # Every second triangle is seen from behind.
    turned = (np.arange(len(scene)) % 2 == 1)[:, None]
    corners = np.where(turned[..., None], scene.corners[:, ::-1], scene.corners)
    return replace(
        scene,
        corners=corners,
        normals=np.where(turned, -scene.normals, scene.normals),
        uv=np.where(turned[..., None], scene.uv[:, ::-1], scene.uv),
        corner_normals=np.where((third == 0)[:, None, None], scene.normals[:, None], normals),
        two_sided=third != 1,
        emission=np.where((third == 2)[:, None], 0.0, rng.uniform(0.0, 0.2, scene.normals.shape)),
    )


def pierce_scene(scene: SceneMesh) -> SceneMesh:
    """Scene with holes in half of its triangles, by textures too, and with backs that are none."""
    rng = np.random.default_rng(6)
    count = np.arange(len(scene))
    coverage = np.where((count % 2 == 0)[:, None], rng.uniform(0.5, 2.0, (len(scene), 3)), np.inf)
    images = []
    for image in scene.textures:
        opacity = np.zeros((*image.shape[:2], 1), dtype=np.uint8)
        opacity[image.shape[0] // 3 :, image.shape[1] // 4 :] = 255
        images.append(np.concatenate((image, opacity), axis=-1))
    one_sided = count % 3 == 0
    turned = (count % 6 == 0)[:, None]
    return replace(
        scene,
        corners=np.where(turned[..., None], scene.corners[:, ::-1], scene.corners),
        normals=np.where(turned, -scene.normals, scene.normals),
        uv=np.where(turned[..., None], scene.uv[:, ::-1], scene.uv),
        coverage=coverage,
        single_sided=one_sided,
        textures=tuple(images),
    )


def blend_scene(scene: SceneMesh, *, seed: int = 7) -> SceneMesh:
    """Scene of which half of the triangles blend, by textures too, some seen from one side."""
    rng = np.random.default_rng(seed)
    blended = rng.random(len(scene)) < 0.5
    opacity = rng.uniform(0.1, 1.2, (len(scene), 3))
    is_single = rng.random(len(scene)) < 0.2
    images = []
    for image in scene.textures:
        across = np.linspace(0.0, 1.0, image.shape[1])
        ramp = np.broadcast_to(np.rint(255.0 * across), image.shape[:2])
        images.append(np.concatenate((image, ramp[..., None].astype(np.uint8)), axis=-1))
    return replace(
        scene,
        coverage=np.where(blended[:, None], 2.0 * opacity, np.inf),
        blended=blended,
        two_sided=~is_single,
        single_sided=is_single,
        textures=tuple(images),
    )


def integrate_factor(scene: SceneMesh, point: Floats, normal: Floats, *, count: int = 200) -> float:
    """Factor of a point by brute force: count x count directions, all triangles, float64."""
    across = (np.arange(count) + 0.5) / count
    u, v = np.meshgrid(across, 2.0 * np.pi * across, indexing="ij")
    other = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
    axis_x = np.cross(normal, other)
    axis_x /= np.linalg.norm(axis_x)
    axes = np.stack((axis_x, np.cross(normal, axis_x), normal))
    local = np.stack((np.sqrt(u) * np.cos(v), np.sqrt(u) * np.sin(v), np.sqrt(1.0 - u)), axis=-1)
    directions = local.reshape(-1, 3) @ axes
    nearest = np.full(len(directions), np.inf)
    for corners in scene.corners:
        nearest = np.minimum(nearest, _meet_triangle(point, directions, corners))
    return float(1.0 - occluder_weights(nearest).mean())


def _meet_triangle(point: Floats, directions: Floats, corners: Floats) -> Floats:
    """(n,) distances to a triangle, inf beside it. Source: Moeller & Trumbore 1997."""
    edge1, edge2 = corners[1] - corners[0], corners[2] - corners[0]
    across = np.cross(directions, edge2)
    determinant = across @ edge1
    safe = np.where(np.abs(determinant) < 1e-12, np.inf, determinant)
    from_first = point - corners[0]
    u = across @ from_first / safe
    turned = np.cross(from_first, edge1)
    v = directions @ turned / safe
    distance = (edge2 @ turned) / safe
    is_met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 1e-9) & np.isfinite(safe)
    return np.where(is_met, distance, np.inf)
