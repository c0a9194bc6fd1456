from __future__ import annotations

import pytest

from catoptra_protocol.optics.cube import Face
from catoptra_server.render.raster.atlas import pack_atlas
from catoptra_server.render.raster.atlas_lookup import atlas_definitions

FIVE = (Face.N, Face.E, Face.S, Face.W, Face.C)


@pytest.mark.parametrize(("faces", "compared"), [(FIVE, 5), ((*FIVE, Face.U), 6)])
def test_upward_face_is_compared_only_where_it_is_drawn(
    faces: tuple[Face, ...], compared: int
) -> None:
    atlas = pack_atlas(faces, size=32, limit_rad=2.4, guard=2, max_texels=1024)
    assert atlas_definitions(atlas) == (("FACES", compared),)
