"""Tables of equals load the modules of what is looked up, and no others."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from catoptra_protocol.lazy_table import LazyTable
from catoptra_protocol.optics import lenses
from catoptra_protocol.optics.lenses import LENSES

PACKAGE = lenses.__name__
PROBE = """
import json, sys
from catoptra_protocol.optics.lenses import LENSES
assert "ocam" in LENSES and "fish" not in LENSES and len([*LENSES]) == len(LENSES)
before = [name for name in LENSES if LENSES._places[name].rpartition(".")[0] in sys.modules]
LENSES["woodscape"]
print(json.dumps([before, [kind.__name__ for kind in LENSES.find_present()]]))
"""


def test_table_when_asked_for_names_loads_nothing_and_for_an_object_its_module() -> None:
    result = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, check=True)
    assert json.loads(result.stdout) == [[], ["WoodScapeLens"]]


def test_object_when_looked_up_by_any_name_is_the_same() -> None:
    assert LENSES["ocam"] is lenses.OCamLens
    assert LENSES.find_name(lenses.OCamLens) == "ocam"
    assert LENSES.find_name(int) is None
    with pytest.raises(KeyError):
        LENSES["fish"]
    with pytest.raises(AttributeError, match="FishLens"):
        LENSES.find_attribute("FishLens")


def test_objects_with_several_names_are_found_once() -> None:
    table = LazyTable(PACKAGE, {"a": "ocam.OCamLens", "b": "ocam.OCamLens"})
    assert [*table.values()] == [lenses.OCamLens] * 2
    assert table.find_present() == [lenses.OCamLens]
