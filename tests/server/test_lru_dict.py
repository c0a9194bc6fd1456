"""A dictionary keeps what was used last."""

from __future__ import annotations

import pytest

from catoptra_server.runtime.memory import LruDict


def test_item_is_made_once() -> None:
    items: LruDict[str, list[int]] = LruDict(2)
    first = items.get_or_make("a", list)
    assert items.get_or_make("a", list) is first
    assert items.get("a") is first
    assert items.get("b") is None
    assert len(items) == 1


def test_item_used_longest_ago_is_removed_and_reported() -> None:
    removed: list[str] = []
    items: LruDict[str, str] = LruDict(2, on_remove=removed.append)
    for key in ("a", "b", "a", "c"):
        items.get_or_make(key, lambda: "made")
    assert removed == ["b"]
    assert items.keys() == ("a", "c")


def test_looking_at_an_item_is_no_use() -> None:
    items: LruDict[str, str] = LruDict(2)
    items.get_or_make("a", str)
    items.get_or_make("b", str)
    items.get("a")
    items.get_or_make("c", str)
    assert items.keys() == ("b", "c")


def test_item_whose_making_fails_leaves_the_others() -> None:
    items: LruDict[str, float] = LruDict(2)
    items.get_or_make("a", float)
    with pytest.raises(ZeroDivisionError):
        items.get_or_make("b", lambda: 1.0 / 0.0)
    assert items.keys() == ("a",)
    items.remove("a")
    items.clear()
    assert len(items) == 0


def test_item_when_set_takes_the_place_of_another_and_counts_as_a_use() -> None:
    removed: list[str] = []
    items: LruDict[str, int] = LruDict(2, on_remove=removed.append)
    items.put("a", 1)
    items.put("b", 2)
    items.put("a", 3)
    assert (items.get("a"), items.get("b"), removed) == (3, 2, [])
    items.put("c", 4)
    assert (items.keys(), removed) == (("a", "c"), ["b"])
