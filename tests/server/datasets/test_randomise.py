"""What varies between samples: each by itself, cheaply, and with errors of one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from catoptra_protocol.errors import CatoptraError, ConfigError
from catoptra_server.config.known_names import bundled_files
from catoptra_server.datasets.randomise import FreeSpace
from catoptra_server.datasets.recipe import ValueRange
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.sample import RenderedSample, SampleDescriber, SampleDescription
from catoptra_server.datasets.sample_renderer import SampleRenderer
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import PointLight, World
from helpers.configs import find_line_number
from helpers.dataset_recipes import render_samples, stage_recipe, write_recipe

SECTION = "[Catoptra.Randomise]"
CHANNELS = ("Channels=range,normal,ids,classes,valid",)


def write(folder: Path, *keys: str, world: str = "four_legged_2006", **options: Any) -> Path:
    options = {"lines": CHANNELS, **options}
    return write_recipe(folder, SECTION, *keys, world=world, **options)


def describe(path: Path, index: int = 1) -> SampleDescription:
    return SampleDescriber(stage_recipe(path)).describe_sample(index)


def differ(one: RenderedSample, other: RenderedSample) -> set[str]:
    """Channels, the picture among them, that differ."""
    names = {
        name
        for name in one.channels
        if not np.array_equal(one.channels[name], other.channels[name])
    }
    return names | ({"rgb"} if not np.array_equal(one.rgb, other.rgb) else set())


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> RenderedSample:
    (sample,) = render_samples(write(tmp_path_factory.mktemp("plain"), "Lamps=0"), 1)
    return sample


@pytest.mark.parametrize(
    "key", ["Textures=all", "Colours=(Min=0.3,Max=1)", "Lamps=3", "Sun=2", "TextureFolder=images"]
)
def test_looks_and_light_change_the_picture_alone(
    tmp_path: Path, plain: RenderedSample, key: str
) -> None:
    images = tmp_path / "images"
    images.mkdir()
    Image.new("RGB", (8, 8), (200, 30, 30)).save(images / "red.png")
    (sample,) = render_samples(write(tmp_path, key), 1)
    assert differ(sample, plain) == {"rgb"}
    assert sample.metadata["world_from_camera"] == plain.metadata["world_from_camera"]


@pytest.mark.parametrize(
    ("key", "class_name"),
    [
        ("Distractors=6", "distractor"),
        ("Objects=(Thing=chair,Class=seat,Count=2)", "seat"),
        ('Robots=(Robot="p2dx",Count=2)', "robot"),
    ],
)
def test_objects_change_their_own_pixels_alone(
    tmp_path: Path, plain: RenderedSample, key: str, class_name: str
) -> None:
    (sample,) = render_samples(write(tmp_path, key), 1)
    assert differ(sample, plain) >= {"range", "normal", "ids", "rgb"}
    added = {one.number: one for one in sample.objects}
    for one in plain.objects:
        own = added.pop(one.number)
        assert (own.name, own.class_name, own.class_number) == (
            one.name,
            one.class_name,
            one.class_number,
        )
    assert {one.class_name for one in added.values()} == {class_name}
    is_theirs = np.isin(sample.channels["ids"], list(added))
    assert 0 < is_theirs.sum() < 0.5 * is_theirs.size
    for name, values in sample.channels.items():
        np.testing.assert_array_equal(values[~is_theirs], plain.channels[name][~is_theirs])
    assert set(sample.channels["classes"][is_theirs].tolist()) == {
        one.class_number for one in added.values()
    }


def test_mount_moves_the_camera_and_nothing_else(tmp_path: Path) -> None:
    keys = ("Lamps=2", "Distractors=3", "Textures=all")
    one = describe(write(tmp_path, *keys))
    other = describe(write(tmp_path, *keys, "MountShift=0.02", "MountTurn=0.05"))
    moved = one.state.world_from_mirror.inverse() @ other.state.world_from_mirror
    assert 0.0 < np.abs(moved.translation).max() < 0.04
    assert one.lamps == other.lamps
    poses = [
        [placed.world_from_object.translation for placed in each.state.objects]
        for each in (one, other)
    ]
    np.testing.assert_array_equal(*poses)
    np.testing.assert_array_equal(
        one.motion.world_from_robot.translation, other.motion.world_from_robot.translation
    )


def test_one_more_changes_no_other(tmp_path: Path) -> None:
    one = describe(write(tmp_path, "Lamps=2", "Distractors=3"))
    other = describe(write(tmp_path, "Lamps=3", "Distractors=4", "Colours=(Min=0.5,Max=1)"))
    assert other.lamps[:2] == one.lamps
    names = [placed.name for placed in other.state.objects]
    assert names == [f"distractor.{number}" for number in (1, 2, 3, 4)]
    for placed, again in zip(one.state.objects, other.state.objects, strict=False):
        np.testing.assert_array_equal(
            placed.world_from_object.translation, again.world_from_object.translation
        )
        np.testing.assert_array_equal(placed.mesh.corners, again.mesh.corners)


def test_things_of_a_drive_stay_and_robots_move_alike_from_any_sample(
    tmp_path: Path,
) -> None:
    keys = (
        "Distractors=3",
        'Robots=(Robot="p2dx")',
        "[Catoptra.DrivePoses]",
        "Samples=4",
        "Interval=0.4",
    )
    path = write(tmp_path, *keys, poses="drive", lines=("Channels=ids,flow",))
    stage = stage_recipe(path)
    describer = SampleDescriber(stage)
    first, second = (describer.describe_sample(index) for index in (0, 1))
    assert first.next_state is not None
    *_, robot = (one for one in second.state.objects if one.class_name == "robot")
    *_, before_it = (one for one in first.state.objects if one.class_name == "robot")
    for before, after in zip(first.next_state.objects, second.state.objects, strict=True):
        np.testing.assert_array_equal(
            before.world_from_object.translation, after.world_from_object.translation
        )
    for before, after in zip(first.state.objects, second.state.objects, strict=True):
        has_moved = before.class_name == "robot"
        assert (before.world_from_object is not after.world_from_object) == has_moved
    moved = robot.world_from_object.translation - before_it.world_from_object.translation
    assert 1e-3 < np.abs(moved).max() < 0.5
    assert robot.twist.speed_m_s > 0.0
    for one, again in zip(second.state.objects, describe(path, 1).state.objects, strict=True):
        np.testing.assert_array_equal(
            one.world_from_object.translation, again.world_from_object.translation
        )


def test_things_stand_free_of_the_scene_of_each_other_and_of_the_robot(tmp_path: Path) -> None:
    stage = stage_recipe(write(tmp_path, "Distractors=(Min=0,Max=8)", world="warehouse", samples=8))
    describer = SampleDescriber(stage)
    caster = stage.world(0).caster
    count = 0
    for index in range(8):
        state = describer.describe_sample(index).state
        spots = [(one.centre, one.mesh.radius_m) for one in state.objects]
        count += len(spots)
        for number, (centre, radius_m) in enumerate(spots):
            around = np.random.default_rng(number).standard_normal((200, 3))
            around /= np.linalg.norm(around, axis=-1, keepdims=True)
            inner = min(state.objects[number].mesh.half_size_m.tolist())
            # The largest ball inside of it meets nothing.
            assert (
                caster.distances(np.broadcast_to(centre, around.shape), around).min() > 0.99 * inner
            )
            for other, other_m in spots[:number]:
                assert np.linalg.norm((centre - other)[:2]) > 0.5 * (radius_m + other_m)
            assert np.linalg.norm((centre - state.world_from_mirror.translation)[:2]) > 0.2
    assert count > 12


def make_views(scene: SceneMesh, world: World) -> ViewCache:
    choice = choose_renderer("trace", scene, world, threads=1, is_reproducible=True)
    return ViewCache(
        RenderPlanner(RendererPool(choice, may_replace=False)), SceneSummarizer(scene, world)
    )


@pytest.mark.parametrize("world_name", ["four_legged_2006", "warehouse"])
def test_repainted_scene_has_the_bytes_of_a_new_renderer(tmp_path: Path, world_name: str) -> None:
    keys = ("Textures=all", "Colours=(Min=0.2,Max=1)", "Gloss=(Min=0.1,Max=0.5)")
    path = write(tmp_path, *keys, world=world_name)
    stage = stage_recipe(path)
    sample = SampleDescriber(stage).describe_sample(0)
    renderer = SampleRenderer(stage)
    painter, world = renderer._find_painter(0)
    lamp = PointLight((0.5, 0.5, -1.5), (2.0, 1.0, 1.0))
    lit, painted = replace(world, lights=(*world.lights, lamp)), painter.paint(0)
    state = replace(sample.state, has_gloss=True)
    request = ViewRequest(sample.spec, state, ())
    views = make_views(painter.scene, world)
    before = views.render(request).image.rgb
    views.repaint(painted, lit)
    after = views.render(request).image.rgb
    np.testing.assert_array_equal(after, make_views(painted, lit).render(request).image.rgb)
    assert np.abs(after.astype(int) - before).mean() > 5.0
    views.repaint(painter.scene, world)
    np.testing.assert_array_equal(views.render(request).image.rgb, before)


def test_both_engines_repaint(tmp_path: Path) -> None:
    path = write(tmp_path, "Textures=brick", "Colours=(Min=0.2,Max=1)", "Lamps=1")
    stage = stage_recipe(path)
    sample = SampleDescriber(stage).describe_sample(0)
    painter, world = SampleRenderer(stage)._find_painter(0)
    lit = replace(world, lights=(*world.lights, *sample.lamps))
    images = []
    for engine in ("kernel", "reference"):
        renderer = TraceRenderer(painter.scene, world, threads=1, engine=engine)  # type: ignore[arg-type]
        plan = (
            make_views(painter.scene, world)
            .render(ViewRequest(sample.spec, sample.state, ()))
            .frame_plan
        )
        view = renderer.prepare(sample.spec.camera, plan.plan)  # type: ignore[arg-type]
        renderer.repaint(painter.paint(0), lit)
        images.append(view.render(CameraState(sample.state.world_from_mirror)).rgb.astype(int))
        renderer.close()
    assert (np.abs(images[0] - images[1]) > 1).mean() < 0.01


def test_kept_classes_keep_their_looks(tmp_path: Path) -> None:
    stage = stage_recipe(write(tmp_path, "Colours=0.5", "Keep=beacon, goal"))
    painter, _ = SampleRenderer(stage)._find_painter(0)
    scene, painted = painter.scene, painter.paint(0)
    classes = np.array([one.class_name for one in scene.objects])[scene.object_index]
    ratio = painted.albedo / np.where(scene.albedo > 0.0, scene.albedo, 1.0)
    kept = np.isin(classes, ("beacon", "goal"))
    np.testing.assert_array_equal(painted.albedo[kept], scene.albedo[kept])
    assert ratio[~kept & ~scene.unlit].max() == pytest.approx(0.5)


def test_calibration_is_drawn_within_the_covariance(tmp_path: Path) -> None:
    (tmp_path / "chain.yaml").write_text(
        "# catoptra_covariance: centre_u_px centre_v_px | 4 0 0 1\n"
        "cam0:\n  camera_model: ds\n  intrinsics: [-0.17, 0.59, 156.1, 156.2, 254.5, 256.5]\n"
        "  distortion_model: none\n  distortion_coeffs: []\n  resolution: [512, 512]\n",
        encoding="utf-8",
    )
    (tmp_path / "lens.ini").write_text(
        "[Camera]\nItemClass=Catoptra.Lens\nTitle=a\nSource=b\nLicence=c\n"
        f"[Catoptra.Lens]\nCalibrationFile={tmp_path / 'chain.yaml'}\nFieldOfView=150\n",
        encoding="utf-8",
    )
    camera = 'Cameras=(Robot="p2at_omni",Model="lens.ini",Width=128,Height=128)'
    path = write(tmp_path, "Calibration=1", cameras=(camera,), samples=60)
    stage = stage_recipe(path)
    describer = SampleDescriber(stage)
    centres = np.array(
        [describer.describe_sample(index).spec.camera.centre_px for index in range(60)]
    )
    # Of a picture a quarter as large.
    assert centres.std(axis=0) == pytest.approx([0.5, 0.25], rel=0.35)
    assert len(np.unique(centres, axis=0)) == 60


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("Textrues=all", r"key Textrues is unknown.*Textures|did you mean Textures"),
        ("Textures=brik", "did you mean brick"),
        ("TextureFolder=empty", "a folder with images .*has none"),
        ("Lamps=(Min=0,Max=1000000)", "0 to 32|at most 32|<= 32"),
        ("Lamps=1000000", "0 to 32|at most 32|<= 32"),
        ("Distractors=(Min=3,Max=1)", "Min at most Max"),
        ("Objects=(Thing=chiar)", "did you mean chair"),
        ("Objects=(Thing=chair,Cuont=3)", "Cuont"),
        ("Objects=(Thing=chair,Count=33)", "32"),
        ('Robots=(Robot="p2dx",Count=17)', "16"),
        ('Robots=(Robot="p2dxx")', "p2dx"),
        ("MountTurn=2", "MountTurn"),
        ("Calibration=-1", "Calibration"),
    ],
)
def test_wrong_key_is_named_in_one_line(tmp_path: Path, key: str, message: str) -> None:
    (tmp_path / "empty").mkdir()
    path = write(tmp_path, key)
    with pytest.raises(ConfigError, match=message) as caught:
        read_recipe(path)
    assert "\n" not in str(caught.value)
    assert caught.value.location.line == find_line_number(path, key)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (("Keep=becon",), "becon is no class of a world.*beacon"),
        (("Calibration=1",), "has no CalibrationFile"),
        (("[Catoptra.Classes]", "carpet=1", "robto=2"), "no number for beacon.*robot"),
    ],
)
def test_recipe_that_no_world_fits_is_one_line(
    tmp_path: Path, keys: tuple[str, ...], message: str
) -> None:
    with pytest.raises(CatoptraError, match=message) as caught:
        _ = stage_recipe(write(tmp_path, *keys)).digest
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "keys",
    [
        ("Distractors=2", "DistractorSize=50"),
        ("Objects=(Thing=sofa,Count=2)", "Distance=(Min=500,Max=600)"),
    ],
)
def test_things_without_free_space_are_one_line(tmp_path: Path, keys: tuple[str, ...]) -> None:
    with pytest.raises(CatoptraError, match=r"recipe.ini:\d+.*no free space for") as caught:
        describe(write(tmp_path, *keys))
    assert "\n" not in str(caught.value)


def test_two_classes_of_one_number_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="a number of its own: carpet has 1"):
        read_recipe(write(tmp_path, "[Catoptra.Classes]", "carpet=1", "wall=1"))


def test_raster_draws_nothing_of_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="trace, which alone draws"):
        read_recipe(write(tmp_path, "Lamps=1", lines=("Renderer=raster",)))


def test_shipped_recipe_has_a_number_for_each_class() -> None:
    (path,) = (one for one in bundled_files("datasets") if one.stem == "randomised")
    recipe = read_recipe(path)
    assert recipe.randomisation is not None
    assert stage_recipe(path).digest


def test_place_is_not_given_twice(tmp_path: Path) -> None:
    world = stage_recipe(write(tmp_path, "Lamps=0")).world(0)
    way = np.array([[0.0, 0.0, -0.2]])
    space = FreeSpace(world.caster, way, 0.3, ValueRange(0.5, 1.5))
    generator = np.random.default_rng(5)
    places = [space.take(generator, 0.2, 0.4) for _ in range(40)]
    found = np.array([place for place in places if place is not None])
    assert 5 < len(found) < 40, "a ring of a metre holds no forty"
    gaps = np.linalg.norm(found[:, None, :2] - found[None, :, :2], axis=-1)
    assert gaps[~np.eye(len(found), dtype=bool)].min() > 0.4
    assert np.linalg.norm(found[:, :2], axis=-1).min() > 0.5
    np.testing.assert_allclose(found[:, 2], 0.0, atol=0.02)
