"""Mesh files of every format, written by trimesh: one triangle pair or a tetrahedron each."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

# A level square of 2 x 2 m in a file whose z is up: its normal is +z, so SAE's -z.
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
# (0, 0) is the bottom left of an image for trimesh, and here the square's corner (-1, -1).
UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def make_quadrant_image() -> Image.Image:
    """Return a picture of 2 x 2 texels: red, green above blue, white."""
    return Image.fromarray(
        np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], dtype=np.uint8)
    )


def make_plain_square() -> trimesh.Trimesh:
    """Return the square without a look."""
    return trimesh.Trimesh(SQUARE.copy(), FACES, process=False)  # trimesh keeps the array itself


def make_textured_square(*, pbr: bool = False) -> trimesh.Trimesh:
    """Return the square with the picture on it."""
    image = make_quadrant_image()
    material = PBRMaterial(baseColorTexture=image) if pbr else SimpleMaterial(image=image)
    mesh = make_plain_square()
    mesh.visual = TextureVisuals(uv=UV, material=material)
    return mesh


def make_coloured_square() -> trimesh.Trimesh:
    """Return the square with red vertices."""
    mesh = make_plain_square()
    mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile([255, 0, 0, 255], (4, 1)))
    return mesh


def export_mesh(mesh: trimesh.Trimesh, path: Path) -> Path:
    """Write a mesh in the format of the path's ending; return the path."""
    mesh.export(path)
    return path


def write_textured_gltf(folder: Path) -> Path:
    """Write the textured square as glTF: a text file and those that it names."""
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(make_textured_square(pbr=True)))
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return folder / "model.gltf"


def write_gltf_with_image_file(folder: Path, image: str) -> Path:
    """Write the textured square as glTF whose image is a file, which is not written."""
    path = write_textured_gltf(folder)
    document = json.loads(path.read_text(encoding="utf-8"))
    document["images"] = [{"uri": image}]
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def write_tinted_glb(folder: Path, red: int) -> Path:
    """Write the square in a material of one colour (red, 0, 0), no texture."""
    return export_mesh(_make_tinted_square(red), folder / "m.glb")


def write_tinted_dae(folder: Path, red: int) -> Path:
    """Write the square in a material of one colour, no texture coordinates."""
    return export_mesh(_make_tinted_square(red), folder / "m.dae")


def _make_tinted_square(red: int) -> trimesh.Trimesh:
    mesh = make_plain_square()
    material = PBRMaterial(baseColorFactor=np.array([red, 0, 0, 255], dtype=np.uint8))
    mesh.visual = TextureVisuals(uv=UV, material=material)
    return mesh


def write_tinted_obj(folder: Path, red: int) -> Path:
    """Write the square with an MTL file of one colour, no texture coordinates."""
    (folder / "m.mtl").write_text(f"newmtl tint\nKd {red / 255:.3f} 0 0\n")
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in SQUARE)
    faces = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES)
    path = folder / "m.obj"
    path.write_text(f"mtllib m.mtl\n{vertices}usemtl tint\n{faces}")
    return path


def write_textured_dae(folder: Path) -> Path:
    """Write the textured square as COLLADA, which trimesh writes without textures."""
    make_quadrant_image().save(folder / "quarters.png")
    places = " ".join(str(value) for value in SQUARE.ravel())
    uv = " ".join(str(value) for value in UV.ravel())
    corners = " ".join(f"{index} {index}" for index in FACES.ravel())
    path = folder / "m.dae"
    path.write_text(_DAE.format(places=places, uv=uv, corners=corners))
    return path


_DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>quarters.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="p"><sampler2D><source>s</source></sampler2D></newparam>
<technique sid="t"><lambert><diffuse><texture texture="p" texcoord="UV"/></diffuse></lambert>
</technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="v"><float_array id="va" count="12">{places}</float_array><technique_common>
<accessor source="#va" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="u"><float_array id="ua" count="8">{uv}</float_array><technique_common>
<accessor source="#ua" count="4" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="vs"><input semantic="POSITION" source="#v"/></vertices>
<triangles count="2" material="mat"><input semantic="VERTEX" source="#vs" offset="0"/>
<input semantic="TEXCOORD" source="#u" offset="1" set="0"/><p>{corners}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="vis"><node><instance_geometry url="#g"><bind_material>
<technique_common><instance_material symbol="mat" target="#m"/></technique_common></bind_material>
</instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#vis"/></scene></COLLADA>
"""


def make_announcing_png(width: int, height: int) -> bytes:
    """A grey PNG that announces a size and contains no pixel."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        check = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(b"")
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


def write_unlit_glb(folder: Path) -> Path:
    """Write a red square with KHR_materials_unlit beside a green one without, as GLB."""
    path = folder / "m.glb"
    header, binary = _split_glb(export_mesh(_make_two_squares(), path).read_bytes())
    _make_red_material_unlit(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def write_unlit_gltf(folder: Path) -> Path:
    """Write the scene of `write_unlit_glb` as glTF: a text file and those that it names."""
    for name, data in trimesh.exchange.gltf.export_gltf(_make_two_squares()).items():
        (folder / name).write_bytes(data)
    path = folder / "model.gltf"
    header = json.loads(path.read_text())
    _make_red_material_unlit(header)
    path.write_text(json.dumps(header))
    return path


def _make_two_squares() -> trimesh.Scene:
    scene = trimesh.Scene()
    for colour in ((255, 0, 0, 255), (0, 255, 0, 255)):
        mesh = make_plain_square()
        material = PBRMaterial(baseColorFactor=np.array(colour, dtype=np.uint8))
        mesh.visual = TextureVisuals(uv=UV, material=material)
        scene.add_geometry(mesh)
    return scene


def _make_red_material_unlit(header: dict[str, Any]) -> None:
    (red,) = (m for m in header["materials"] if _is_red(m["pbrMetallicRoughness"]))
    red["extensions"] = {"KHR_materials_unlit": {}}
    header["extensionsUsed"] = ["KHR_materials_unlit"]


def _is_red(material: dict[str, Any]) -> bool:
    return bool(material["baseColorFactor"][0] == 1.0)


def _split_glb(data: bytes) -> tuple[dict[str, Any], bytes]:
    """JSON of a GLB file, and the chunk behind the JSON."""
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[20 + length :]
