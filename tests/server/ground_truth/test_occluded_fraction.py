"""Hidden fractions of objects, against counts of pixels with and without what hides them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.labels import label_renderer as occluded_fraction
from catoptra_server.frames.labels.labels import DrawnExposure
from catoptra_server.render.trace.kernel.library import available_instruction_sets
from catoptra_server.world.world_description import Box, Item, Material
from helpers.labelled_rooms import CAMERAS, ROBOTS, STATE, WORLD, open_labels

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
    with open_labels() as labels:
        alone = labels.render(DrawnExposure(camera, STATE), CHANNELS).channels["ids"]
    world = replace(WORLD, items=(*WORLD.items, screen))
    with open_labels(world=world) as labels:
        drawn = DrawnExposure(camera, STATE)
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
    drawn = DrawnExposure(camera, STATE)
    with open_labels() as labels:
        truth = labels.render(drawn, CHANNELS)
        found = labels.measure_occlusion(drawn, truth)
        alone = DrawnExposure(camera, replace(STATE, objects=ROBOTS[:1]))
        ids = labels.render(alone, CHANNELS).channels["ids"]
    first = labels.labels.number_of(ROBOTS[0])
    seen = (truth.channels["ids"] == first).sum()
    assert (ids == first).sum() == seen
    assert found[first] < 0.1
    assert 0.02 < found[labels.labels.number_of(ROBOTS[1])] < 0.95


def test_fewer_rays_estimate_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = DrawnExposure(CAMERAS["fish-eye"], STATE)
    found = []
    for limit in (4096, 1000):
        monkeypatch.setattr(occluded_fraction, "MAX_RAYS", limit)
        with open_labels() as labels:
            found.append(labels.measure_occlusion(drawn, labels.render(drawn, CHANNELS)))
    for number, fraction in found[0].items():
        assert found[1][number] == pytest.approx(fraction, abs=0.1)


def test_pinned_instruction_set_measures_the_same() -> None:
    drawn = DrawnExposure(CAMERAS["fish-eye"], STATE)
    found = []
    for instruction_set in ("auto", available_instruction_sets()[-1]):
        with open_labels(instruction_set=instruction_set) as labels:
            found.append(labels.measure_occlusion(drawn, labels.render(drawn, CHANNELS)))
    assert found[0].keys() == found[1].keys()
    for number, fraction in found[0].items():
        # Rays along edges alone may differ.
        assert found[1][number] == pytest.approx(fraction, abs=2e-3)
