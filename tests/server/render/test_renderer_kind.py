"""Names of renderers, as options of the command lines."""

from __future__ import annotations

import subprocess
import sys

from catoptra_server.render.renderer_kind import INSTRUCTION_SETS, RENDERER_NAMES, RendererKind
from catoptra_server.render.trace.kernel import library as instruction_sets


def test_names_are_auto_and_every_kind() -> None:
    assert RENDERER_NAMES == ("auto", "trace", "raster")


def test_instruction_sets_are_auto_and_those_of_the_kernel() -> None:
    assert INSTRUCTION_SETS == ("auto", *instruction_sets.INSTRUCTION_SETS)


def test_faces_belong_to_raster_alone() -> None:
    assert [kind for kind in RendererKind if kind.uses_faces] == [RendererKind.RASTER]


def test_names_are_imported_without_numpy() -> None:
    # The doctor's command line reads them on machines where NumPy cannot be imported.
    program = (
        "import sys; import catoptra_server.render.renderer_kind; sys.exit('numpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
