"""Every bundled camera file: rays in float32, markers of both renderers, bounds.

A new file in configs/cameras is tested here without a line of its own.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.camera_rays import pixel_from_point, rays_from_pixel_grid
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_server.config.camera_file import CameraFile, carry_camera, read_camera_files
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.plans import choose_by_settings, plan_from_settings
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import PerPixel, Renderer, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, World
from helpers.long_cases import quick_cases
from helpers.markers import marker_centroid, marker_directions, marker_world
from helpers.opengl import make_raster
from helpers.worlds import CAMERA_STATE

FILES = read_camera_files(())
# The paper's mirror, a cone, a lens that looks all around, a calibration.
RASTERED = quick_cases(
    FILES,
    *(
        index
        for index, file in enumerate(FILES)
        if file.name in ("paper", "conical", "equidistant_360", "tum_vi_double_sphere")
    ),
)
BEARINGS = (-170.0, -97.0, -31.0, 20.0, 76.0, 141.0)
# Along and across the image radius, px.
MARKER_PX = 5.0
SETTINGS = RenderSettings(PerPixel(), samples=4, face_samples=4, texels_per_px=4.0)


@pytest.fixture(params=FILES, ids=lambda file: file.name)
def file(request: pytest.FixtureRequest) -> CameraFile:
    found: CameraFile = request.param
    return found


def read_camera(file: CameraFile, folder: Path, size_px: int) -> OmniCamera:
    """The file's camera, scaled to an image size."""
    camera = carry_camera(file, folder / "robot.ini", size_px=200).camera
    factor = size_px / max(camera.width_px, camera.height_px)
    return replace(
        camera,
        width_px=round(camera.width_px * factor),
        height_px=round(camera.height_px * factor),
        centre_px=(camera.centre_px[0] * factor, camera.centre_px[1] * factor),
        scale_px=camera.scale_px * factor,
    )


def test_rays_in_float32_miss_their_pixels_by_less_than_a_thousandth(
    file: CameraFile, tmp_path: Path
) -> None:
    camera = read_camera(file, tmp_path, 2048)
    u = np.arange(camera.width_px) + 0.5
    v = np.linspace(0.5, camera.height_px - 0.5, 33)
    origin_m, direction, valid = rays_from_pixel_grid(camera, u, v)
    assert valid.sum() > 10_000
    pixel = np.stack(np.meshgrid(u, v), axis=-1)[valid]
    rotation = CAMERA_STATE.world_from_mirror.rotation
    turned = direction[valid].astype(np.float32) @ rotation.T.astype(np.float32)
    back = turned.astype(np.float64) @ rotation
    if origin_m is None:
        # At the antipode, which a lens of 360 degrees shows as a circle, azimuths have no digits.
        has_azimuth = direction[valid][:, 2] > math.cos(math.pi - math.radians(0.2))
        found, known = pixel_from_direction(camera, back)
        error_px = np.linalg.norm(found - pixel, axis=-1)
        assert known[has_azimuth].mean() > 0.99
        assert error_px[known & has_azimuth].max() < 1e-3
        plan = plan_from_settings(SETTINGS, camera, kind=RendererKind.TRACE, reason="test")
        assert error_px[known].max() <= error_bound(camera, plan).geometric.max_px
        return
    start = origin_m[valid].astype(np.float32).astype(np.float64)
    for distance_m in (0.2, 1.0, 5.0):
        found, known = pixel_from_point(camera, (start + distance_m * back)[::7])
        assert known.mean() > 0.99
        assert np.abs(found - pixel[::7])[known].max() < 1e-3


def marker_incidences(camera: OmniCamera) -> tuple[float, ...]:
    """Angles from the axis, 5 degrees to the rim or as much of it as the image shows."""
    first = max(5.0, math.degrees(2.0 * math.atan(camera.projection.t_min)) + 4.0)
    last = math.degrees(camera.rim_rad)
    return (first, *np.linspace(first, last, 7)[1:-1], last - 0.02 * (last - first))


