"""The fuzzer itself: it runs, is repeatable, and reports the failing input."""

from __future__ import annotations

import pytest

from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.mirrors import MIRRORS
from conformance.fuzz_parsers import all_targets, fuzz, main
from conformance.fuzz_target import FuzzFailureError, FuzzTarget


def test_fuzz_when_run_with_few_cases_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--cases", "5000", "--seed", "3"]) == 0
    assert "5000 cases, seed 3: no parser failed" in capsys.readouterr().out


def test_fuzz_when_repeated_feeds_the_same() -> None:
    tallies = []
    for _ in range(2):
        targets = all_targets()
        for one in targets:
            one.period = min(one.period, 5)  # so that each has an input that it accepts
        fuzz(targets, 10000, 8, lambda done: None)
        tallies.append([(one.name, one.num_accepted, one.num_rejected) for one in targets])
    assert tallies[0] == tallies[1]
    assert all(accepted for _, accepted, _ in tallies[0])


def test_targets_have_a_camera_of_every_lens_and_mirror() -> None:
    (conf,) = (one for one in all_targets() if one.name == "CONF of a camera")
    kinds = [*(f"{{Lens {name}}}" for name in LENSES), *(f"{{Mirror {name}}}" for name in MIRRORS)]
    assert not [kind for kind in kinds if kind.encode() not in b"".join(conf.seeds)]


def test_fuzz_when_a_parser_fails_names_it_and_the_case() -> None:
    def fragile(data: bytes) -> bool:
        return bool(1 // (b"\xff" not in data))

    with pytest.raises(FuzzFailureError, match=r"fragile, case \d+, b'"):
        fuzz([FuzzTarget("fragile", fragile, (b"seed",))], 2000, 1, lambda done: None)
