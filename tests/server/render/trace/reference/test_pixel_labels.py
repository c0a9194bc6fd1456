"""Labels of the two engines agree, with and without a viewpoint, still and moving."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.labels.channels import LABEL_CHANNELS
from catoptra_server.frames.labels.label_renderer import DrawnExposure
from catoptra_server.world.camera_state import INSTANTANEOUS
from catoptra_server.world.world_description import Twist
from helpers.labelled_rooms import CAMERAS, STATE, open_labels

ROLLING = replace(
    STATE,
    twist=Twist((0.5, 0.0, 0.0), (0.0, 0.0, 2.0)),
    shutter=INSTANTANEOUS.with_exposure(0.02, 3.0).with_readout(0.06, 9.0),
)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("state", [STATE, ROLLING], ids=["still", "rolling"])
def test_engines_label_alike(name: str, state) -> None:
    found = []
    for engine in ("kernel", "reference"):
        with open_labels(engine) as labels:
            drawn = DrawnExposure(CAMERAS[name], state, samples=3)
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
    np.testing.assert_array_equal(kernel["valid"], reference["valid"])
