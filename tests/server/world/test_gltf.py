"""glTF files that are damaged or hostile: one line each, before memory is taken."""

from __future__ import annotations

import base64
import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import ConfigError
from catoptra_server.runtime.memory import MIB, MemoryBudget
from catoptra_server.world.mesh_files import load_mesh_lights
from catoptra_server.world.world_description import MeshFile
from helpers.loaded_files import load_mesh_file
from helpers.mesh_features import Gltf, pbr, png
from helpers.mesh_file_samples import make_announcing_png

HUGE_IMAGE = make_announcing_png(13_300, 13_300)
DATA_URI = "data:image/png;base64," + base64.b64encode(HUGE_IMAGE).decode()


def change(key: str, **keys: Any) -> Callable[[Gltf], None]:
    """Change all entries of a list of the document."""

    def apply(document: Gltf) -> None:
        for entry in document.json[key]:
            entry.update(keys)

    return apply


def announce_zeros(document: Gltf) -> None:
    for accessor in document.json["accessors"]:
        del accessor["bufferView"]
        accessor["count"] = 2**31


def sparse(count: int, row: int) -> Callable[[Gltf], None]:
    def apply(document: Gltf) -> None:
        document.json["accessors"][0]["sparse"] = {
            "count": count,
            "indices": {"bufferView": document.view(bytes([row])), "componentType": 5121},
            "values": {"bufferView": document.view(bytes(12))},
        }

    return apply


def set_nodes(*nodes: dict[str, Any]) -> Callable[[Gltf], None]:
    return lambda document: document.json.update(nodes=list(nodes))


def use_image(**entry: Any) -> Callable[[Gltf], None]:
    def apply(document: Gltf) -> None:
        document.json.update(materials=[pbr(texture=0)], textures=[{"source": 0}], images=[entry])
        document.primitive["material"] = 0

    return apply


def set_vertex(value: float) -> Callable[[Gltf], None]:
    def apply(document: Gltf) -> None:
        document.attributes["POSITION"] = document.add(np.full((4, 3), value, dtype=np.float32))

    return apply


