"""How bodies rest: the kernel computes what its definition in NumPy does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.chassis import shape_chassis
from catoptra_server.simulation.drive import STANDARD_BASES
from catoptra_server.simulation.ground import _box_triangles
from catoptra_server.simulation.kernel_support import KernelSupport
from catoptra_server.simulation.resting import (
    ReferenceSupport,
    Rest,
    Sinking,
    Stance,
    Support,
    make_support,
)
from catoptra_server.simulation.sensors import EmptyScene
from catoptra_server.world.objects import OrientedBox
from helpers.random_drives import NUM_WORLDS, Stage, make_rough_world


@pytest.fixture(scope="module", params=range(NUM_WORLDS))
def stage(request: pytest.FixtureRequest) -> Stage:
    return Stage.of_world(make_rough_world(request.param))


def supports_of(stage: Stage) -> tuple[Support, Support]:
    kernel = make_support(stage.caster)
    assert isinstance(kernel, KernelSupport)
    return ReferenceSupport(stage.caster), kernel


def make_sinking(rng: np.random.Generator) -> Sinking:
    base = STANDARD_BASES[rng.choice(("p2at", "p2dx", "p3at"))]
    number = int(rng.choice((0, 0, 0, 1, 2, 3, 4, 5)))
    x, y, yaw = rng.uniform((-4.0, -4.0, -3.0), (4.0, 4.0, 3.0)).tolist()
    slopes = rng.normal(0.0, 0.2, 2) * (rng.random() < 0.5)
    goal = Stance(x, y, yaw, float(rng.choice((0.0, -0.05, -0.4, 0.3))), *slopes.tolist(), number)
    boxes: tuple[OrientedBox, ...] = ()
    if rng.random() < 0.3:
        where = Pose.from_rpy((x + rng.normal(0, 0.3), y, -0.1), rng.normal(0, 0.1, 3))
        boxes = (OrientedBox(where, (0.5, 0.5, 0.3)),)
    return Sinking(
        shape_chassis(base, 0.8).sides[number],
        goal,
        goal._replace(z_m=goal.z_m + 0.01) if rng.random() < 0.3 else None,
        (0, 0, 0),
        float(rng.choice((0.002, 0.05, math.inf))),
        float(rng.choice((0.0, 0.2))),
        10.0,
        boxes,
        _box_triangles(boxes),
    )


def describe(rest: Rest) -> tuple[object, ...]:
    return rest.touching, rest.is_even, rest.is_on_robot, rest.is_over


def test_kernel_rests_where_its_definition_does(stage: Stage) -> None:
    rng = np.random.default_rng(0)
    reference, kernel = supports_of(stage)
    kinds = set()
    for _ in range(150):
        sinking = make_sinking(rng)
        rests = [one.settle(sinking, lambda _: stage.scene.corners) for one in (reference, kernel)]
        # A step of the search decides between planes that differ by rounding.
        np.testing.assert_allclose(rests[1].stance, rests[0].stance, rtol=0.0, atol=1e-8)
        assert describe(rests[1]) == describe(rests[0])
        assert rests[1].calm_m == pytest.approx(rests[0].calm_m, abs=1e-9)
        kinds.add(describe(rests[0]))
    assert len(kinds) >= 4


def test_kernel_separates_as_its_definition_does(stage: Stage) -> None:
    rng = np.random.default_rng(1)
    reference, kernel = supports_of(stage)
    flat = np.zeros((1, 3, 3)) + np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)))
    triangles = np.concatenate((stage.scene.corners, flat, np.zeros((1, 3, 3))))
    for _ in range(100):
        where = Pose.from_rpy(rng.uniform(-4.0, 4.0, 3), rng.normal(0.0, 1.0, 3))
        half = rng.uniform(0.1, 0.6, 3)
        expected = reference.separations(half, where, triangles)
        np.testing.assert_allclose(
            kernel.separations(half, where, triangles), expected, rtol=0.0, atol=1e-12
        )


def test_scene_without_a_kernel_rests_by_the_definition() -> None:
    assert isinstance(make_support(EmptyScene()), ReferenceSupport)
