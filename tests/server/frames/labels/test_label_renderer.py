"""Channels, hidden fractions and flow, against rays cast without any of the renderer's code."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh

from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.medium.misalignment import Misalignment, lookup_maps
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels import label_renderer as occluded_fraction
from catoptra_server.frames.labels.label_renderer import project_points
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import RenderSettings, advance
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.simulation.sight import NamedScene
from catoptra_server.world.objects import INSTANTANEOUS, CameraState, FogMedium
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, Twist
from helpers.labelled_rooms import (
    CAMERAS,
    FISH_EYE,
    ROBOTS,
    SCENE,
    STATE,
    WORLD,
    CastRays,
    cast_image,
    open_labels,
)
from helpers.long_cases import quick_cases
from helpers.worlds import make_omni_camera

ALL = tuple(LABEL_CHANNELS)


@pytest.fixture(params=CAMERAS)
def camera(request: pytest.FixtureRequest) -> OmniCamera:
    return CAMERAS[request.param]


def draw_labels(
    image: LabelledImage,
    channels: tuple[str, ...],
    other: CameraState | None = None,
    *,
    engine: EngineName = "kernel",
) -> Mapping[str, np.ndarray]:
    """Channels of one image, with the flow to the other state."""
    with open_labels(engine) as labels:
        return labels.render(image, channels, other).channels


MOVED_ROBOTS = tuple(
    replace(robot, world_from_object=robot.world_from_object @ Pose.from_rpy((0.05, 0, 0)))
    for robot in ROBOTS
)


@cache
def cast_still(camera: OmniCamera) -> CastRays:
    """Rays of the still scene, of which both engines are compared with the same."""
    return cast_image(camera, STATE)


@pytest.mark.parametrize("engine", ["kernel", "reference"])
def test_channels_are_those_of_an_independent_caster(camera: OmniCamera, engine) -> None:
    cast = cast_still(camera)
    found = draw_labels(LabelledImage(camera, STATE), ALL, engine=engine)
    sure = cast.is_certain
    assert sure.mean() > 0.5 * found["valid"].mean()
    seen = sure & np.isfinite(cast.range_m)
    assert seen.sum() > 1500
    np.testing.assert_array_equal(found["ids"][sure], cast.ids[sure])
    # Robots and things are in view, not the floor alone.
    assert len(np.unique(cast.ids[seen])) >= 6
    np.testing.assert_array_equal(np.isinf(found["range"][sure]), np.isinf(cast.range_m[sure]))
    np.testing.assert_allclose(found["range"][seen], cast.range_m[seen], rtol=1e-4)
    np.testing.assert_allclose(found["point"][seen], cast.point[seen], atol=1e-3)
    cosine = np.einsum("ni,ni->n", found["normal"][seen], cast.normal[seen])
    assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < 0.1


def test_ids_beside_edges_are_the_majority_of_samples(camera: OmniCamera) -> None:
    """Pixels that edges cross have the id of most of 16 x 16 rays, where most agree clearly."""
    side = 16
    offsets = (np.arange(side) + 0.5) / side
    found = draw_labels(LabelledImage(camera, STATE, samples=4), ("ids", "agreement"))
    mixed = (found["agreement"] > 0) & (found["agreement"] < 255) & (found["ids"] > 0)
    rows, columns = np.nonzero(mixed)
    assert len(rows) > 100
    chosen = np.random.default_rng(7).choice(len(rows), 40, replace=False)
    decided = 0
    corners = np.column_stack((columns[chosen], rows[chosen]))
    inside = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    cast = cast_image(camera, STATE, corners[:, None] + inside)
    for row, column, ids in zip(rows[chosen], columns[chosen], cast.ids, strict=True):
        values, counts = np.unique(ids, return_counts=True)
        agreement = (ids == found["ids"][row, column]).mean()
        # 4 x 4 samples of the 16 x 16: an edge through the pixel moves the fraction by so much.
        assert found["agreement"][row, column] / 255.0 == pytest.approx(agreement, abs=0.17)
        if counts.max() > 0.67 * side * side:
            assert found["ids"][row, column] == values[counts.argmax()]
            decided += 1
    assert decided > 5


def test_agreement_is_whole_where_a_pixel_shows_one_object() -> None:
    camera = CAMERAS["paper"]
    found = draw_labels(LabelledImage(camera, STATE, samples=2), ("ids", "agreement"))
    ids = found["ids"].astype(int)
    inner = np.zeros(ids.shape, dtype=bool)
    inner[1:-1, 1:-1] = True
    for axis in (0, 1):
        for step in (-1, 1):
            inner &= np.roll(ids, step, axis=axis) == ids
    inner &= ids > 0
    assert (found["agreement"][inner] == 255).mean() > 0.98


def test_classes_are_those_of_the_ids() -> None:
    with open_labels() as labels:
        truth = labels.render(LabelledImage(CAMERAS["paper"], STATE), ("ids", "classes"))
        classes = {one.number: one.class_number for one in truth.objects}
        names = {one.number: one.class_name for one in truth.objects}
    ids = truth.channels["ids"]
    for number in np.unique(ids[ids > 0]):
        assert (truth.channels["classes"][ids == number] == classes[number]).all()
    assert names[6] == names[7] == "robot"
    assert (truth.channels["classes"][ids == 0] == 0).all()


def test_ranges_of_two_poses_make_one_cloud(camera: OmniCamera) -> None:
    """Back-projected points lie on the planes that the other pose saw, at the rim as in the
    middle."""
    other = replace(STATE, world_from_mirror=Pose.from_rpy((0.1, -0.3, -0.75), (0.05, 0.1, -1.1)))
    first, second = (
        draw_labels(LabelledImage(camera, state), ("point", "normal", "ids"))
        for state in (STATE, other)
    )
    planes = 0
    for number in np.unique(second["ids"]):
        if number == 0 or number > 5:
            continue
        here, there = first["ids"] == number, second["ids"] == number
        normals = second["normal"][there] @ other.world_from_mirror.rotation.T
        offsets = np.einsum("ni,ni->n", normals, second["point"][there])
        # Facets of the same object: each plane once.
        facets = np.column_stack((normals, offsets))
        _, once = np.unique(facets.round(2), axis=0, return_index=True)
        facets = facets[once]
        own = first["normal"][here] @ STATE.world_from_mirror.rotation.T
        distance = np.abs(first["point"][here] @ facets[:, :3].T - facets[:, 3])
        # Of those facets that have the direction of the point's own.
        distance[own @ facets[:, :3].T < 0.9999] = np.inf
        nearest = distance.min(axis=1)
        if np.isfinite(nearest).sum() > 20:
            planes += 1
            assert nearest[np.isfinite(nearest)].max() < 1e-3
    assert planes >= 3


def test_rows_of_a_rolling_shutter_are_labelled_at_their_own_times() -> None:
    camera = CAMERAS["paper"]
    moving = replace(
        STATE,
        twist=Twist((0.5, 0.0, 0.0), (0.0, 0.0, 2.0)),
        objects=tuple(replace(robot, twist=Twist((0.0, 1.0, 0.0))) for robot in ROBOTS),
        shutter=INSTANTANEOUS.add_exposure(0.02, 3.0).add_readout(0.06, 9.0),
    )
    found = draw_labels(LabelledImage(camera, moving), ("range", "ids"))
    for row in (10, 48, 80):
        time_s = 0.06 * ((row + 0.5) / camera.height_px - 0.5)
        pixels = np.column_stack(
            (np.arange(camera.width_px) + 0.5, np.full(camera.width_px, row + 0.5))
        )
        cast = cast_image(camera, advance(moving, time_s), pixels[None])
        sure, ids, range_m = cast.is_certain[0], cast.ids[0], cast.range_m[0]
        # Poses between two states are interpolated entry by entry: a few pixels at edges.
        assert (found["ids"][row] == ids)[sure].mean() > 0.97
        same = sure & (found["ids"][row] == ids) & np.isfinite(range_m)
        np.testing.assert_allclose(found["range"][row][same], range_m[same], rtol=5e-3)


def test_global_shutter_is_labelled_at_the_middle_of_the_exposure() -> None:
    camera = CAMERAS["paper"]
    moving = replace(
        STATE,
        twist=Twist((0.5, 0.0, 0.0), (0.0, 0.0, 2.0)),
        shutter=INSTANTANEOUS.add_exposure(0.05, 3.0),
    )
    blurred = draw_labels(LabelledImage(camera, moving), ("ids",))
    still = draw_labels(LabelledImage(camera, STATE), ("ids",))
    np.testing.assert_array_equal(blurred["ids"], still["ids"])


def test_displaced_camera_is_labelled_as_its_picture_shows() -> None:
    camera = CAMERAS["paper"]
    displaced = Misalignment(x_m=0.004, pitch_rad=0.01)
    drawn = LabelledImage(camera, STATE, image_effects=(displaced,))
    found = draw_labels(drawn, ("ids", "valid"))
    aligned = draw_labels(LabelledImage(camera, STATE), ("ids",))
    lookup = lookup_maps(displaced, camera)[0]
    assert np.hypot(lookup[..., 0], lookup[..., 1])[lookup[..., 2] > 0].max() > 1.0
    u, v = np.meshgrid(np.arange(96) + 0.5, np.arange(96) + 0.5)
    cast = cast_image(camera, STATE, np.stack((u, v), axis=-1) + lookup[..., :2])
    sure = cast.is_certain & (lookup[..., 2] > 0.0)
    np.testing.assert_array_equal(found["ids"][sure], cast.ids[sure])
    assert (found["ids"] != aligned["ids"]).sum() > 50


def test_flow_leads_to_the_point_in_the_other_image_and_back(camera: OmniCamera) -> None:
    here = STATE
    there = replace(
        STATE,
        world_from_mirror=Pose.from_rpy((0.36, 0.2, -0.61), (0.01, -0.02, 0.36)),
        objects=MOVED_ROBOTS,
    )
    forward = draw_labels(LabelledImage(camera, here), ("flow", "ids", "point"), there)
    backward = draw_labels(LabelledImage(camera, there), ("flow", "ids"), here)
    flow = forward["flow"]
    known = np.isfinite(flow).all(axis=-1)
    assert 0.5 < known[forward["ids"] > 0].mean() < 1.0
    rows, columns = np.nonzero(known)
    ends = np.column_stack((columns, rows)) + 0.5 + flow[known]
    # The ray of the end point meets the same object at the same, moved, point.
    cast = cast_image(camera, there, ends[:, None])
    sure = cast.is_certain[:, 0]
    np.testing.assert_array_equal(cast.ids[sure, 0], forward["ids"][known][sure])
    still = sure & (forward["ids"][known] <= 5)
    miss = np.linalg.norm(cast.point[still, 0] - forward["point"][known][still], axis=-1)
    # As an angle at the point's distance, 0.02 px of the coarsest part of the image.
    assert np.quantile(miss / cast.range_m[still, 0], 0.99) < 0.02 / 20.0
    # Forward and backward cancel where the flow varies little over a pixel.
    column, row = np.floor(ends).astype(int).T
    back = backward["flow"][row, column]
    alike = np.isfinite(back).all(axis=-1)
    alike &= backward["ids"][row, column] == forward["ids"][known]
    total = np.linalg.norm(back + flow[known], axis=-1)[alike]
    assert np.median(total) < 0.05


def test_flow_is_unknown_without_another_frame_and_of_what_is_gone() -> None:
    camera = CAMERAS["paper"]
    none = draw_labels(LabelledImage(camera, STATE), ("flow",))
    found = draw_labels(LabelledImage(camera, STATE), ("flow", "ids"), replace(STATE, objects=()))
    assert np.isnan(none["flow"]).all()
    assert np.isnan(found["flow"][found["ids"] > 5]).all()
    assert np.isfinite(found["flow"][found["ids"] == 1]).all(axis=-1).mean() > 0.9


def test_still_scene_has_no_flow(camera: OmniCamera) -> None:
    found = draw_labels(LabelledImage(camera, STATE), ("flow", "ids"), STATE)
    flow = found["flow"]
    known = np.isfinite(flow).all(axis=-1)
    assert known[found["ids"] > 0].mean() > 0.98
    assert np.abs(flow[known]).max() < 0.02


def test_perspective_cameras_have_the_same_channels() -> None:
    camera = PerspectiveCamera(64, 48, 1.2)
    found = draw_labels(LabelledImage(camera, STATE, samples=2), ALL)
    assert found["range"].shape == (48, 64)
    assert found["valid"].all()
    assert len(np.unique(found["ids"])) > 2


def test_only_requested_channels_are_rendered() -> None:
    assert list(draw_labels(LabelledImage(FISH_EYE, STATE), ("valid",))) == ["valid"]
    assert draw_labels(LabelledImage(FISH_EYE, STATE), ()) == {}


@pytest.mark.parametrize("engine", ["kernel", "reference"])
def test_flow_ends_at_the_pixel_that_the_camera_model_gives(camera: OmniCamera, engine) -> None:
    there = replace(
        STATE,
        world_from_mirror=Pose.from_rpy((0.41, 0.12, -0.62), (0.03, -0.02, 0.42)),
        objects=MOVED_ROBOTS,
    )
    with open_labels(engine) as labels:
        found = labels.render(
            LabelledImage(camera, STATE), ("flow", "ids", "point"), there
        ).channels
        robots = {labels.labels.number_of(one): index for index, one in enumerate(ROBOTS)}
    known = np.isfinite(found["flow"]).all(axis=-1)
    points, ids = found["point"][known].astype(float), found["ids"][known]
    for number, index in robots.items():
        here, moved = (state.objects[index].world_from_object for state in (STATE, there))
        those = ids == number
        points[those] = (moved @ here.inverse()).transform_points(points[those])
    in_mirror = there.world_from_mirror.inverse().transform_points(points)
    expected, valid = pixel_from_point(camera, in_mirror)
    assert valid.mean() > 0.999
    rows, columns = np.nonzero(known)
    ends = np.column_stack((columns, rows)) + 0.5 + found["flow"][known]
    assert np.abs(ends - expected)[valid].max() < 0.02
    assert np.linalg.norm(found["flow"][known], axis=-1).max() > 3.0


@pytest.mark.parametrize(
    ("name", "samples"), quick_cases(product(CAMERAS, (1, 2, 3)), 1, 3, 8), ids=str
)
def test_labels_beside_a_picture_are_those_alone_and_leave_the_picture(
    name: str, samples: int
) -> None:
    camera = CAMERAS[name]
    state = replace(STATE, has_shadows=True, fog=FogMedium(0.05, (0.6, 0.6, 0.6)))
    drawn = LabelledImage(camera, state, samples=samples)
    channels = tuple(name for name in ALL if name != "flow")
    plan = plan_from_settings(
        RenderSettings(samples=samples), camera, kind=RendererKind.TRACE, reason="a test"
    )
    with open_labels() as labels:
        renderer = TraceRenderer(SCENE, WORLD, threads=1)
        alone = labels.render(drawn, channels).channels
        request = labels.request(drawn, channels)
        view = renderer.prepare(camera, plan)
        for effects in ((), (Vignetting(),)):
            plain = view.render(state, effects)
            picture, found = view.render_with_labels(state, effects, {}, request)
            beside = labels.render(drawn, channels, found_beside=found).channels
            assert picture.rgb.tobytes() == plain.rgb.tobytes()
            for each in ("ids", "classes", "agreement", "valid"):
                np.testing.assert_array_equal(beside[each], alone[each], err_msg=each)
            # The same rays; proofs of planes, which differ, change the last bits.
            np.testing.assert_allclose(beside["range"], alone["range"], rtol=3e-6)
            np.testing.assert_allclose(beside["point"], alone["point"], atol=3e-5)
            np.testing.assert_allclose(beside["normal"], alone["normal"], atol=2e-6)
        view.close()
        renderer.close()


@pytest.mark.parametrize(
    "drawn",
    [
        LabelledImage(FISH_EYE, replace(STATE, shutter=replace(INSTANTANEOUS, exposure_s=0.01))),
        LabelledImage(CAMERAS["paper"], STATE, (Misalignment(x_m=0.004),)),
    ],
    ids=["exposed for a while", "displaced"],
)
def test_labels_of_other_rays_than_the_picture_are_not_found_beside_it(
    drawn: LabelledImage,
) -> None:
    with open_labels() as labels:
        assert labels.request(drawn, ("ids",)) is None


def test_mask_alone_takes_no_ray() -> None:
    with open_labels() as labels:
        assert labels.request(LabelledImage(FISH_EYE, STATE), ("valid",)) is None


CHANNELS = ("ids", "valid")


@pytest.mark.parametrize("name", CAMERAS)
def test_screen_hides_the_pixels_that_it_takes(name: str) -> None:
    camera = CAMERAS[name]
    screen = Item(
        "screen",
        Box((0.02, 0.3, 0.6)),
        Pose.from_rpy((-0.25, -0.45, -0.35), (0.0, 0.0, 0.8)),
        Material((0.5, 0.5, 0.5)),
    )
    alone = draw_labels(LabelledImage(camera, STATE), CHANNELS)["ids"]
    world = replace(WORLD, items=(*WORLD.items, screen))
    with open_labels(world=world) as labels:
        drawn = LabelledImage(camera, STATE)
        truth = labels.render(drawn, CHANNELS)
        found = labels.measure_occlusion(drawn, truth)
    ids = truth.channels["ids"]
    assert set(found) == set(np.unique(ids).tolist()) - {0}
    # Objects that nothing hid before.
    (crate,) = [one.number for one in truth.objects if one.name == "crate"]
    before, after = (alone == crate).sum(), (ids == crate).sum()
    assert 0 < after < 0.9 * before
    assert found[crate] == pytest.approx(1.0 - after / before, abs=0.03)
    (number,) = [one.number for one in truth.objects if one.name == "screen"]
    assert found[number] < 0.02


def test_robot_behind_the_crate_is_partly_hidden() -> None:
    camera = CAMERAS["paper"]
    drawn = LabelledImage(camera, STATE)
    with open_labels() as labels:
        truth = labels.render(drawn, CHANNELS)
        found = labels.measure_occlusion(drawn, truth)
        alone = LabelledImage(camera, replace(STATE, objects=ROBOTS[:1]))
        ids = labels.render(alone, CHANNELS).channels["ids"]
    first = labels.labels.number_of(ROBOTS[0])
    seen = (truth.channels["ids"] == first).sum()
    assert (ids == first).sum() == seen
    assert found[first] < 0.1
    assert 0.02 < found[labels.labels.number_of(ROBOTS[1])] < 0.95


def test_fewer_rays_estimate_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = LabelledImage(CAMERAS["fish-eye"], STATE)
    found = []
    for limit in (4096, 1000):
        monkeypatch.setattr(occluded_fraction, "_MAX_RAYS", limit)
        with open_labels() as labels:
            found.append(labels.measure_occlusion(drawn, labels.render(drawn, CHANNELS)))
    for number, fraction in found[0].items():
        assert found[1][number] == pytest.approx(fraction, abs=0.1)


@pytest.mark.parametrize("name", CAMERAS)
def test_points_on_rays_have_the_pixels_of_the_rays(name: str) -> None:
    camera = CAMERAS[name]
    rng = np.random.default_rng(3)
    pixels = rng.uniform(8.0, 88.0, (200, 2))
    origins, directions, valid = ray_from_pixel(camera, pixels)
    points = origins + rng.uniform(0.3, 20.0, (200, 1)) * directions
    found, shown = project_points(camera, points)
    assert valid.sum() > 100
    assert shown[valid].all()
    np.testing.assert_allclose(found[valid], pixels[valid], atol=2e-3)


def test_points_beside_the_image_are_invalid() -> None:
    camera = PerspectiveCamera(64, 48, 1.0)
    _, shown = project_points(
        camera, np.array(((1.0, 0.0, 0.0), (1.0, 2.0, 0.0), (-1.0, 0.0, 0.0)))
    )
    assert shown.tolist() == [True, False, False]


def test_points_near_a_mirror_without_a_viewpoint_have_the_pixels_of_the_exact_root() -> None:
    camera = CAMERAS["ball"]
    rng = np.random.default_rng(5)
    pixels = rng.uniform(8.0, 88.0, (400, 2))
    origins, directions, valid = ray_from_pixel(camera, pixels)
    points = (origins + rng.uniform(0.001, 0.4, (400, 1)) * directions)[valid]
    found, shown = project_points(camera, points)
    expected, _ = pixel_from_point(camera, points)
    assert shown.all()
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_placements_of_one_file_are_an_object_each(tmp_path: Path) -> None:
    trimesh.creation.box((0.1, 0.1, 1.0)).export(tmp_path / "post.stl")
    angles = np.arange(113) / 113.0 * math.tau
    scales = ("", ",Scale=1.5", ",Scale=(X=1,Y=-1,Z=1)")
    posts = [
        f"Meshes=(Name=post{i},File=post.stl,Position=(X={5 * math.cos(a):.6f},"
        f"Y={5 * math.sin(a):.6f},Z=-0.5),Direction=(Z={a:.6f}){scales[i % 3]})"
        for i, a in enumerate(angles.tolist())
    ]
    path = tmp_path / "posts.ini"
    path.write_text("\n".join(("[Catoptra.World]", *posts, "")))
    world, _ = read_world(path)
    scene = build_scene(world)
    state = CameraState(Pose.from_rpy((0.0, 0.0, -0.5)))
    camera = make_omni_camera(width_px=512)
    with open_labels(world=world) as labels:
        truth = labels.render(LabelledImage(camera, state), ("ids",))
    assert [one.name for one in truth.objects] == [f"post{i}" for i in range(113)]
    centres = np.array([one.world_from_box.translation for one in truth.objects])
    ring = np.stack((5.0 * np.cos(angles), 5.0 * np.sin(angles), np.full(113, -0.5)), axis=-1)
    np.testing.assert_allclose(centres, ring, atol=1e-5)
    pixels, seen = pixel_from_point(
        camera, state.world_from_mirror.inverse().transform_points(ring)
    )
    assert seen.all()
    columns, rows = np.floor(pixels).astype(int).T
    np.testing.assert_array_equal(
        truth.channels["ids"][rows, columns], [one.number for one in truth.objects]
    )
    things = NamedScene(scene, commit_ray_caster(scene), (), ())
    for index, (x, y, _) in enumerate((ring / 5.0).tolist()):
        range_m, name = things.find_first(np.array((0.0, 0.0, -0.5)), np.array((x, y, 0.0)))
        assert range_m == pytest.approx(4.95 - 0.025 * (index % 3 == 1), abs=1e-4)
        assert name == f"post{index}"