HOSTILE: dict[str, tuple[Callable[[Gltf], Any], str]] = {
    "accessor of 2^31": (announce_zeros, "fewer or smaller accessors .* MiB"),
    "views of gigabytes": (change("bufferViews", byteLength=2**31), "fewer or smaller .* MiB"),
    "negative count": (change("accessors", count=-1), "at least 0, not -1"),
    "count of true": (change("accessors", count=True), "at least 0, not True"),
    "negative offset": (change("bufferViews", byteOffset=-4), "at least 0, not -4"),
    "view behind its buffer": (change("bufferViews", byteOffset=1000), "ends behind its buffer"),
    "accessor behind its view": (change("accessors", count=100), "too few for an accessor"),
    "stride below a row": (change("bufferViews", byteStride=1), "too few for an accessor"),
    "stride of gigabytes": (change("bufferViews", byteStride=2**40), "too few for an accessor"),
    "unknown component": (change("accessors", componentType=1), "readable mesh file"),
    "unknown type": (change("accessors", type="VEC9"), "VEC9"),
    "index of no vertex": (
        lambda d: d.primitive.update(indices=d.add(np.array([0, 1, 4], np.uint32))),
        "4 vertices has no 4",
    ),
    "sparse row of none": (sparse(1, 7), "has no 7"),
    "sparse rows of gigabytes": (sparse(2**31, 0), "too few for an accessor"),
    "node that is its own child": (set_nodes({"mesh": 0, "children": [0]}), "node 0 .* ancestor"),
    "two nodes in a ring": (
        set_nodes({"mesh": 0, "children": [1]}, {"children": [0]}),
        "node 0 .* ancestor",
    ),
    "node of two parents": (
        set_nodes({"children": [1, 1]}, {"mesh": 0}),
        "node 1 has two parents",
    ),
    "a chain of nodes that overflows": (
        set_nodes(*({"children": [n + 1], "scale": [9e9] * 3} for n in range(99)), {"mesh": 0}),
        "position of node .* no number",
    ),
    "too many nodes": (set_nodes(*[{}] * 300_000), "300000 nodes, and at most 200000"),
    "position that is no number": (
        set_nodes({"mesh": 0, "translation": [float("nan"), 0, 0]}),
        "position of node 0 is no number",
    ),
    "matrix of three numbers": (set_nodes({"mesh": 0, "matrix": [1, 2, 3]}), "readable mesh file"),
    "vertices that are no numbers": (set_vertex(float("nan")), "at least one triangle"),
    "vertices without an end": (set_vertex(float("inf")), "at least one triangle"),
    "100 000 materials": (
        lambda d: d.json.update(materials=[{}] * 100_000),
        "100000 materials, and at most 10000",
    ),
    "image of 13 300 px": (use_image(uri=DATA_URI), "Texture='13300 x 13300 px'.* MiB"),
    "image that is none": (use_image(uri="data:image/png;base64,YWJj"), "an image file"),
    "image of a damaged URI": (use_image(uri="data:image/png;base64,a"), "data URI is damaged"),
    "image outside": (use_image(uri="../secret.png"), "a file inside"),
    "image of the system": (use_image(uri="/etc/passwd"), "a file inside"),
    "buffer outside": (
        lambda d: d.json.update(buffers=[{"uri": "../secret.bin", "byteLength": 9}]),
        "buffer ../secret.bin is not a file inside",
    ),
    "strings in place of numbers": (change("accessors", count="4"), "at least 0, not '4'"),
    "lists in place of objects": (lambda d: d.json.update(nodes=[[]]), "readable mesh file"),
    "glTF 1.0": (lambda d: d.json["asset"].update(version="1.0"), "it is glTF 1.0"),
    "no version": (lambda d: d.json.pop("asset"), "asset"),
    "scene of none": (lambda d: d.json.update(scene=4), "readable mesh file"),
    "colours of too few vertices": (
        lambda d: d.attributes.update(COLOR_0=d.add(np.ones((3, 3), np.float32))),
        "COLOR_0 has 3 elements for 4 vertices",
    ),
    "instances of huge number": (
        lambda d: d.json["nodes"][0].update(
            extensions={"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 10**9}}}
        ),
        "readable mesh file",
    ),
}


@pytest.mark.parametrize("name", ["m.glb", "m.gltf"])
@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_file_is_rejected_in_one_line_without_memory(
    tmp_path: Path, case: str, name: str
) -> None:
    (tmp_path / "secret.png").write_bytes(HUGE_IMAGE)
    (tmp_path / "secret.bin").write_bytes(bytes(200))
    folder = tmp_path / "model"
    folder.mkdir()
    document = Gltf()
    apply, reason = HOSTILE[case]
    apply(document)
    if "buffers" in document.json and name == "m.glb":
        pytest.skip("a GLB file has its buffer inside")
    path = document.write(folder, name)
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError, match=reason) as error:
            load_mesh_file(MeshFile(path))
        # Pillow itself, and objects of a JSON of 300 000 nodes.
        assert tracemalloc.get_traced_memory()[1] < 5e6 + 30 * path.stat().st_size
    finally:
        tracemalloc.stop()
    assert "\n" not in str(error.value)


def test_json_that_is_nested_deeply_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "m.gltf"
    path.write_text("[" * 200_000)
    with pytest.raises(ConfigError, match="nested too deeply"):
        load_mesh_file(MeshFile(path))


def test_instances_count_each(tmp_path: Path) -> None:
    document = Gltf()
    moved = document.add(np.zeros((2000, 3), dtype=np.float32))
    document.json["nodes"][0]["extensions"] = {
        "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": moved}}
    }
    path = document.write(tmp_path)
    assert len(load_mesh_file(MeshFile(path))) == 2000
    with pytest.raises(ConfigError, match=r"'mesh 0 of 2 triangles'.*fewer triangles"):
        load_mesh_file(MeshFile(path), MemoryBudget(2 * MIB))


