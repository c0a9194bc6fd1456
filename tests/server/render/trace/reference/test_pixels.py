"""Radiance of hits against the shading model; labels of both engines agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.labels.label_renderer import LabelledImage
from catoptra_server.render.trace.reference.meshes import (
    FirstHits,
    PlacedMesh,
    WorldRays,
    find_first_hits,
    interpolate_poses,
    trace_scene,
)
from catoptra_server.render.trace.reference.pixels import Lighting, shade_hits
from catoptra_server.world.objects import INSTANTANEOUS
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import Twist, World
from helpers.labelled_rooms import CAMERAS, STATE, open_labels
from helpers.reference_caster import cast_rays
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    DIRECTIONAL_LIGHT,
    POINT_LIGHT,
    box_item,
    floor_item,
    make_inward_facing_room,
    make_world,
    reference_radiance,
)

VIEWPOINT = np.array((0.3, -0.2, -0.7))
CENTRE = np.array((0.1, 0.2, -0.3))
BOXES = make_world(
    floor_item(),
    box_item(0.5, 0.5, -0.3, (0.4, 0.2, 0.6)),
    box_item(-0.6, 0.1, -0.1, (0.2, 0.5, 0.2)),
    lights=(DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
)


def random_directions(count: int) -> Floats:
    found = np.random.default_rng(4).normal(size=(count, 3))
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def shade(
    scene: SceneMesh, world: World, directions: Floats, *, has_shadows: bool
) -> tuple[Floats, FirstHits]:
    """Radiance from the viewpoint, and the hits."""
    mesh = trace_scene(scene, CENTRE, world.lights)
    placed = [PlacedMesh(mesh, interpolate_poses((Pose.identity(),), None))]
    steps = np.zeros((len(directions), 2, 3))
    rays = WorldRays(np.tile(VIEWPOINT - CENTRE, (len(directions), 1)), directions, steps)
    hits = find_first_hits(placed, rays)
    lighting = Lighting(CENTRE, world.background, has_shadows)
    return shade_hits(placed, rays, hits, lighting), hits


def test_radiance_without_shadows_is_that_of_the_float64_caster() -> None:
    scene, directions = build_scene(BOXES), random_directions(800)
    radiance, _ = shade(scene, BOXES, directions, has_shadows=False)
    expected = cast_rays(scene, BOXES, VIEWPOINT, directions)
    assert expected.is_certain.mean() > 0.95
    certain = expected.is_certain
    np.testing.assert_allclose(radiance[certain], expected.radiance[certain], atol=1e-9)


@pytest.mark.parametrize("world", [BOXES, make_inward_facing_room(POINT_LIGHT)])
def test_radiance_with_shadows_is_that_of_all_triangles_tested(world: World) -> None:
    scene, directions = build_scene(world), random_directions(800)
    radiance, hits = shade(scene, world, directions, has_shadows=True)
    met = hits.triangle >= 0
    points = VIEWPOINT + hits.distance[met, None] * directions[met]
    expected, certain = reference_radiance(scene, world, hits.triangle[met], points)
    assert certain.mean() > 0.95
    np.testing.assert_allclose(radiance[met][certain], expected[certain], atol=1e-9)
    assert (radiance[~met] == world.background).all()


def test_shadows_darken_some_hits_and_brighten_none() -> None:
    scene, directions = build_scene(BOXES), random_directions(2000)
    lit, _ = shade(scene, BOXES, directions, has_shadows=False)
    shadowed, _ = shade(scene, BOXES, directions, has_shadows=True)
    assert (shadowed <= lit + 1e-12).all()
    assert 0.01 < (shadowed < lit - 1e-3).any(axis=-1).mean() < 0.5


def test_unlit_surface_shows_its_albedo_in_any_shadow() -> None:
    scene = build_scene(BOXES)
    scene = replace(scene, unlit=np.ones(len(scene), dtype=bool))
    radiance, hits = shade(scene, BOXES, random_directions(200), has_shadows=True)
    met = hits.triangle >= 0
    np.testing.assert_array_equal(radiance[met], scene.albedo[hits.triangle[met]])


ROLLING = replace(
    STATE,
    twist=Twist((0.5, 0.0, 0.0), (0.0, 0.0, 2.0)),
    shutter=INSTANTANEOUS.add_exposure(0.02, 3.0).add_readout(0.06, 9.0),
)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("state", [STATE, ROLLING], ids=["still", "rolling"])
def test_engines_label_alike(name: str, state) -> None:
    found = []
    for engine in ("kernel", "reference"):
        with open_labels(engine) as labels:
            drawn = LabelledImage(CAMERAS[name], state, samples=3)
            found.append(labels.render(drawn, tuple(LABEL_CHANNELS), STATE).channels)
    kernel, reference = found
    same = kernel["ids"] == reference["ids"]
    assert same.mean() > 0.999
    for channel in ("range", "normal", "point", "flow"):
        a, b = kernel[channel][same], reference[channel][same]
        assert (np.isfinite(a) == np.isfinite(b)).mean() > 0.999
        both = np.isfinite(a) & np.isfinite(b)
        assert np.quantile(np.abs(a[both] - b[both]), 0.999) < 1e-3
    assert (kernel["agreement"] == reference["agreement"]).mean() > 0.995
    for each in found:
        # Neither beyond the rim nor where a ray leaves the scene: SPEC.md 9.10.
        assert not each["agreement"][each["ids"] == 0].any()
    np.testing.assert_array_equal(kernel["valid"], reference["valid"])
