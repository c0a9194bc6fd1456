"""Numbers of connections under limits of open files."""

from __future__ import annotations

import resource

import pytest

from catoptra_server.serve.limits import fit_connections


@pytest.mark.parametrize(
    ("soft_limit", "share", "descriptors_each", "fitting"),
    [
        (1024, 0.25, 1, 64),
        (300, 0.25, 1, 50),
        (300, 0.5, 3, 33),
        (100, 0.25, 1, 1),
        (20, 0.25, 1, 1),
        (resource.RLIM_INFINITY, 0.25, 1, 64),
    ],
)
def test_limit_fits_into_the_share_of_the_descriptors(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    soft_limit: int,
    share: float,
    descriptors_each: int,
    fitting: int,
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (soft_limit, soft_limit))
    limit = fit_connections(64, share=share, descriptors_each=descriptors_each, name="image")
    assert limit == fitting
    assert (f"the image port has {fitting} connections" in caplog.text) is (fitting < 64)
