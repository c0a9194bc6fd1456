"""Arrays that the kernel writes labels into, and tiles of rays that belong together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.frames.labels.labels import build_label_rays, make_ray_source
from catoptra_server.render.trace.kernel.exposure_arrays import (
    CentreMatch,
    label_arrays,
    match_centres,
    ray_table_struct,
)
from catoptra_server.render.trace.kernel.library import KernelDevice, KernelUnavailableError
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import LabelRequest, LabelTables
from helpers.labelled_rooms import CAMERAS, SIDE_PX

SOURCE = make_ray_source(CAMERAS["paper"], None, None)
CENTRES = build_label_rays(SOURCE, 1)
TABLES = LabelTables(*(np.zeros(4, dtype=np.uint16) for _ in range(3)))


def match(table: RayTable, centres: RayTable) -> CentreMatch:
    """Match the centres of pixels with the samples of a view."""
    try:
        device = KernelDevice("avx2", 1)
    except KernelUnavailableError as error:
        pytest.skip(str(error))
    view = device.prepare(ray_table_struct(table))
    try:
        return match_centres(device, view, table, centres)
    finally:
        device.release_view(view)
        device.close()


def test_only_wanted_channels_have_an_address() -> None:
    whole = CentreMatch(CENTRES, np.zeros(4, dtype=np.int32), np.zeros(4, dtype=np.uint8))
    request = LabelRequest(frozenset({"range", "ids"}), TABLES, CENTRES)
    arrays, owned = label_arrays(whole, request)
    assert list(arrays) == ["range", "ids"]
    assert arrays["range"].shape == arrays["ids"].shape == (SIDE_PX, SIDE_PX)
    assert owned.struct.range_m == arrays["range"].ctypes.data
    assert owned.struct.normal is None


@pytest.mark.parametrize("samples", [2, 3, 4])
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_proofs_of_whole_tiles_hold_for_the_centres_of_their_pixels(
    camera: OmniCamera, samples: int
) -> None:
    source = make_ray_source(camera, None, None)
    table, centres = build_label_rays(source, samples), build_label_rays(source, 1)
    found = match(table, centres)
    at = found.centre_tile
    assert (centres.tiles[at[at >= 0]] == table.tiles[at >= 0]).all()
    # Every tile of the centres is that of a tile of samples.
    assert set(at[at >= 0]) == set(range(len(centres.tiles)))
    is_whole = (table.valid == 0xFFFF).all(axis=1)
    # All but tiles around the axis of a mirror, whose rays are too wide for a beam.
    assert np.mean(found.is_held[is_whole]) > 0.98


def test_proof_of_a_tile_does_not_hold_for_a_centre_beyond_its_samples() -> None:
    samples = build_label_rays(SOURCE, 2)
    tile = int(np.flatnonzero((samples.valid == 0xFFFF).all(axis=1))[0])
    valid = samples.valid.copy()
    valid[tile] = [1, 0, 0, 0]  # the sample of a corner alone
    whole, part = match(samples, CENTRES), match(replace(samples, valid=valid), CENTRES)
    assert whole.is_held[tile]
    assert not part.is_held[tile]


def test_tiles_without_a_sample_are_an_error() -> None:
    samples = build_label_rays(SOURCE, 2)
    part = replace(
        samples,
        tiles=samples.tiles[:-3],
        directions=samples.directions[:-3],
        valid=samples.valid[:-3],
    )
    with pytest.raises(DomainError, match=r"[123] tiles of pixels' centres have no sample"):
        match(part, CENTRES)
