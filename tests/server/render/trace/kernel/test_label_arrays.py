"""Arrays that the kernel writes labels into."""

from __future__ import annotations

import numpy as np

from catoptra_server.ground_truth.label_rays import build_label_rays, make_ray_source
from catoptra_server.render.trace.kernel.label_arrays import agreement_arrays, label_arrays
from catoptra_server.render.trace.label_tables import LabelTables
from helpers.labelled_rooms import CAMERAS

TABLE = build_label_rays(make_ray_source(CAMERAS["paper"], None, None), 1)
TABLES = LabelTables(*(np.zeros(4, dtype=np.uint16) for _ in range(3)))


def test_only_wanted_channels_have_an_address() -> None:
    arrays, owned = label_arrays(TABLE, TABLES, {"range", "ids"})
    assert list(arrays) == ["range", "ids"]
    assert np.isinf(arrays["range"]).all()
    assert owned.struct.range_m == arrays["range"].ctypes.data
    assert owned.struct.normal is None


def test_samples_are_compared_with_ids_in_rows() -> None:
    ids = np.arange(96 * 96, dtype=np.uint16).reshape(96, 96)
    arrays, owned = agreement_arrays(TABLE, TABLES, ids.T)
    assert owned.struct.agreement == arrays["agreement"].ctypes.data
    # A view is copied: the kernel reads rows without gaps.
    assert owned.struct.expected != ids.ctypes.data
