"""The laser scanner against exact geometry: order, millimetres, limits, noise."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.render.trace.ray_caster import commit_to_reference
from catoptra_server.simulation.robot_description import Mount
from catoptra_server.simulation.sensors import (
    EMPTY_ENVIRONMENT,
    SensorContext,
    SensorEnvironment,
)
from catoptra_server.simulation.sensors.range_scanner import RangeScannerDescription
from catoptra_server.world.scene_mesh import build_scene
from helpers.robots import SCANNER, make_instrument, make_sensor
from helpers.room_ray_caster import context_in_room, make_room_world, oriented_box_at

POSE = Pose.from_rpy((1.0, -0.5, 0.2), (0.0, 0.0, 0.3))


def scan(moment: SensorContext, description: RangeScannerDescription = SCANNER) -> Floats:
    return np.array(make_instrument(description).read(moment).ranges_m)


def exact_ranges(pose: Pose) -> Floats:
    """Ranges in the room by trigonometry of its four walls."""
    origin = pose.transform_points(np.array(SCANNER.mount.position_m))
    yaw = pose.to_rpy()[2] + math.pi / 2 - np.radians(np.arange(181))
    x = (np.copysign(4.0, np.cos(yaw)) - origin[0]) / np.cos(yaw)
    y = (np.copysign(3.0, np.sin(yaw)) - origin[1]) / np.sin(yaw)
    return np.minimum(x, y)


def test_scan_when_without_noise_is_exact() -> None:
    np.testing.assert_allclose(scan(context_in_room(pose=POSE)), exact_ranges(POSE), atol=1e-9)


def test_scan_when_traced_is_exact_to_a_millimetre() -> None:
    caster = commit_to_reference(build_scene(make_room_world()))
    ranges = scan(SensorContext(0.0, 0, POSE, SensorEnvironment(caster)))
    np.testing.assert_allclose(ranges, exact_ranges(POSE), atol=1e-3)


def test_scan_when_a_box_is_on_the_right_is_shorter_in_its_low_half() -> None:
    free, boxed = scan(context_in_room()), scan(context_in_room(oriented_box_at(0.1, 1.5)))
    assert boxed[0] == pytest.approx(1.3)
    assert (boxed[:90] < free[:90]).sum() == (boxed < free).sum() > 5


def test_scan_without_a_surface_reads_the_maximum() -> None:
    assert set(scan(SensorContext(0.0, 0, POSE, EMPTY_ENVIRONMENT))) == {20.0}


def test_scan_when_touching_reads_the_minimum() -> None:
    assert scan(context_in_room(oriented_box_at(0.2, 0.0)))[90] == 0.1


def test_noise_when_configured_has_its_spread_and_follows_the_seed() -> None:
    noisy = dataclasses.replace(SCANNER, noise_m=0.02)
    errors = np.concatenate(
        [scan(context_in_room(pose=POSE, tick=t), noisy) - exact_ranges(POSE) for t in range(20)]
    )
    # 3620 draws: the spread is known to 1.2 %.
    assert np.std(errors) == pytest.approx(0.02, rel=0.05)
    again = make_instrument(noisy).read(context_in_room(pose=POSE, tick=3))
    assert make_instrument(noisy).read(context_in_room(pose=POSE, tick=3)) == again
    assert make_instrument(noisy, seed=2).read(context_in_room(pose=POSE, tick=3)) != again


def test_line_when_sent_has_the_form_of_the_capture() -> None:
    line = line_from_report(make_instrument(SCANNER).read(context_in_room(pose=POSE))).decode()
    head = "SEN {Time 1.00} {Type RangeScanner} {Name Scanner1} {Resolution 0.0174} {FOV 3.1415} "
    assert line.startswith(head + "{Range ")
    assert line.count(",") == 180


def test_configuration_spells_paning_as_ut2004() -> None:
    (part,) = make_sensor(SCANNER).parts
    assert line_from_report(part.configuration()) == (
        b"CONF {Type RangeScanner} {Name Scanner1} {MaxRange 20.0000} {MinRange 0.1000} "
        b"{Resolution 0.0174} {Fov 3.1415} {Paning True} {Tilting False}\r\n"
    )


@pytest.mark.parametrize(
    ("fov_rad", "resolution_rad", "count"),
    [(3.14159, 0.01745, 181), (3.14, 0.157, 21), (4.189, 0.0184, 228), (0.0, 1.0, 1)],
)
def test_scan_of_a_real_scanner_has_its_beams(
    fov_rad: float, resolution_rad: float, count: int
) -> None:
    real = dataclasses.replace(SCANNER, fov_rad=fov_rad, resolution_rad=resolution_rad)
    assert len(scan(context_in_room(), real)) == count


TILTING = dataclasses.replace(
    SCANNER, mount=Mount(), is_panning=False, is_tilting=True, resolution_rad=math.pi / 4
)


def test_tilting_scan_goes_from_the_ceiling_to_the_floor() -> None:
    # 1 m above the centre of a room of 4 m in height and 8 m in length; z is down.
    ranges = scan(context_in_room(pose=Pose.from_rpy((0.0, 0.0, -1.0))), TILTING)
    expected = [1.0, math.sqrt(2.0), 4.0, 3.0 * math.sqrt(2.0), 3.0]
    np.testing.assert_allclose(ranges, expected, atol=1e-9)


def test_scan_without_panning_and_tilting_is_forward_only() -> None:
    still = dataclasses.replace(TILTING, is_tilting=False)
    assert set(scan(context_in_room(), still)) == {4.0}


def test_configuration_of_a_tilting_scanner_reports_it() -> None:
    (part,) = make_sensor(TILTING).parts
    assert b"{Paning False} {Tilting True}" in line_from_report(part.configuration())
