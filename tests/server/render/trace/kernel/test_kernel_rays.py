"""The rays of a camera: labels beside a picture where its rays can find them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.frames.labels.labels import build_label_rays, make_ray_source
from catoptra_server.render.trace.trace_engine import LabelRequest, LabelTables, TraceRequest
from helpers.labelled_rooms import CAMERAS, SCENE, STATE, WORLD
from helpers.trace_kernels import open_kernel

SOURCE = make_ray_source(CAMERAS["paper"], None, None)
TABLES = LabelTables(
    np.ones(len(SCENE), dtype=np.uint16),
    np.full(len(STATE.objects), 2, dtype=np.uint16),
    np.zeros(2**16, dtype=np.uint16),
)
REQUEST = LabelRequest(frozenset({"ids"}), TABLES, build_label_rays(SOURCE, 1))


def test_picture_is_drawn_where_its_rays_cannot_find_the_labels() -> None:
    samples = build_label_rays(SOURCE, 2)
    part = replace(
        samples,
        tiles=samples.tiles[:-3],
        directions=samples.directions[:-3],
        valid=samples.valid[:-3],
    )
    with open_kernel(WORLD) as engine:
        rays = engine.prepare(part)
        plain = rays.render(STATE, TraceRequest())
        asked = rays.render(STATE, TraceRequest(labels=REQUEST))
        assert asked.labels is None
        assert asked.image.tobytes() == plain.image.tobytes()
        with pytest.raises(DomainError, match="have no sample"):
            rays.label_pixels(STATE, REQUEST)
        rays.close()


def test_labels_are_found_beside_encoded_and_linear_pictures() -> None:
    with open_kernel(WORLD) as engine:
        rays = engine.prepare(build_label_rays(SOURCE, 2))
        alone = rays.label_pixels(STATE, REQUEST)["ids"]
        assert set(np.unique(alone)) == {0, 1, 2}
        for is_linear in (False, True):
            frame = rays.render(STATE, TraceRequest(is_linear=is_linear, labels=REQUEST))
            assert frame.labels is not None
            np.testing.assert_array_equal(frame.labels["ids"], alone)
        rays.close()