def build_markers(camera: OmniCamera) -> tuple[Floats, World]:
    """Directions of markers that lie in the image as a whole, and their world."""
    wanted = marker_directions(marker_incidences(camera), BEARINGS)
    shown: list[Floats] = []
    pixels: list[Floats] = []
    items: list[Item] = []
    for direction in wanted:
        pixel, valid = pixel_from_direction(camera, direction)
        margin = np.minimum(pixel, (camera.width_px, camera.height_px) - pixel).min()
        t = math.sqrt((1.0 - direction[2]) / (1.0 + direction[2]))
        slope = float(camera.radius_slope_px(np.array(t)))
        radius = float(camera.radius_px_from_t(np.array(t)))
        rim_px = camera.rim_radius_px - radius
        # Next to a cone's apex a mark is an arc, whose centroid lies inside of its middle.
        is_arc = camera.projection.t_min > 0.0 and radius < 12.0 * MARKER_PX
        across = radius / math.hypot(direction[0], direction[1])
        # An ellipse would fit; a disc of the smaller scale is smaller than MARKER_PX in one way.
        diameter_rad = MARKER_PX / max(slope, across)
        is_alone = all(np.linalg.norm(pixel - other) > 3.0 * MARKER_PX for other in pixels)
        if not valid or margin < MARKER_PX or rim_px < MARKER_PX or is_arc or not is_alone:
            continue
        world = marker_world(
            direction[None],
            world_from_mirror=CAMERA_STATE.world_from_mirror,
            diameter_rad=diameter_rad,
        )
        shown.append(direction)
        pixels.append(pixel)
        items.append(replace(world.items[0], name=f"marker {len(items)}"))
    return np.array(shown), World("markers", tuple[Item, ...](items))


def marker_errors_px(
    renderer: Renderer, kind: RendererKind, camera: OmniCamera, directions: Floats
) -> tuple[Floats, float]:
    """Distances of markers' centroids from the camera model's pixels, and the plan's bound."""
    plan = plan_from_settings(SETTINGS, camera, kind=kind, reason="test")
    view = renderer.prepare(camera, plan)
    image = view.render(CAMERA_STATE).rgb
    view.close()
    if camera.is_central:
        expected, _ = pixel_from_direction(camera, directions)
    else:
        expected, _ = pixel_from_point(camera, 2.0 * directions)
    found = np.array([marker_centroid(image, at, window_px=MARKER_PX) for at in expected])
    return np.linalg.norm(found - expected, axis=1), error_bound(camera, plan).marker_error_px


def test_markers_are_traced_at_the_pixels_of_the_model(file: CameraFile, tmp_path: Path) -> None:
    camera = read_camera(file, tmp_path, 400)
    directions, world = build_markers(camera)
    assert len(directions) >= 12
    trace = TraceRenderer(build_scene(world), world, threads=1)
    errors_px, _ = marker_errors_px(trace, RendererKind.TRACE, camera, directions)
    trace.close()
    assert errors_px.max() < 0.1


@pytest.mark.parametrize("file", RASTERED, ids=lambda file: file.name)
def test_markers_are_rastered_at_the_pixels_of_the_model(
    file: CameraFile, tmp_path: Path, device: GlDevice
) -> None:
    camera = read_camera(file, tmp_path, 400)
    directions, world = build_markers(camera)
    spec = OmniCameraSpec(camera, SETTINGS)
    choice = choose_by_settings(spec, RendererKind.RASTER, "", usable=[RendererKind.TRACE])
    if choice.plan.renderer is not RendererKind.RASTER:
        # Texels next to the antipode would be displaced over the whole of its circle.
        assert not camera.is_central or camera.rim_rad == math.pi
        return
    raster = make_raster(device, world)
    errors_px, bound_px = marker_errors_px(raster, RendererKind.RASTER, camera, directions)
    assert errors_px.max() < 0.1
    assert errors_px.max() <= bound_px
