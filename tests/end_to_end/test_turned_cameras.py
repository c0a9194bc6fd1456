"""A fish-eye that looks ahead, tilted and turned: panoramas, labels, detections are the robot's."""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from catoptra_client.frame import Frame, Pixels
from catoptra_client.frame_pictures import make_panorama
from catoptra_client.landmarks import Viewpoint, detect, label_frame, make_detector, train
from catoptra_client.landmarks.blobs import world_from_mirror
from catoptra_client.landmarks.classifier import COLOUR_CODES
from catoptra_client.landmarks.training import LabelMargins
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import LENS_FROM_MIRROR, Pose
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.configs import FIELD
from helpers.image_comparison import mask_away_from_edges

HEIGHT_M = 0.6
# Ahead, 20 degrees down, rolled and a little to the right; 10 cm before the robot's middle.
AHEAD = Pose.from_rpy((0.1, -0.05, -HEIGHT_M), (0.15, math.radians(-20.0), 0.2)) @ LENS_FROM_MIRROR
HANGING = Pose.from_rpy((0.1, -0.05, -HEIGHT_M))
POSES = [(-0.8, 0.3, 0.1), (0.4, -0.6, 2.4), (-0.3, 0.9, -1.1), (1.2, 0.2, 3.0), (0.0, 0.0, -1.8)]


def make_fisheye(field_deg: float, size_px: int) -> OmniCamera:
    return camera_with_inscribed_rim(
        EquidistantLens(),
        width_px=size_px,
        height_px=size_px,
        rim_rad=math.radians(0.5 * field_deg),
        picture=Picture.FLIPPED,
    )


LENS = make_fisheye(220.0, 700)
BALL = camera_with_inscribed_rim(
    SphericalMirror(0.03, 0.2), width_px=500, height_px=500, rim_rad=math.radians(120.0)
)


class Field:
    """The bundled field, drawn for any camera."""

    def __init__(self) -> None:
        self._world, _ = read_world(FIELD)
        self._renderer = TraceRenderer(build_scene(self._world), self._world, threads=2)

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        return self._world.landmarks

    def draw(
        self,
        camera: OmniCamera,
        robot_from_mirror: Pose,
        place: tuple[float, ...],
        *,
        samples: int = 3,
    ) -> Pixels:
        settings = RenderSettings(PerPixel(), samples=samples)
        plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="test")
        view = self._renderer.prepare(camera, plan)
        robot = Pose.from_rpy((place[0], place[1], 0.0), (0.0, 0.0, place[2]))
        image = view.render(CameraState(robot @ robot_from_mirror)).rgb
        view.close()
        return image

    def close(self) -> None:
        self._renderer.close()


@pytest.fixture(scope="module")
def field() -> Iterator[Field]:
    field = Field()
    yield field
    field.close()


def make_frame(image: Pixels, camera: OmniCamera, robot_from_mirror: Pose) -> Frame:
    return Frame(image, 1, 0.0, ImageType.RAW, camera=camera, robot_from_mirror=robot_from_mirror)


def test_panorama_of_a_camera_that_looks_ahead_is_the_robot_s(field: Field) -> None:
    sphere = make_fisheye(300.0, 900)
    ahead, hanging = (
        make_panorama(make_frame(field.draw(camera, mount, POSES[0]), camera, mount), 400)
        for camera, mount in ((LENS, AHEAD), (sphere, HANGING))
    )
    assert ahead.shape == hanging.shape
    # Behind, the fish-eye shows nothing.
    shown = (ahead.max(axis=-1) > 0) & mask_away_from_edges(hanging)
    assert 0.4 < shown.mean() < 0.8
    difference = np.abs(ahead.astype(int) - hanging)[shown].max(axis=-1)
    assert np.mean(difference <= 2) > 0.99


def test_panorama_without_a_mount_is_the_camera_s_own(field: Field) -> None:
    image = field.draw(LENS, HANGING, POSES[0])
    with_mount = make_panorama(make_frame(image, LENS, HANGING), 300)
    np.testing.assert_array_equal(
        with_mount, make_panorama(Frame(image, 1, 0.0, ImageType.RAW, camera=LENS), 300)
    )


def test_landmarks_seen_ahead_have_the_robot_s_bearings_and_ranges(field: Field) -> None:
    viewpoint = Viewpoint.from_mount(AHEAD)
    assert viewpoint.height_m == pytest.approx(HEIGHT_M)
    frames = [field.draw(LENS, AHEAD, place) for place in POSES]
    labelled = [
        (
            image,
            label_frame(
                LENS,
                field.landmarks,
                world_from_mirror=world_from_mirror(viewpoint, np.array(place)),
            ),
        )
        for image, place in zip(frames, POSES, strict=True)
    ]
    # Not its own frames: the classifier of all but one finds the landmarks of that one.
    num_beacons = 0
    errors = []
    for index, place in enumerate(POSES):
        classifier = train([each for other, each in enumerate(labelled) if other != index])
        detector = make_detector(LENS, classifier, landmarks=field.landmarks, viewpoint=viewpoint)
        for found in detect(detector, frames[index]):
            truth = next(one for one in field.landmarks if one.name == found.name)
            dx, dy = truth.x_m - place[0], truth.y_m - place[1]
            off = math.remainder(found.bearing_rad - math.atan2(dy, dx) + place[2], 2.0 * math.pi)
            if truth.kind != "beacon":
                continue
            num_beacons += 1
            assert abs(off) < math.radians(0.5)
            errors.append(off / math.sqrt(found.covariance[1, 1]))
            if found.has_range:
                range_m = math.hypot(dx, dy)
                assert found.range_m == pytest.approx(range_m, rel=0.06)
                errors.append((found.range_m - range_m) / math.sqrt(found.covariance[0, 0]))
    assert num_beacons >= 6
    assert math.sqrt(float(np.square(errors).mean())) < 1.5


@pytest.mark.parametrize(
    ("camera", "mount"), [(LENS, AHEAD), (BALL, HANGING)], ids=["lens", "ball"]
)
def test_labels_are_on_the_landmarks_of_the_picture(
    field: Field, camera: OmniCamera, mount: Pose
) -> None:
    beacon = next(one for one in field.landmarks if one.kind == "beacon")
    place = (beacon.x_m - 0.2 * math.copysign(1.0, beacon.x_m), beacon.y_m, 0.0)
    # One ray a pixel, as labels have: no pixel mixes colours.
    image = field.draw(camera, mount, place, samples=1).astype(int)
    robot = Pose.from_rpy((place[0], place[1], 0.0), (0.0, 0.0, place[2]))
    labels = label_frame(
        camera,
        [beacon],
        world_from_mirror=robot @ mount,
        margins=LabelMargins(erosion_px=0, clearance_px=3),
    )
    hue = image / np.maximum(np.linalg.norm(image, axis=-1, keepdims=True), 1.0)
    for colour in (beacon.lower_colour, beacon.upper_colour):
        labelled = labels == COLOUR_CODES[colour]
        assert labelled.sum() > 50
        # Light and shade differ along a beacon, its hue does not.
        middle = np.median(hue[labelled], axis=0)
        assert middle.max() - middle.min() > 0.3
        # Other things of the field have that hue, too, farther off.
        near = cv2.dilate(labelled.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
        shown = near & (hue @ middle / np.linalg.norm(middle) > 0.97)
        # A beacon of the world has flat sides.
        wrong = np.mean(shown[near] != labelled[near])
        assert wrong < 0.01
