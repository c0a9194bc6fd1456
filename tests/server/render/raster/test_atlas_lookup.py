from __future__ import annotations

import math

import pytest

from catoptra_server.frames.plan.faces import regions_of_size
from catoptra_server.render.projection.atlas import pack_atlas
from catoptra_server.render.raster.mirror_pass import atlas_definitions


@pytest.mark.parametrize(("limit_deg", "compared"), [(125.0, 5), (126.0, 6)])
def test_upward_face_is_compared_only_where_it_is_rendered(limit_deg: float, compared: int) -> None:
    parts = regions_of_size(math.radians(limit_deg), 32)
    atlas = pack_atlas(parts, guard_texels=2, max_texels=1024)
    assert atlas_definitions(atlas) == (("NUM_FACES", compared),)
