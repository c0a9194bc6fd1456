"""Exposures of moving cameras in the kernel: sharp frames, cell by cell and row by row."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import Threshold
from catoptra_server.effects.kernels.grey_levels import measure_change
from catoptra_server.render.trace.kernel.kernel_engine import KernelRays
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_engine import TracedFrame, TraceRequest
from catoptra_server.world.objects import CameraState, Shutter
from helpers.dynamic_objects import build_textured_mesh
from helpers.image_comparison import grey_levels
from helpers.long_cases import quick_cases
from helpers.motion_reference import (
    START_POSES,
    camera_state_after,
    crossing_object,
    driving_camera_state,
    load_world_setup,
    time_samples,
)
from helpers.rolled_rows import (
    SHUTTERS,
    find_row_differences,
    moving_state,
    open_moving_rays,
)
from helpers.standing_things import blend_scene
from helpers.trace_kernels import open_kernel
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=240)
T_S = 1.0 / 30.0
BLUR = Shutter(T_S, 0.0, 64.0)
ROLLING = Shutter(0.0, T_S, 64.0)
BOTH = Shutter(T_S, T_S, 64.0)
THRESHOLDS = dict.fromkeys(("MotionBlur", "RollingShutter"), Threshold(0.5))
START = START_POSES["four_legged_2006"]
STATES = {
    "drives": driving_camera_state(START, 0.5, 30.0),
    "is fast": driving_camera_state(START, 2.0, 0.0),
    "turns": driving_camera_state(START, 0.3, 114.0),
    "passes an object": driving_camera_state(START, 0.5, 30.0, crossing_object(START)),
    "passes a textured object": driving_camera_state(
        START, 0.5, 30.0, replace(crossing_object(START), mesh=build_textured_mesh())
    ),
}


@contextmanager
def open_rays(
    world: str, samples: int, *, threads: int = 2, camera: OmniCamera = CAMERA
) -> Iterator[KernelRays]:
    """Rays of a camera in a bundled world, on a kernel."""
    setup = load_world_setup(world)
    with open_kernel(setup.world, scene=setup.scene, threads=threads) as engine:
        rays = engine.prepare(omni_ray_table(camera, make_plan(camera, samples=samples)))
        yield rays
        rays.close()


@pytest.fixture(scope="module")
def rays() -> Iterator[KernelRays]:
    with open_rays("four_legged_2006", 2) as rays:
        yield rays


def expose(rays: KernelRays, state: CameraState, shutter: Shutter) -> TracedFrame:
    exposed = replace(state, shutter=shutter)
    return rays.render(exposed, TraceRequest(is_linear=True, thresholds=THRESHOLDS))


def mean_frame(rays: KernelRays, state: CameraState, centre_s: float, count: int) -> Floats:
    times = centre_s + time_samples(T_S, count)
    frames = [rays.render_linear(camera_state_after(state, float(t))) for t in times]
    return np.mean([frame.astype(np.float64) for frame in frames], axis=0)


def assert_like(frame: Floats, expected: Floats) -> None:
    difference = np.abs(grey_levels(frame) - grey_levels(expected)).max(axis=-1)
    # Of all pixels, as many off the mirror as at 640 px; edges are 640 / 240 times as frequent.
    assert (difference > 2.0).mean() < 0.01 * 640 / CAMERA.width_px
    assert (difference > 8.0).mean() < 0.001 * 640 / CAMERA.width_px


@pytest.mark.parametrize("name", STATES)
def test_blur_when_drawn_by_cell_is_the_mean_of_64_frames(rays: KernelRays, name: str) -> None:
    frame = expose(rays, STATES[name], BLUR)
    assert_like(frame.image, mean_frame(rays, STATES[name], 0.0, 64))


@pytest.mark.parametrize(
    ("world", "rays_a_tile"),
    # Instants alone took 170 and 136 in the first two; samples of the sharp frame tell the rest.
    # Without what it tells of the lights, the tunnel and the hall took 57 and 87.
    [("rescue", 123), ("warehouse", 92), ("tunnel", 46), ("hall", 63)],
)
def test_blur_of_lit_walls_takes_few_rays_and_is_the_mean_of_64_frames(
    world: str, rays_a_tile: int
) -> None:
    with open_moving_rays(world, CAMERA) as (rays, pose):
        state = moving_state(pose, "0.5 m/s, 0.5 rad/s")
        frame = expose(rays, state, BLUR)
        assert rays.last_counts.num_blur_rays < rays_a_tile * rays.last_counts.num_tiles
        assert_like(frame.image, mean_frame(rays, state, 0.0, 64))


@pytest.mark.parametrize("limit", [4.0, 8.0])
def test_blur_when_more_may_be_left_out_differs_by_no_more_from_blur_everywhere(
    rays: KernelRays, limit: float
) -> None:
    state = driving_camera_state(START, 0.5, 114.0)
    exposed = replace(state, shutter=Shutter(1.0 / 60.0, 0.0, 64.0))
    pictures = []
    for allowed in (-1.0, limit):
        thresholds = {"MotionBlur": Threshold(allowed)}
        frame = rays.render(exposed, TraceRequest(is_linear=True, thresholds=thresholds))
        pictures.append(grey_levels(frame.image))
    assert np.abs(pictures[1] - pictures[0]).max() <= limit


@pytest.mark.parametrize("name", ["drives", "passes an object"])
def test_blur_with_shadows_is_the_mean_of_64_frames(rays: KernelRays, name: str) -> None:
    state = replace(STATES[name], has_shadows=True)
    assert_like(expose(rays, state, BLUR).image, mean_frame(rays, state, 0.0, 64))


def test_blur_when_edges_pass_the_image_in_one_exposure_is_the_mean_of_256_frames(
    rays: KernelRays,
) -> None:
    # 80 px: more than edges are followed for, so that rays take over.
    state = driving_camera_state(START, 6.0, 900.0)
    assert_like(expose(rays, state, BLUR).image, mean_frame(rays, state, 0.0, 256))


def test_blur_beside_a_beacon_is_the_mean_of_64_frames(rays: KernelRays) -> None:
    # Half a metre beside a beacon, which hides and shows the field and the walls behind it.
    start = Pose.from_rpy((1.0, 1.5, -0.3), (0.0, 0.0, 0.1))
    state = driving_camera_state(start, 1.5, 0.0)
    assert_like(expose(rays, state, BLUR).image, mean_frame(rays, state, 0.0, 64))


@pytest.mark.parametrize("name", STATES)
def test_rows_when_read_one_by_one_are_those_of_sharp_frames(rays: KernelRays, name: str) -> None:
    image = expose(rays, STATES[name], ROLLING).image
    for row in range(3, CAMERA.height_px, 19):
        time_s = T_S * ((row + 0.5) / CAMERA.height_px - 0.5)
        sharp = rays.render_linear(camera_state_after(STATES[name], time_s))[row]
        # Poses between two are interpolated: an edge may meet another sample.
        assert (
            np.abs(grey_levels(image[row]) - grey_levels(sharp)).max(axis=-1) > 1.0
        ).mean() < 0.01


def test_rows_when_also_blurred_are_means_about_their_own_times(rays: KernelRays) -> None:
    state = STATES["passes an object"]
    image = expose(rays, state, BOTH).image
    rows = range(5, CAMERA.height_px, 37)
    expected = [
        mean_frame(rays, state, T_S * ((row + 0.5) / CAMERA.height_px - 0.5), 32)[row]
        for row in rows
    ]
    assert_like(image[rows], np.stack(expected))


@pytest.mark.parametrize(
    ("world", "samples", "motion", "has_shadows"),
    [
        # Edges in turns: times within the exposure that are not about its middle show.
        ("four_legged_2006", 2, "turn of 2 rad/s", False),
        ("four_legged_2006", 3, "turn of 2 rad/s", False),
        # Twice as bright as white.
        ("hall", 2, "0.5 m/s, 0.5 rad/s", True),
    ],
)
def test_blurred_rows_are_within_2_and_8_levels_of_64_frames_summed_before_the_well(
    world: str, samples: int, motion: str, has_shadows: bool
) -> None:
    with open_moving_rays(world, CAMERA, samples=samples) as (rays, pose):
        state = moving_state(pose, motion, has_shadows=has_shadows)
        found = find_row_differences(rays, CAMERA, state, SHUTTERS["rolling and blur"])
    assert np.quantile(found, 0.99) <= 2.0
    assert np.quantile(found, 0.999) <= 8.0


@pytest.mark.parametrize("samples", [1, 3, 4])
def test_blur_at_other_numbers_of_samples_is_the_mean_of_64_frames(samples: int) -> None:
    state = driving_camera_state(START_POSES["corridor"], 0.5, 30.0)
    with open_rays("corridor", samples) as rays:
        assert_like(expose(rays, state, BLUR).image, mean_frame(rays, state, 0.0, 64))


def test_exposure_without_motion_is_the_sharp_frame(rays: KernelRays) -> None:
    state = CameraState(START)
    sharp = rays.render_linear(state)
    for shutter in (BLUR, ROLLING, BOTH):
        # Rays in the order of the rows take the steps between samples, by which a texture's level
        # is chosen, from a block beside theirs: 6e-4 on the wood of a shelf (measured); hidden sky
        # is looked up where rays end, rounded otherwise: 1.03e-3 with the AVX2 kernel.
        image = expose(rays, state, shutter).image
        np.testing.assert_allclose(image, sharp, rtol=0.0, atol=2e-3)
        # 0.7 % of the values, 1.4 % with the AVX2 kernel.
        assert (np.abs(image - sharp) > 1e-6).mean() < 0.03


@pytest.mark.parametrize("name", ["is fast", "passes an object"])
def test_blur_of_blended_surfaces_is_the_mean_of_64_frames_by_any_threads(name: str) -> None:
    setup = load_world_setup("four_legged_2006")
    scene, frames = blend_scene(setup.scene), []
    for threads in (1, 2, 3, 4):
        with open_kernel(setup.world, scene=scene, threads=threads) as engine:
            rays = engine.prepare(omni_ray_table(CAMERA, make_plan(CAMERA, samples=2)))
            state = replace(STATES[name], has_shadows=True)
            frames.append(expose(rays, state, BLUR).image)
            if threads == 2:
                assert_like(frames[-1], mean_frame(rays, state, 0.0, 64))
                rows = expose(rays, state, ROLLING).image
                sharp = rays.render_linear(camera_state_after(state, T_S * (100.5 / 240 - 0.5)))
                assert (np.abs(rows[100] - sharp[100]).max(axis=-1) > 4e-3).mean() < 0.01
            rays.close()
    assert all((frame == frames[0]).all() for frame in frames)


def test_exposure_when_traced_by_other_threads_has_the_same_bytes() -> None:
    frames = []
    for threads in (1, 3):
        with open_rays("four_legged_2006", 2, threads=threads) as rays:
            frames.append(expose(rays, STATES["passes an object"], BOTH))
    np.testing.assert_array_equal(frames[0].image, frames[1].image)
    assert frames[0].changes == frames[1].changes


def test_changes_of_blur_are_the_largest_difference_from_the_sharp_frame(rays: KernelRays) -> None:
    state = STATES["drives"]
    frame = expose(rays, state, BLUR)
    difference = np.abs(grey_levels(frame.image) - grey_levels(rays.render_linear(state))).max()
    # The table of the encoding is exact to a hundredth.
    assert frame.changes["MotionBlur"].largest == pytest.approx(difference, abs=0.011)


def test_blur_is_counted_in_every_pixel_that_it_changes_visibly(rays: KernelRays) -> None:
    state = STATES["drives"]
    counted = {"MotionBlur": Threshold(255.0, visible_share=0.999)}
    request = TraceRequest(is_linear=True, thresholds=counted)
    frame = rays.render(replace(state, shutter=BLUR), request)
    expected = measure_change(frame.image, rays.render_linear(state))
    assert 0.01 < expected.visible_share < 0.9
    found = frame.changes["MotionBlur"].visible_share
    assert found == pytest.approx(expected.visible_share, abs=0.001)


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("max_change", [4.0, 8.0, 16.0])
def test_blur_of_less_than_a_pixel_is_stated_where_an_edge_passes_samples(
    samples: int, max_change: float
) -> None:
    # A fifth of a pixel at most, and edges that change a pixel by up to 40 levels.
    state = driving_camera_state(START, 0.02, 0.0)
    request = TraceRequest(is_linear=True, thresholds={"MotionBlur": Threshold(max_change)})
    with open_rays("four_legged_2006", samples) as rays:
        frame = rays.render(replace(state, shutter=BLUR), request)
        everywhere = rays.render_linear(replace(state, shutter=BLUR))
        sharp = rays.render_linear(state)
    left_out = measure_change(frame.image, everywhere).largest
    assert left_out <= max_change
    assert measure_change(everywhere, sharp).largest <= frame.changes["MotionBlur"].largest + 0.011


def test_blur_that_gathered_light_does_not_show_is_stated_where_edges_jump_over_samples() -> None:
    # A tenth of a pixel, along a plain's edge against the sky: few of its samples see a change.
    start = Pose.from_rpy((-73.0, -75.2, -0.6), (0.0, 0.0, -1.9))
    state = driving_camera_state(start, 0.05, 1.2)
    request = TraceRequest(is_linear=True, thresholds={"MotionBlur": Threshold(1.0)})
    with open_rays("airfield", 2, threads=1) as rays:
        alone = rays.render(replace(state, shutter=BLUR), request)
    with open_rays("airfield", 2) as rays:
        frame = rays.render(replace(state, shutter=BLUR), request)
        sharp, mean = rays.render_linear(state), mean_frame(rays, state, 0.0, 64)
    np.testing.assert_array_equal(frame.image, alone.image)
    truth = measure_change(mean, sharp.astype(np.float64)).largest
    assert truth > 3.0
    assert frame.changes["MotionBlur"].largest > 0.75 * truth


def test_motion_that_nobody_sees_is_left_out(rays: KernelRays) -> None:
    # A hundredth of a pixel during the exposure, and edges of 150 grey levels at most.
    state = driving_camera_state(START, 1e-4, 0.0)
    frame = expose(rays, state, BLUR)
    assert frame.changes["MotionBlur"].largest <= 0.5
    assert rays.last_counts.num_blurred_tiles < 0.1 * rays.last_counts.num_tiles


def test_blur_leaves_out_light_that_slopes_evenly() -> None:
    # All of its floor and ceiling changes by some levels from pixel to pixel.
    state = replace(driving_camera_state(START, 0.5, 30.0), shutter=Shutter(0.5 * T_S, 0.0, 64.0))
    with open_rays("warehouse", 2) as rays:
        frame = rays.render(state, TraceRequest(is_linear=True, thresholds=THRESHOLDS))
        counts = rays.last_counts
        everywhere = rays.render_linear(state)
    # In 0.06 of them something may pass between the samples.
    assert counts.num_blurred_tiles < 0.83 * counts.num_tiles
    assert measure_change(frame.image, everywhere).largest <= 0.5


def test_blur_takes_fewer_rays_where_larger_changes_may_be_left_out(rays: KernelRays) -> None:
    state = replace(STATES["drives"], shutter=Shutter(0.5 * T_S, 0.0, 64.0))
    taken = []
    for max_change in (0.5, 16.0):
        thresholds = {"MotionBlur": Threshold(max_change)}
        rays.render(state, TraceRequest(is_linear=True, thresholds=thresholds))
        taken.append(rays.last_counts.num_blur_rays)
    # By the cells that are left out, of which many are gathered from the sharp frame otherwise;
    # with a quarter of the limit hardly by fewer instants.
    assert taken[1] < 0.96 * taken[0]


def test_blur_when_the_budget_allows_two_instants_takes_no_more(rays: KernelRays) -> None:
    expose(rays, STATES["drives"], BLUR)
    free = rays.last_counts.num_blur_rays
    expose(rays, STATES["drives"], replace(BLUR, max_time_samples=2))
    limited = rays.last_counts
    # Both ends of the exposure; its middle is the sharp frame.
    assert limited.num_blur_rays <= 2 * 64 * limited.num_blurred_tiles
    assert limited.num_blur_rays < free


FULL_CAMERA = make_omni_camera(width_px=640)


@pytest.mark.parametrize(
    ("world", "speed_m_s", "turn_deg_s"),
    quick_cases(
        (
            (world, *motion)
            for world in ("four_legged_2006", "corridor")
            for motion in ((0.5, 30.0), (2.0, 0.0), (0.5, 114.0))
        ),
        5,
    ),
)
def test_blur_at_640_px_is_within_2_and_8_levels_of_64_frames(
    world: str, speed_m_s: float, turn_deg_s: float
) -> None:
    start = START_POSES[world]
    state = driving_camera_state(start, speed_m_s, turn_deg_s, crossing_object(start))
    with open_rays(world, 2, camera=FULL_CAMERA) as rays:
        blurred = grey_levels(expose(rays, state, BLUR).image)
        difference = np.abs(blurred - grey_levels(mean_frame(rays, state, 0.0, 64))).max(axis=-1)
    # The mirror, which is pi / 4 of the image; the rest is black in both.
    assert np.quantile(difference, 1.0 - 0.01 * np.pi / 4.0) <= 2.0
    assert np.quantile(difference, 1.0 - 0.001 * np.pi / 4.0) <= 8.0
