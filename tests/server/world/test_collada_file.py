"""COLLADA files that are hostile: one line each, before memory is taken."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.world.world_description import MeshFile
from helpers.loaded_files import load_mesh_file
from helpers.mesh_file_samples import write_textured_dae

BOMB = '<!DOCTYPE d [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
OUTER = '<node id="{0}"><instance_node url="#{1}"/></node>'
RING = "<library_nodes>" + OUTER.format("x", "y") + OUTER.format("y", "x") + "</library_nodes>"
GEOMETRY = '<instance_geometry url="#g">'


def doubled_nodes(levels: int) -> str:
    """A library in which each node shows the next one twice."""
    twice = '<node id="n{0}"><instance_node url="#n{1}"/><instance_node url="#n{1}"/></node>'
    nodes = "".join(twice.format(n, n + 1) for n in range(levels))
    return f'<library_nodes>{nodes}<node id="n{levels}"/></library_nodes>'


def insert(before: str, text: str) -> Callable[[str], str]:
    return lambda content: content.replace(before, text + before, 1)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (insert("<COLLADA", BOMB), "declares a document type or entities"),
        (
            lambda content: insert("<library_visual_scenes>", RING)(content).replace(
                GEOMETRY, '<instance_node url="#x"/>' + GEOMETRY
            ),
            "its own ancestor|readable mesh file",
        ),
        (
            lambda content: insert("<library_visual_scenes>", doubled_nodes(40))(content).replace(
                GEOMETRY, '<instance_node url="#n0"/>' + GEOMETRY
            ),
            "nodes are too many",
        ),
        (
            insert(
                "</library_materials>",
                "".join(
                    f'<material id="m{n}"><instance_effect url="#e"/></material>'
                    for n in range(10_001)
                ),
            ),
            "more than 10000 materials",
        ),
        (lambda content: content.replace("quarters.png", "../secret.png"), "a file inside"),
        (lambda content: content.replace("0 0 1 1 2 2", "0 0 1 1 9 9"), "readable mesh|triangle"),
        (lambda content: content.replace("<visual_scene", "<visual_scone"), "readable mesh|scene"),
    ],
    ids=["entities", "ring", "doubled", "materials", "outside", "index", "no scene"],
)
def test_hostile_file_is_rejected_in_one_line(
    tmp_path: Path, change: Callable[[str], str], reason: str
) -> None:
    path = write_textured_dae(tmp_path)
    content = path.read_text()
    changed = change(content)
    assert changed != content
    path.write_text(changed)
    with pytest.raises(ConfigError, match=reason) as error:
        load_mesh_file(MeshFile(path))
    assert "\n" not in str(error.value)
