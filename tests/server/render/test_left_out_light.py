"""Pictures that leave out baked light or sky, beside those with both."""

from __future__ import annotations

import pytest

from helpers.left_out_light import draw_poses


@pytest.mark.parametrize("world", ["airfield", "incidence_rings", "meadow", "rescue", "warehouse"])
@pytest.mark.parametrize(("max_change", "visible_share"), [(1.0, 1.0), (2.0, 0.01), (170.0, 1.0)])
def test_what_is_left_out_changes_no_picture_by_more_than_allowed(
    world: str,
    max_change: float,
    visible_share: float,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "light"))
    poses = [*draw_poses(world, 3, max_change=max_change, visible_share=visible_share)]
    for pose in poses:
        # Rounded to whole levels.
        assert pose.largest <= max_change + 1.0
        assert pose.visible_share <= visible_share
        for name, contribution in pose.contributions.items():
            assert contribution <= pose.stated(name) + 1.0


@pytest.mark.parametrize(
    ("world", "enabled"),
    [("airfield", set()), ("warehouse", {"BakedLight"}), ("meadow", {"BakedLight", "SkyRadiance"})],
)
def test_light_is_on_in_one_shipped_world_and_left_out_in_another(
    world: str,
    enabled: set[str],
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "light"))
    for pose in draw_poses(world, 3):
        assert {name for name, one in pose.decisions.items() if one.enabled} == enabled