def test_numbers_of_a_material_that_are_none_are_left_out(tmp_path: Path) -> None:
    material = pbr(float("nan"), 2.0, -1.0, emissiveFactor=[float("nan"), 1e30, -1.0])
    document = Gltf(**material)
    normals = np.full((4, 3), float("nan"), dtype=np.float32)
    document.attributes["NORMAL"] = document.add(normals)
    (mesh,) = load_mesh_file(MeshFile(document.write(tmp_path)))
    assert mesh.appearance.albedo[0].tolist() == [0.0, 1.0, 0.0]
    assert mesh.appearance.emission == (0.0, 1e3, 0.0)
    assert mesh.appearance.corner_normals is None


def test_lights_that_are_none_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    document = Gltf()
    lamp = {"type": "point", "intensity": float("nan")}
    document.json["extensions"] = {"KHR_lights_punctual": {"lights": [lamp]}}
    document.json["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    assert load_mesh_lights(MeshFile(document.write(tmp_path))) == []
    assert "it is drawn without its lights" in caplog.text


def test_json_of_a_file_with_lights_is_parsed_once_and_kept_no_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = Gltf()
    document.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    document.json["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    shape, parse, parsed = MeshFile(document.write(tmp_path)), json.loads, list[object]()
    monkeypatch.setattr(json, "loads", lambda text: (parsed.append(text), parse(text))[1])
    for count in (1, 2):
        assert len(load_mesh_lights(shape)) == 1
        load_mesh_file(shape)
        assert len(parsed) == count


def test_nodes_of_one_name_are_several_objects_of_one_class(tmp_path: Path) -> None:
    document = Gltf()
    document.json["nodes"] = [
        {"mesh": 0, "name": "chair"},
        {"mesh": 0, "name": "chair"},
        {"mesh": 0},
    ]
    document.json["scenes"][0]["nodes"] = [0, 1, 2]
    nodes = [mesh.node for mesh in load_mesh_file(MeshFile(document.write(tmp_path)))]
    assert nodes == ["chair", "chair.1", "node2"]


def load_or_error(path: Path) -> str:
    try:
        load_mesh_file(MeshFile(path))
    except ConfigError as error:
        return str(error)
    return ""


JSON_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-3, 9)
    | st.floats(allow_nan=True)
    | st.sampled_from(["VEC3", "SCALAR", "data:,x", "a.png", "MASK"]),
    lambda inner: (
        st.lists(inner, max_size=2)
        | st.dictionaries(
            st.sampled_from(
                "count type componentType byteLength bufferView uri buffer mesh children "
                "attributes POSITION primitives nodes material pbrMetallicRoughness index "
                "baseColorTexture source extensions EXT_mesh_gpu_instancing sparse".split()
            ),
            inner,
            max_size=3,
        )
    ),
    max_leaves=8,
)


@settings(derandomize=True, max_examples=400, deadline=None)
@given(
    st.dictionaries(
        st.sampled_from(
            "accessors bufferViews images buffers nodes scenes meshes materials textures scene "
            "samplers extensions extensionsUsed extensionsRequired animations".split()
        ),
        JSON_VALUES,
        max_size=4,
    )
)
def test_file_when_arbitrary_is_read_or_rejected(
    tmp_path_factory: pytest.TempPathFactory, changes: dict[str, Any]
) -> None:
    document = Gltf()
    path = document.write(tmp_path_factory.getbasetemp())
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    assert "\n" not in load_or_error(path)


def test_materials_of_one_image_and_one_occlusion_share_their_product(tmp_path: Path) -> None:
    dim = pbr(texture=0, occlusionTexture={"index": 0, "strength": 0.5})
    document = Gltf(**dim).texture()
    document.json["materials"].append(dict(dim, doubleSided=True))
    primitives = document.json["meshes"][0]["primitives"]
    primitives.append(dict(primitives[0], material=1))
    first, second = load_mesh_file(MeshFile(document.write(tmp_path)))
    assert first.appearance.texture is second.appearance.texture is not None


def test_opaque_texture_of_a_material_that_blends_is_awaited(tmp_path: Path) -> None:
    image = png(np.full((2048, 2048, 4), 255, dtype=np.uint8))
    document = Gltf(**pbr(texture=0, alphaMode="BLEND")).texture(image)
    (mesh,) = load_mesh_file(MeshFile(document.write(tmp_path)))
    assert not mesh.appearance.blends
