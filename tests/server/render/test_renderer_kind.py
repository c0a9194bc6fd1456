"""Names of renderers."""

from __future__ import annotations

import subprocess
import sys

from catoptra_server.render.renderer_kind import RENDERER_NAMES, RendererKind


def test_names_are_auto_and_every_kind() -> None:
    assert RENDERER_NAMES == ("auto", "trace", "raster")


def test_faces_belong_to_raster_alone() -> None:
    assert [kind for kind in RendererKind if kind.uses_faces] == [RendererKind.RASTER]


def test_names_are_imported_without_numpy() -> None:
    # The doctor's command line reads them on machines where NumPy cannot be imported.
    program = (
        "import sys; import catoptra_server.render.renderer_kind; sys.exit('numpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
