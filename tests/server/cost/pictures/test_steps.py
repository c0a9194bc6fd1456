from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.cost.document import Document
from catoptra_server.cost.pictures.steps import MOST, shown
from catoptra_server.cost.step_costs import Drawn

BLACK = np.zeros((4, 4, 3), dtype=np.uint8)


def drawn(document: Document, times: list[float]) -> list[Drawn]:
    step = document.steps[0]
    return [Drawn(replace(step, ms=ms, is_on_front=True), BLACK) for ms in times]


def test_steps_are_those_of_the_front_from_fast_to_exact(document: Document) -> None:
    off = Drawn(replace(document.steps[0], ms=1.0, is_on_front=False), BLACK)
    found = shown([off, *drawn(document, [9.0, 3.0])])
    assert [one.cost.ms for one in found] == [3.0, 9.0]


@pytest.mark.parametrize("count", [1, MOST, MOST + 5])
def test_steps_when_too_many_keep_both_ends(document: Document, count: int) -> None:
    found = [one.cost.ms for one in shown(drawn(document, [float(n) for n in range(count)]))]
    assert len(found) == min(count, MOST)
    assert (found[0], found[-1]) == (0.0, count - 1.0)
