"""Mesh files of one feature each, and the colours that their formats demand.

Every file shows a level square of 2 x 2 m, seen from above, with its normal up. White light of
irradiance 1 comes from all sides, so a surface has the colour of its albedo; what is not covered is
blue. A row names points of the picture, in the axes of a file whose z is up, and their colours; or
the message that names what is not drawn.

Sources: glTF 2.0 with the extensions that rows name; Wavefront OBJ and MTL, appendix B of the
Advanced Visualizer's manual; COLLADA 1.4.1; G. Turk 1994 (PLY); 3D Systems 1989 (STL), its colours
as by Materialise Magics and VisCAM.
"""

from __future__ import annotations

import base64
import io
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from catoptra_server.world.world_description import linear_from_srgb, srgb_from_linear

Colour = tuple[float, float, float]
Point = tuple[float, float]
WHITE, BLACK = (255.0, 255.0, 255.0), (0.0, 0.0, 0.0)
RED, GREEN, YELLOW = (255.0, 0.0, 0.0), (0.0, 255.0, 0.0), (255.0, 255.0, 0.0)
SKY = (0.0, 0.0, 255.0)
"""What is seen where there is no surface."""
WHITE_LIGHT = "(Type=Hemisphere,Up=(R=255,G=255,B=255),Down=(R=255,G=255,B=255))"
CENTRE = (0.02, 0.03)  # beside the square's diagonal
LEFT, RIGHT = (-0.5, 0.03), (0.5, 0.03)
TOP_LEFT, TOP_RIGHT, LOW_LEFT, LOW_RIGHT = (-0.5, 0.5), (0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)


@dataclass(frozen=True)
class Feature:
    """A file of one feature, and what its format demands."""

    name: str
    write: Callable[[Path], Path]
    """Write the file into a folder; its path."""
    colours: dict[Point, Colour] = field(default_factory=dict)
    """Colours of points, sRGB."""
    message: str = ""
    """Part of the message that names what is not drawn."""
    rejection: str = ""
    """Part of the error that a file is rejected with."""
    options: str = "Up=z"
    """Keys of the world's `Meshes`."""
    lights: str = WHITE_LIGHT


def light(*linear: float) -> Colour:
    """sRGB of linear light; one number for grey."""
    r, g, b = 255.0 * srgb_from_linear(np.array(linear * 3 if len(linear) == 1 else linear))
    return float(r), float(g), float(b)


def one(colour: Colour) -> dict[Point, Colour]:
    """One colour all over the square."""
    return {CENTRE: colour, TOP_LEFT: colour, LOW_RIGHT: colour}


SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
# (0, 0) is the top left of an image in glTF; elsewhere it is the bottom left.
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32)
FACES = np.array([0, 1, 2, 0, 2, 3], dtype=np.uint32)
QUARTERS = {TOP_LEFT: RED, TOP_RIGHT: GREEN, LOW_LEFT: YELLOW, LOW_RIGHT: WHITE}


def quarters_image() -> npt.NDArray[np.uint8]:
    """(64, 64, 3) red, green above yellow, white."""
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[:32, :32], image[:32, 32:] = RED, GREEN
    image[32:, :32], image[32:, 32:] = YELLOW, WHITE
    return image


def quarters_with_alpha(alpha: int) -> npt.NDArray[np.uint8]:
    """(64, 64, 4) the same, its left half of an alpha and its right half of 255."""
    image = np.full((64, 64, 4), 255, dtype=np.uint8)
    image[..., :3], image[:, :32, 3] = quarters_image(), alpha
    return image


def png(image: npt.NDArray[np.generic], mode: str = "", kind: str = "PNG") -> bytes:
    """Image file of an array, in a mode of Pillow's."""
    file = io.BytesIO()
    picture = Image.fromarray(image)
    (picture.convert(mode) if mode else picture).save(file, kind)
    return file.getvalue()


QUARTERS_PNG = png(quarters_image())
_TYPES = {"u1": 5121, "i1": 5120, "u2": 5123, "i2": 5122, "u4": 5125, "f4": 5126}


class Gltf:
    """A glTF document that is made piece by piece."""

    def __init__(self, **material: Any) -> None:
        """A square of a material; without any, the square has none."""
        self.data = b""
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {}}]}],
            "accessors": [],
            "bufferViews": [],
        }
        self.primitive = self.json["meshes"][0]["primitives"][0]
        self.attributes = self.primitive["attributes"]
        self.attributes["POSITION"] = self.add(SQUARE)
        self.attributes["TEXCOORD_0"] = self.add(UV)
        self.primitive["indices"] = self.add(FACES)
        if material:
            self.json["materials"] = [material]
            self.primitive["material"] = 0

    def view(self, data: bytes, **keys: Any) -> int:
        """Append bytes to the buffer; the index of their view."""
        self.data += bytes(-len(self.data) % 4)
        offset = len(self.data)
        self.data += data
        entry = {"buffer": 0, "byteOffset": offset, "byteLength": len(data), **keys}
        self.json["bufferViews"].append(entry)
        return len(self.json["bufferViews"]) - 1

    def add(self, array: npt.NDArray[Any], **keys: Any) -> int:
        """Append an array; the index of its accessor."""
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        rows = np.ascontiguousarray(array)
        entry = {
            "bufferView": self.view(rows.tobytes()),
            "componentType": _TYPES[rows.dtype.str[1:]],
            "count": len(rows),
            "type": kind,
            **keys,
        }
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def use(self, *names: str, required: bool = False) -> Gltf:
        """Name extensions that the file uses."""
        self.json.setdefault("extensionsUsed", []).extend(names)
        if required:
            self.json.setdefault("extensionsRequired", []).extend(names)
        return self

    def texture(self, image: bytes = QUARTERS_PNG, **sampler: Any) -> Gltf:
        """Append a texture of an image inside the file."""
        index = len(self.json.setdefault("textures", []))
        entry: dict[str, Any] = {"source": len(self.json.setdefault("images", []))}
        view = self.view(image)
        self.json["images"].append({"bufferView": view, "mimeType": "image/png"})
        if sampler:
            entry["sampler"] = len(self.json.setdefault("samplers", []))
            self.json["samplers"].append(sampler)
        self.json["textures"].append(entry)
        assert index == entry["source"]
        return self

    def square(self, z: float, material: dict[str, Any]) -> Gltf:
        """Append another square at a height."""
        primitive = {
            "attributes": {"POSITION": self.add(SQUARE + np.float32([0, 0, z]))},
            "indices": self.add(FACES),
            "material": len(self.json.setdefault("materials", [])),
        }
        self.json["materials"].append(material)
        self.json["meshes"][0]["primitives"].append(primitive)
        return self

    def write(self, folder: Path, name: str = "m.gltf") -> Path:
        """Write the file: one of text with its buffer inside, or GLB by its name."""
        path = folder / name
        buffer = {"byteLength": len(self.data)}
        if path.suffix == ".glb":
            text = json.dumps({**self.json, "buffers": [buffer]}).encode()
            text += b" " * (-len(text) % 4)
            data = self.data + bytes(-len(self.data) % 4)
            chunks = struct.pack("<I4s", len(text), b"JSON") + text
            chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
            path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
            return path
        if "buffers" not in self.json:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
            self.json["buffers"] = [{"uri": uri, **buffer}]
        path.write_text(json.dumps(self.json))
        return path


def pbr(*factor: float, texture: int | None = None, **keys: Any) -> dict[str, Any]:
    """Material of a base colour factor and a texture, with further keys of glTF's."""
    metal: dict[str, Any] = {"metallicFactor": keys.pop("metallicFactor", 0.0)}
    if factor:
        metal["baseColorFactor"] = [*factor, 1.0][:4]
    if texture is not None:
        metal["baseColorTexture"] = {"index": texture, **keys.pop("info", {})}
    return {"pbrMetallicRoughness": metal, **keys}


FEATURES: list[Feature] = []


def feature(
    name: str, colours: dict[Point, Colour] | None = None, **keys: Any
) -> Callable[[Callable[[Path], Path]], Any]:
    """Add a row of the file that a function writes."""

    def add(write: Callable[[Path], Path]) -> None:
        FEATURES.append(Feature(name, write, colours or {}, **keys))

    return add


def gltf_feature(
    name: str, colours: dict[Point, Colour] | None, make: Callable[[], Gltf], **keys: Any
) -> None:
    """Add a row of a glTF document."""
    feature(f"gltf {name}", colours, **keys)(lambda folder: make().write(folder))


def _plain_materials() -> None:
    add = gltf_feature
    add("base colour is linear", one(light(0.5)), lambda: Gltf(**pbr(0.5, 0.5, 0.5)))
    add("no material is white", one(WHITE), Gltf)
    add("material without a factor is white", one(WHITE), lambda: Gltf(name="m"))
    add("texture", QUARTERS, lambda: Gltf(**pbr(texture=0)).texture())
    tinted = {
        TOP_LEFT: light(0.5, 0, 0),
        TOP_RIGHT: light(0, 0.25, 0),
        LOW_RIGHT: light(0.5, 0.25, 0),
    }
    add("texture times factor", tinted, lambda: Gltf(**pbr(0.5, 0.25, 0, texture=0)).texture())
    for metal, rough in ((1.0, 0.2), (0.0, 0.1), (1.0, 1.0)):
        name = f"metal {metal:g} of roughness {rough:g} in even light"
        material = pbr(0.8, 0.4, 0.2, metallicFactor=metal)
        material["pbrMetallicRoughness"]["roughnessFactor"] = rough
        add(name, one(light(0.8, 0.4, 0.2)), lambda m=material: Gltf(**m))
    add(
        "specular and glossiness",
        one(light(0.5, 0.3, 0.1)),
        lambda: Gltf(
            extensions={
                "KHR_materials_pbrSpecularGlossiness": {
                    "diffuseFactor": [0.5, 0.3, 0.1, 1.0],
                    "specularFactor": [0, 0, 0],
                }
            }
        ).use("KHR_materials_pbrSpecularGlossiness"),
    )
    add(
        "specular in even light",
        one(light(0.4 * 0.75 + 0.25, 0.25, 0.25)),
        lambda: Gltf(
            extensions={
                "KHR_materials_pbrSpecularGlossiness": {
                    "diffuseFactor": [0.4, 0, 0, 1.0],
                    "specularFactor": [0.25, 0.25, 0.25],
                }
            }
        ).use("KHR_materials_pbrSpecularGlossiness"),
    )
    add(
        "texture of specular and glossiness",
        QUARTERS,
        lambda: (
            Gltf(
                extensions={
                    "KHR_materials_pbrSpecularGlossiness": {
                        "diffuseTexture": {"index": 0},
                        "specularFactor": [0, 0, 0],
                    }
                }
            )
            .texture()
            .use("KHR_materials_pbrSpecularGlossiness")
        ),
    )
    add(
        "unlit",
        one(light(0.5)),
        lambda: Gltf(**pbr(0.5, 0.5, 0.5, extensions={"KHR_materials_unlit": {}})).use(
            "KHR_materials_unlit"
        ),
        lights="(Type=Hemisphere,Up=(R=9,G=9,B=9),Down=(R=9,G=9,B=9))",
    )
    add(
        "normal map", None, lambda: Gltf(normalTexture={"index": 0}).texture(), message="normal map"
    )
    for name in ("transmission", "clearcoat", "sheen"):
        extension = f"KHR_materials_{name}"
        add(
            f"{name} is named",
            None,
            lambda e=extension: Gltf(extensions={e: {}}).use(e),
            message=extension,
        )
    add(
        "index of refraction changes nothing",
        one(WHITE),
        lambda: Gltf(extensions={"KHR_materials_ior": {"ior": 1.4}}).use("KHR_materials_ior"),
    )


def _vertex_colours() -> None:
    def coloured(colours: npt.NDArray[Any], image: bool = False, **keys: Any) -> Gltf:
        document = Gltf(**pbr(texture=0 if image else None)).texture()
        document.attributes["COLOR_0"] = document.add(np.tile(colours, (4, 1)), **keys)
        return document

    half = np.float32([[0.5, 0.25, 1.0]])
    add, expected = gltf_feature, one(light(0.5, 0.25, 1.0))
    add("colours of vertices", expected, lambda: coloured(half))
    halves = np.array([[128, 64, 255, 255]])
    by_bytes = one(light(128 / 255, 64 / 255, 1.0))
    add(
        "colours of bytes",
        by_bytes,
        lambda: coloured(halves.astype(np.uint8), normalized=True),
    )
    add(
        "colours of 16 bits",
        by_bytes,
        lambda: coloured((257 * halves).astype(np.uint16), normalized=True),
    )
    add(
        "colours times texture",
        {TOP_LEFT: light(0.5, 0, 0), LOW_RIGHT: light(0.5, 0.25, 1.0)},
        lambda: coloured(half, image=True),
    )

    def varying() -> Gltf:
        document = Gltf()
        colours = np.float32([[0, 0, 0], [1, 1, 1], [1, 1, 1], [0, 0, 0]])
        document.attributes["COLOR_0"] = document.add(colours)
        return document

    add("colours between vertices", {LEFT: light(0.25), RIGHT: light(0.75)}, varying)


def _alpha() -> None:
    add = gltf_feature
    shown = {TOP_LEFT: SKY, LOW_LEFT: SKY, TOP_RIGHT: GREEN, LOW_RIGHT: WHITE}

    def turned(document: Gltf) -> Gltf:
        document.json["nodes"][0]["rotation"] = [1, 0, 0, 0]
        return document

    def textured(alpha: int, **keys: Any) -> Gltf:
        return Gltf(**pbr(texture=0, **keys)).texture(png(quarters_with_alpha(alpha)))

    add("MASK by a texture", shown, lambda: textured(100, alphaMode="MASK"))
    add("MASK keeps what is above the cutoff", QUARTERS, lambda: textured(140, alphaMode="MASK"))
    add(
        "MASK by its own cutoff",
        QUARTERS,
        lambda: textured(100, alphaMode="MASK", alphaCutoff=0.3),
    )
    add("MASK by a factor", one(SKY), lambda: Gltf(**pbr(1, 1, 1, 0.4, alphaMode="MASK")))

    def by_vertices(mode: str) -> Gltf:
        document = Gltf(**pbr(alphaMode=mode))
        colours = np.tile(np.float32([[1, 0, 0, 0.25]]), (4, 1))
        document.attributes["COLOR_0"] = document.add(colours)
        return document

    add("MASK by colours of vertices", one(SKY), lambda: by_vertices("MASK"))
    add(
        "BLEND by a factor",
        one(light(0.4, 0, 0.6)),
        lambda: Gltf(**pbr(1, 0, 0, 0.4, alphaMode="BLEND")),
    )
    add("BLEND by colours of vertices", one(light(0.25, 0, 0.75)), lambda: by_vertices("BLEND"))
    part = 102 / 255
    mixed = {
        TOP_LEFT: light(part, 0, 1 - part),
        LOW_LEFT: light(part, part, 1 - part),
        TOP_RIGHT: GREEN,
    }
    add("BLEND by a texture", mixed, lambda: textured(102, alphaMode="BLEND"))
    add(
        "BLEND over an opaque square",
        one(light(0.5, 0.5, 0.0)),
        lambda: Gltf(**pbr(1, 0, 0, 0.5, alphaMode="BLEND")).square(-0.2, pbr(0, 1, 0)),
    )
    add(
        "BLEND below an opaque square",
        one(GREEN),
        lambda: Gltf(**pbr(1, 0, 0, 0.5, alphaMode="BLEND")).square(0.2, pbr(0, 1, 0)),
    )
    add(
        "BLEND of two layers",
        one(light(0.5, 0.25, 0.25)),
        lambda: Gltf(**pbr(0, 1, 0, 0.5, alphaMode="BLEND")).square(
            0.2, pbr(1, 0, 0, 0.5, alphaMode="BLEND")
        ),
    )

    def stack(top: float, count: int, bottom: dict[str, Any]) -> Gltf:
        """White squares of an opacity, one above the other, over two of a material."""
        document = Gltf(**pbr(1, 1, 1, top, alphaMode="BLEND"))
        for number in range(1, count):
            document.square(0.02 * number, pbr(1, 1, 1, top, alphaMode="BLEND"))
        return document.square(-0.1, bottom).square(-0.2, bottom)

    clear = 0.9**8
    add(
        "BLEND of ten layers shows the nearest eight",
        one(light(1 - clear, 1 - clear, 1.0)),
        lambda: stack(0.1, 8, pbr(1, 0, 0, 0.9, alphaMode="BLEND")),
    )
    add(
        "BLEND of eight layers over what is opaque",
        one(light(1.0, 1 - clear, 1 - clear)),
        lambda: stack(0.1, 8, pbr(1, 0, 0)),
    )
    add(
        "MASK behind BLEND",
        {TOP_LEFT: light(0.5, 0, 0.5), TOP_RIGHT: light(0.5, 0.5, 0.0)},
        lambda: textured(100, alphaMode="MASK").square(0.2, pbr(1, 0, 0, 0.5, alphaMode="BLEND")),
    )
    add(
        "BLEND from behind of two sides",
        one(light(0.4, 0, 0.6)),
        lambda: turned(Gltf(**pbr(1, 0, 0, 0.4, alphaMode="BLEND", doubleSided=True))),
    )
    add(
        "BLEND from behind of one side",
        one(SKY),
        lambda: turned(Gltf(**pbr(1, 0, 0, 0.4, alphaMode="BLEND"))),
    )
    add(
        "BLEND shines",
        one(light(0.5 * 0.75, 0, 0.5)),
        lambda: Gltf(**pbr(0.5, 0, 0, 0.5, alphaMode="BLEND", emissiveFactor=[0.25, 0, 0])),
    )
    unlit = {"KHR_materials_unlit": {}}
    add(
        "BLEND unlit",
        one(light(0.4, 0, 0.6)),
        lambda: Gltf(**pbr(1, 0, 0, 0.4, alphaMode="BLEND", extensions=unlit)).use(*unlit),
    )
    add("BLEND of full opacity", one(RED), lambda: Gltf(**pbr(1, 0, 0, alphaMode="BLEND")))
    add("OPAQUE ignores alpha", QUARTERS, lambda: textured(0))


def _emission() -> None:
    add, dark = gltf_feature, "(Type=Hemisphere,Up=(R=0,G=0,B=0),Down=(R=0,G=0,B=0))"
    add(
        "emission",
        one(light(0.5, 0.2, 0.1)),
        lambda: Gltf(**pbr(1, 1, 1, emissiveFactor=[0.5, 0.2, 0.1])),
        lights=dark,
    )
    add(
        "emission is added to light",
        one(light(0.7, 0.4, 0.3)),
        lambda: Gltf(**pbr(0.2, 0.2, 0.2, emissiveFactor=[0.5, 0.2, 0.1])),
    )
    add(
        "emission of a textured surface",
        {TOP_LEFT: light(0.5, 0.2, 0), TOP_RIGHT: light(0, 0.7, 0)},
        lambda: Gltf(**pbr(0.5, 0.5, 0.5, texture=0, emissiveFactor=[0, 0.2, 0])).texture(),
    )
    add(
        "texture of emission on black",
        QUARTERS,
        lambda: Gltf(
            **pbr(0, 0, 0, emissiveFactor=[1, 1, 1], emissiveTexture={"index": 0})
        ).texture(),
        lights=dark,
    )
    add(
        "texture of emission on a lit surface is named",
        None,
        lambda: Gltf(
            **pbr(0.25, 0.25, 0.25, emissiveFactor=[0.5, 0.5, 0.5], emissiveTexture={"index": 0})
        ).texture(),
        message="texture of emission: surfaces shine in its mean colour",
    )
    add(
        "strength of emission",
        one(light(0.6, 0.2, 0)),
        lambda: Gltf(
            **pbr(
                0,
                0,
                0,
                emissiveFactor=[0.3, 0.1, 0],
                extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 2.0}},
            )
        ).use("KHR_materials_emissive_strength"),
        lights=dark,
    )


def _textures() -> None:
    add = gltf_feature

    def scaled(scale: float, offset: float, **sampler: Any) -> Gltf:
        document = Gltf(**pbr(texture=0)).texture(**sampler)
        document.attributes["TEXCOORD_0"] = document.add((scale * UV + offset).astype(np.float32))
        return document

    # Coordinates from -0.5 to 1.5: the picture is the middle half of the square.
    outer = {(-0.75, 0.25): RED, (0.75, 0.25): GREEN, (-0.75, 0.75): RED, (0.75, -0.75): WHITE}
    add("wrap by clamping", outer, lambda: scaled(2.0, -0.5, wrapS=33071, wrapT=33071))
    mirrored = {(-0.95, 0.25): GREEN, (0.95, 0.25): RED, (-0.25, 0.95): YELLOW}
    # From -1 to 2: the mirrored copies begin at a third of the square's side from its middle.
    add("wrap by mirroring", mirrored, lambda: scaled(3.0, -1.0, wrapS=33648, wrapT=33648))
    repeated = {(-0.75, 0.25): GREEN, (0.75, 0.25): RED, (-0.25, 0.75): YELLOW}
    add("wrap by repeating", repeated, lambda: scaled(2.0, -0.5, wrapS=10497, wrapT=10497))
    mixed = {(-0.75, 0.25): RED, (-0.25, 0.75): YELLOW}
    add("wrap of two kinds", mixed, lambda: scaled(2.0, -0.5, wrapS=33071, wrapT=10497))

    def coarse(**sampler: Any) -> Gltf:
        return Gltf(**pbr(texture=0)).texture(png(quarters_image()[::32, ::32]), **sampler)

    near = {(-0.1, 0.1): RED, (0.1, 0.1): GREEN, (-0.1, -0.1): YELLOW, (0.9, -0.9): WHITE}
    add("nearest filter", near, lambda: coarse(magFilter=9728, minFilter=9728))
    # Pixels are 0.036 m wide: the one beside the middle is half of that from it.
    smooth = {(-0.9, 0.9): RED, (0.018, 0.9): light(0.482, 0.518, 0), (0.9, 0.9): GREEN}
    add("linear filter", smooth, lambda: coarse(magFilter=9729, wrapS=33071, wrapT=33071))

    def transformed(**transform: Any) -> Gltf:
        info = {"extensions": {"KHR_texture_transform": transform}}
        document = Gltf(**pbr(texture=0, info=info)).texture()
        document.attributes["TEXCOORD_1"] = document.add(UV[[1, 2, 3, 0]])
        return document.use("KHR_texture_transform")

    add(
        "transform: offset", {TOP_LEFT: GREEN, TOP_RIGHT: RED}, lambda: transformed(offset=[0.5, 0])
    )
    add("transform: scale", one(RED), lambda: transformed(scale=[0.4, 0.4], offset=[0.05, 0.05]))
    # By a quarter turn: (u, v) becomes (v, -u), which repeats.
    turned = {TOP_LEFT: YELLOW, TOP_RIGHT: RED, LOW_LEFT: WHITE, LOW_RIGHT: GREEN}
    add("transform: rotation", turned, lambda: transformed(rotation=float(np.pi / 2)))
    other = {TOP_LEFT: YELLOW, TOP_RIGHT: RED, LOW_RIGHT: GREEN, LOW_LEFT: WHITE}
    add("transform: other coordinates", other, lambda: transformed(texCoord=1))

    def second() -> Gltf:
        document = Gltf(**pbr(texture=0, info={"texCoord": 1})).texture()
        document.attributes["TEXCOORD_1"] = document.add(UV[[1, 2, 3, 0]])
        return document

    add("second texture coordinates", other, second)

    def shaded() -> Gltf:
        image = np.zeros((8, 8, 3), dtype=np.uint8)
        image[:, :4, 0], image[:, 4:, 0] = 128, 255
        document = Gltf(**pbr(0.5, 0.5, 0.5, occlusionTexture={"index": 0, "strength": 0.5}))
        return document.texture(png(image))

    dim = 0.5 * (0.5 + 0.5 * 128 / 255)
    add("occlusion", {LEFT: light(dim), RIGHT: light(0.5)}, shaded)

    deep = np.full((64, 64), 64 * 257, dtype=np.uint16)
    deep[:, 32:] = 192 * 257
    for name, image, expected in (
        ("palette", png(quarters_image(), "P"), QUARTERS),
        ("16 bits", png(deep), {LEFT: (64.0,) * 3, RIGHT: (192.0,) * 3}),
        ("grey", png(quarters_image()[..., 1]), {TOP_LEFT: BLACK, TOP_RIGHT: WHITE}),
    ):
        add(f"texture of {name}", expected, lambda i=image: Gltf(**pbr(texture=0)).texture(i))

    def webp() -> Gltf:
        file = io.BytesIO()
        Image.fromarray(quarters_image()).save(file, "WEBP", lossless=True)
        document = Gltf(**pbr(texture=0)).texture(file.getvalue())
        document.json["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
        return document.use("EXT_texture_webp", required=True)

    add("texture as WebP", QUARTERS, webp)


def _sides_and_normals() -> None:
    add = gltf_feature
    from_above = "(Type=Hemisphere,Up=(R=255,G=255,B=255),Down=(R=0,G=0,B=0))"
    sun = "(Type=Directional,Direction=(X=0,Y=0,Z=1),Colour=(R=255,G=255,B=255))"

    def turned_over(**material: Any) -> Gltf:
        document = Gltf(**material)
        document.primitive["indices"] = document.add(FACES[::-1].copy())
        return document

    add(
        "back of two sides is lit by its own normal",
        one(light(0.5)),
        lambda: turned_over(**pbr(0.5, 0.5, 0.5, doubleSided=True)),
        lights=from_above,
    )
    add(
        "back of two sides in the sun",
        one(light(0.5)),
        lambda: turned_over(**pbr(0.5, 0.5, 0.5, doubleSided=True)),
        lights=sun,
    )
    add("back of one side is not seen", one(SKY), lambda: turned_over(**pbr(0.5, 0.5, 0.5)))
    add(
        "what is behind the back of one side is seen",
        one(GREEN),
        lambda: turned_over(**pbr(0.5, 0.5, 0.5)).square(-0.2, pbr(0, 1, 0)),
    )

    def with_normals(normals: Any) -> Gltf:
        document = Gltf(**pbr(1, 1, 1))
        values = np.array(normals, dtype=np.float32)
        values /= np.linalg.norm(values, axis=-1, keepdims=True)
        document.attributes["NORMAL"] = document.add(values)
        return document

    tilted = [[0.6, 0, 0.8]] * 4
    add("normals of vertices", one(light(0.8)), lambda: with_normals(tilted), lights=sun)
    add("normals in even light", one(WHITE), lambda: with_normals(tilted))
    bent = [[-0.6, 0, 0.8], [0.6, 0, 0.8], [0.6, 0, 0.8], [-0.6, 0, 0.8]]
    # Half way between middle and edge: (0.3, 0, 0.8) over its length.
    between = light(0.8 / float(np.hypot(0.3, 0.8)))
    add(
        "normals between vertices",
        {(0.0, 0.1): WHITE, LEFT: between, RIGHT: between},
        lambda: with_normals(bent),
        lights=sun,
    )
    lamp = "(Type=Point,Position=(X=0,Y=0,Z=-1),Colour=(R=255,G=255,B=255))"
    add("normals under a lamp", {CENTRE: light(0.8)}, lambda: with_normals(tilted), lights=lamp)


def _geometry() -> None:
    add = gltf_feature
    half, grey = pbr(0.5, 0.5, 0.5), one(light(0.5))

    def plain(change: Callable[[Gltf], Any]) -> Callable[[], Gltf]:
        def make() -> Gltf:
            document = Gltf(**half)
            change(document)
            return document

        return make

    for kind in (np.uint8, np.uint16, np.uint32):
        add(
            f"indices of {np.dtype(kind).name}",
            grey,
            plain(lambda d, k=kind: d.primitive.update(indices=d.add(FACES.astype(k)))),
        )

    def without_indices(document: Gltf) -> None:
        del document.primitive["indices"]
        document.attributes.clear()
        document.attributes["POSITION"] = document.add(SQUARE[FACES])

    add("no indices", grey, plain(without_indices))
    strip = np.array([0, 1, 3, 2], dtype=np.uint16)
    add("triangle strip", grey, plain(lambda d: d.primitive.update(indices=d.add(strip), mode=5)))
    fan = np.array([0, 1, 2, 3], dtype=np.uint16)
    add("triangle fan", grey, plain(lambda d: d.primitive.update(indices=d.add(fan), mode=6)))

    def with_points(document: Gltf) -> None:
        primitives = document.json["meshes"][0]["primitives"]
        primitives.append({"attributes": {"POSITION": document.attributes["POSITION"]}, "mode": 0})

    add("points are named", None, plain(with_points), message="points")

    def stride(document: Gltf) -> None:
        rows = np.zeros((4, 5), dtype=np.float32)
        rows[:, :3], rows[:, 3:] = SQUARE, UV
        view = document.view(rows.tobytes(), byteStride=20)
        for name, offset, kind in (("POSITION", 0, "VEC3"), ("TEXCOORD_0", 12, "VEC2")):
            document.attributes[name] = len(document.json["accessors"])
            entry = {"bufferView": view, "byteOffset": offset, "componentType": 5126}
            document.json["accessors"].append({**entry, "count": 4, "type": kind})

    add("interleaved attributes", grey, plain(stride))

    def sparse(document: Gltf, *, has_view: bool) -> None:
        # Without a view the others are zeros: here the first corner is moved to where it was.
        values = SQUARE + np.float32([0, 0, 0])
        wrong = values.copy()
        wrong[[0, 2]] = 0
        index = document.attributes["POSITION"] = document.add(wrong)
        entry = document.json["accessors"][index]
        rows = [0, 2] if has_view else [0, 1, 2, 3]
        if not has_view:
            del entry["bufferView"]
        entry["sparse"] = {
            "count": len(rows),
            "indices": {"bufferView": document.view(bytes(rows)), "componentType": 5121},
            "values": {"bufferView": document.view(values[rows].tobytes())},
        }

    corners = {(-0.9, -0.9): light(0.5), (0.9, 0.9): light(0.5), **grey}
    add("sparse accessor", corners, plain(lambda d: sparse(d, has_view=True)))
    add("sparse accessor of zeros", corners, plain(lambda d: sparse(d, has_view=False)))

    def instances(document: Gltf) -> None:
        document.json["nodes"][0]["scale"] = [0.5, 0.5, 0.5]
        moved = document.add(np.float32([[-1.0, 1.0, 0], [1.0, -1.0, 0]]))
        half_size = document.add(np.float32([[0.5, 0.5, 1], [0.5, 0.5, 1]]))
        turned = document.add(np.float32([[0, 0, 1, 0], [0, 0, 0, 1]]))
        document.json["nodes"][0]["extensions"] = {
            "EXT_mesh_gpu_instancing": {
                "attributes": {"TRANSLATION": moved, "SCALE": half_size, "ROTATION": turned}
            }
        }
        document.use("EXT_mesh_gpu_instancing", required=True)

    scattered = {TOP_LEFT: light(0.5), LOW_RIGHT: light(0.5), CENTRE: SKY, TOP_RIGHT: SKY}
    add("instances", scattered, plain(instances))

    def quantized(document: Gltf, kind: Any, *, normalized: bool) -> None:
        largest = np.iinfo(kind).max
        rows = np.zeros((4, 4), dtype=kind)
        rows[:, :3] = SQUARE * (largest if normalized else 100)
        size = 4 * rows.itemsize
        index = document.attributes["POSITION"] = len(document.json["accessors"])
        assert index
        document.json["accessors"].append(
            {
                "bufferView": document.view(rows.tobytes(), byteStride=size),
                "componentType": _TYPES[rows.dtype.str[1:]],
                "normalized": normalized,
                "count": 4,
                "type": "VEC3",
            }
        )
        if not normalized:
            document.json["nodes"][0]["scale"] = [0.01, 0.01, 0.01]
        document.use("KHR_mesh_quantization", required=True)

    for kind in (np.int8, np.int16):
        name = np.dtype(kind).name
        edges = {**grey, (1.2, 0.0): SKY}
        add(
            f"quantized positions of {name}",
            edges,
            plain(lambda d, k=kind: quantized(d, k, normalized=False)),
        )
        add(
            f"quantized fractions of {name}",
            edges,
            plain(lambda d, k=kind: quantized(d, k, normalized=True)),
        )

    def quantized_uv() -> Gltf:
        document = Gltf(**pbr(texture=0)).texture()
        fractions = (65535 * UV).astype(np.uint16)
        document.attributes["TEXCOORD_0"] = document.add(fractions, normalized=True)
        return document.use("KHR_mesh_quantization", required=True)

    add("quantized texture coordinates", QUARTERS, quantized_uv)


def _nodes() -> None:
    add, half = gltf_feature, pbr(0.5, 0.5, 0.5)
    there = {(1.2, 0.0): light(0.5), (-0.9, 0.0): SKY}

    def placed(*nodes: dict[str, Any], roots: tuple[int, ...] = (0,), **material: Any) -> Gltf:
        document = Gltf(**(material or half))
        document.json["nodes"], document.json["scenes"] = list(nodes), [{"nodes": list(roots)}]
        return document

    add("translation", there, lambda: placed({"mesh": 0, "translation": [0.5, 0, 0]}))
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.5, 0, 0, 1]
    add("matrix", there, lambda: placed({"mesh": 0, "matrix": matrix}))
    parent = {"children": [1], "scale": [0.5, 0.5, 0.5]}
    child = {"mesh": 0, "translation": [1, 0, 0], "scale": [2, 2, 2]}
    add("child of a scaled node", there, lambda: placed(parent, child))
    turn = {"children": [1], "rotation": [0, 0, 1, 0]}
    add(
        "child of a turned node",
        there,
        lambda: placed(turn, {"mesh": 0, "translation": [-0.5, 0, 0]}),
    )
    add("mirrored node faces up", one(light(0.5)), lambda: placed({"mesh": 0, "scale": [-1, 1, 1]}))
    add(
        "node of no scene is not drawn",
        one(light(0.5)),
        lambda: placed({"mesh": 0}, {"mesh": 0, "translation": [0, 0, 0.5]}),
    )

    def second_scene() -> Gltf:
        document = placed({"mesh": 0}, {"mesh": 0, "translation": [0.5, 0, 0]})
        document.json.update(scenes=[{"nodes": [0]}, {"nodes": [1]}], scene=1)
        return document

    add("second scene", there, second_scene)
    # y is up: the square stands, its normal towards +z, and is seen as a line from above; turned
    # about x by -90 degrees it lies.
    lie = {"mesh": 0, "rotation": [-(0.5**0.5), 0, 0, 0.5**0.5]}
    add("y is up", one(light(0.5)), lambda: placed(lie), options="Scale=1")

    def skinned() -> Gltf:
        document = Gltf(**half)
        document.json["skins"] = [{"joints": [0]}]
        document.json["nodes"][0]["skin"] = 0
        return document

    add("skin is named", None, skinned, message="skin")

    def morphed() -> Gltf:
        document = Gltf(**half)
        document.primitive["targets"] = [{"POSITION": document.add(SQUARE)}]
        document.json["meshes"][0]["weights"] = [0.5]
        return document

    add("morph targets are named", None, morphed, message="morph")

    def animated() -> Gltf:
        document = Gltf(**half)
        document.json["animations"] = [{"channels": [], "samplers": []}]
        return document

    add("animation is named", one(light(0.5)), animated, message="animation")


def _lamps() -> None:
    add = gltf_feature
    dark = "(Type=Hemisphere,Up=(R=0,G=0,B=0),Down=(R=0,G=0,B=0))"

    def lamp(kind: str, node: dict[str, Any], **keys: Any) -> Gltf:
        document = Gltf(**pbr(0.8, 0.8, 0.8))
        document.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": kind, **keys}]}}
        extension = {"extensions": {"KHR_lights_punctual": {"light": 0}}}
        document.json["nodes"].append({**node, **extension})
        document.json["scenes"][0]["nodes"].append(1)
        return document.use("KHR_lights_punctual")

    # A Lambertian surface of albedo a has the luminance a E / pi; lights shine along -z.
    add(
        "directional light",
        one(light(0.8 * 0.5, 0.8 * 0.25, 0)),
        lambda: lamp("directional", {}, color=[1, 0.5, 0], intensity=0.5 * float(np.pi)),
        lights=dark,
    )
    add(
        "directional light of a turned node",
        one(light(0.8 * 0.5 * 0.5)),
        lambda: lamp(
            "directional", {"rotation": [0.5, 0, 0, 0.75**0.5]}, intensity=0.5 * float(np.pi)
        ),
        lights=dark,
    )
    add(
        "point light",
        {CENTRE: light(0.8 * 0.5)},
        lambda: lamp("point", {"translation": [0, 0, 2]}, intensity=2 * float(np.pi)),
        lights=dark,
    )
    add("spot light is named", None, lambda: lamp("spot", {}, spot={}), message="spot")


def _files() -> None:
    add, half = feature, pbr(0.5, 0.5, 0.5)
    grey = one(light(0.5))
    add("glb", grey)(lambda folder: Gltf(**half).write(folder, "m.glb"))
    add("glb texture", QUARTERS)(
        lambda folder: Gltf(**pbr(texture=0)).texture().write(folder, "m.glb")
    )

    def with_image(folder: Path, name: str, uri: str, **keys: Any) -> Path:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(QUARTERS_PNG)
        document = Gltf(**pbr(texture=0))
        document.json.update(images=[{"uri": uri, **keys}], textures=[{"source": 0}])
        return document.write(folder)

    add("gltf image beside it", QUARTERS)(lambda folder: with_image(folder, "q.png", "q.png"))
    add("gltf percent-encoded name", QUARTERS)(
        lambda folder: with_image(folder, "my q ä.png", "my%20q%20%C3%A4.png")
    )
    add("gltf image as a data URI", QUARTERS)(
        lambda folder: with_image(
            folder, "q", "data:image/png;base64," + base64.b64encode(QUARTERS_PNG).decode()
        )
    )

    def with_buffer(folder: Path, name: str, uri: str) -> Path:
        document = Gltf(**half)
        (folder / name).write_bytes(document.data)
        document.json["buffers"] = [{"uri": uri, "byteLength": len(document.data)}]
        return document.write(folder)

    add("gltf buffer beside it", grey)(lambda folder: with_buffer(folder, "m.bin", "m.bin"))
    add("gltf buffer of a percent-encoded name", grey)(
        lambda folder: with_buffer(folder, "a b.bin", "a%20b.bin")
    )
    gltf_feature(
        "unknown required extension",
        None,
        lambda: Gltf().use("VENDOR_magic", required=True),
        rejection="VENDOR_magic",
    )
    gltf_feature(
        "compressed meshes",
        None,
        lambda: Gltf().use("KHR_draco_mesh_compression", required=True),
        rejection="KHR_draco_mesh_compression",
    )
    gltf_feature(
        "unknown extension in use",
        one(WHITE),
        lambda: Gltf().use("VENDOR_magic"),
        message="VENDOR_magic",
    )

    def missing(folder: Path) -> Path:
        document = Gltf(**pbr(texture=0, name="brick"))
        document.json.update(images=[{"uri": "none.png"}], textures=[{"source": 0}])
        return document.write(folder)

    add("gltf missing texture", rejection="none.png.*brick|brick.*none.png")(missing)
    add("gltf missing texture as grey", one(light(0.5)), options="Up=z,MissingTextures=grey")(
        missing
    )


_OBJ_FACES = "f 1/1/1 2/2/2 3/3/3\nf 1/1/1 3/3/3 4/4/4\n"


def _obj(
    folder: Path,
    mtl: str = "",
    *,
    faces: str = _OBJ_FACES,
    normals: str = "vn 0 0 1\n" * 4,
    vertices: str = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n",
    head: str = "mtllib m.mtl\n",
    use: str = "usemtl m\n",
    encoding: str = "utf-8",
) -> Path:
    (folder / "m.mtl").write_text("newmtl m\n" + mtl, encoding=encoding)
    uv = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    path = folder / "m.obj"
    path.write_text(head + vertices + uv + normals + use + faces, encoding=encoding)
    return path


def _image(folder: Path, name: str = "q.png", data: bytes = QUARTERS_PNG) -> Path:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data)
    return folder


def _gazebo(folder: Path) -> Path:
    """Folder of the meshes of a model whose textures lie beside that folder."""
    _image(folder / "model", "materials/textures/q.png")
    meshes = folder / "model" / "meshes"
    meshes.mkdir()
    return meshes


def _objs() -> None:
    add = feature
    add("obj Kd is sRGB", one((128, 64, 0)))(lambda f: _obj(f, "Kd 0.50196 0.25098 0\n"))
    add("obj Kd 0.4", one((102, 102, 102)))(lambda f: _obj(f, "Kd 0.4 0.4 0.4\n"))
    add("obj material without Kd is mid-grey", one(light(0.5)))(lambda f: _obj(f, "Ns 10\n"))
    add("obj without materials is mid-grey", one(light(0.5)))(lambda f: _obj(f, head="", use=""))
    add("obj map_Kd", QUARTERS)(lambda f: _obj(_image(f), "map_Kd q.png\n"))
    tinted = {TOP_LEFT: (128.0, 0.0, 0.0), LOW_RIGHT: (128.0,) * 3}
    add("obj map_Kd times Kd", tinted)(
        lambda f: _obj(_image(f), "Kd 0.50196 0.50196 0.50196\nmap_Kd q.png\n")
    )
    spaced = "obj map_Kd of a name with spaces"
    add(spaced, QUARTERS)(lambda f: _obj(_image(f, "my q.png"), "map_Kd my q.png\n"))
    add("obj map_Kd -o", {TOP_LEFT: GREEN, TOP_RIGHT: RED})(
        lambda f: _obj(_image(f), "map_Kd -o 0.5 0 0 q.png\n")
    )
    twice = {(-0.75, 0.75): RED, (-0.25, 0.75): GREEN, (0.25, 0.25): YELLOW, (0.75, 0.25): WHITE}
    add("obj map_Kd -s", twice)(lambda f: _obj(_image(f), "map_Kd -s 2 2 1 -mm 0 1 q.png\n"))
    add("obj map_Kd -clamp", {(-0.75, 0.25): RED, (0.75, 0.25): GREEN})(
        lambda f: _obj(_image(f), "map_Kd -clamp on -s 2 2 1 -o -0.5 -0.5 0 q.png\n")
    )
    add("obj path of Windows", QUARTERS)(
        lambda f: _obj(_image(f, "textures/q.png"), "map_Kd textures\\q.png\n")
    )
    add("obj absolute path of Windows", QUARTERS)(
        lambda f: _obj(_image(f), "map_Kd C:\\art\\q.png\n")
    )
    add("obj name of another case", QUARTERS)(lambda f: _obj(_image(f), "map_Kd Q.PNG\n"))
    add("obj textures of Gazebo's models", QUARTERS)(
        lambda f: _obj(_gazebo(f), "map_Kd ../materials/textures/q.png\n")
    )
    add("obj Latin-1", one((128, 64, 0)))(
        lambda f: _obj(
            f, "# Stühle\nKd 0.50196 0.25098 0\n", head="# é\nmtllib m.mtl\n", encoding="latin-1"
        )
    )
    add("obj keywords of capital letters", one((128, 64, 0)))(
        lambda f: _obj(f, "KD 0.50196 0.25098 0\n")
    )
    for key, value in (("d", 0.4), ("Tr", 0.6), ("d -halo", 0.4)):
        add(f"obj {key}", one(light(0.4, 0, 0.6)))(
            lambda f, k=key, v=value: _obj(f, f"Kd 1 0 0\n{k} {v}\n")
        )
    alpha = png(quarters_with_alpha(0)[..., 3])
    add("obj map_d", {LEFT: SKY, RIGHT: RED})(
        lambda f: _obj(_image(f, "a.png", alpha), "Kd 1 0 0\nmap_d a.png\n")
    )
    add("obj map_d with map_Kd", {TOP_LEFT: SKY, TOP_RIGHT: GREEN})(
        lambda f: _obj(_image(_image(f, "a.png", alpha)), "map_Kd q.png\nmap_d a.png\n")
    )
    add("obj Ke", one(light(0.7, 0.2, 0.2)))(
        lambda f: _obj(f, "Kd 0.48453 0.48453 0.48453\nKe 0.73536 0 0\n")
    )
    sun = "(Type=Directional,Direction=(X=0,Y=0,Z=1),Colour=(R=255,G=255,B=255))"
    add("obj vn", one(light(0.8)), lights=sun)(
        lambda f: _obj(f, "Kd 1 1 1\n", normals="vn 0.6 0 0.8\n" * 4)
    )
    add("obj bump map is named", message="bump")(
        lambda f: _obj(_image(f), "Kd 1 1 1\nmap_Bump q.png\n")
    )
    add("obj quadrilateral", one((128, 128, 128)))(
        lambda f: _obj(f, "Kd 0.50196 0.50196 0.50196\n", faces="f 1/1/1 2/2/2 3/3/3 4/4/4\n")
    )
    add("obj indices from the end", one((128, 128, 128)))(
        lambda f: _obj(f, "Kd 0.50196 0.50196 0.50196\n", faces="f -4 -3 -2\nf -4 -2 -1\n")
    )
    add("obj continued line", one((128, 128, 128)))(
        lambda f: _obj(f, "Kd 0.50196 0.50196 0.50196\n", faces="f 1 2 \\\n3\nf 1 3 4\n")
    )
    two = "Kd 1 0 0\nnewmtl n\nKd 0 1 0\n"
    add("obj two materials", {RIGHT: RED, LEFT: GREEN})(
        lambda f: _obj(f, two, faces="f 1 2 3\nusemtl n\nf 1 3 4\n")
    )
    add("obj material of two libraries", one((128, 128, 128)))(
        lambda f: _obj(
            _image(f, "n.mtl", b"newmtl n\nKd 0.50196 0.50196 0.50196\n"),
            head="mtllib m.mtl n.mtl\n",
            use="usemtl n\n",
        )
    )
    vertices = "v -1 -1 0 1 0 0\nv 1 -1 0 1 0 0\nv 1 1 0 1 0 0\nv -1 1 0 1 0 0\n"
    add("obj colours of vertices", one(RED))(
        lambda f: _obj(f, head="", use="", vertices=vertices, faces="f 1 2 3\nf 1 3 4\n")
    )
    add("obj missing texture", rejection="none.png")(lambda f: _obj(f, "map_Kd none.png\n"))
    add("obj missing library", rejection="none.mtl")(lambda f: _obj(f, head="mtllib none.mtl\n"))
    add("obj missing texture as grey", one(light(0.5)), options="Up=z,MissingTextures=grey")(
        lambda f: _obj(f, "map_Kd none.png\n")
    )


def _dae(
    folder: Path,
    shading: str = "<diffuse><color>0.50196 0.25098 0 1</color></diffuse>",
    *,
    asset: str = '<unit meter="1"/><up_axis>Z_UP</up_axis>',
    places: npt.NDArray[Any] = SQUARE,
    image: str = "q.png",
    node: str = "",
    instance: str = "{geometry}",
    library: str = "",
    normals: str = "0 0 1",
) -> Path:
    geometry = (
        '<instance_geometry url="#g"><bind_material><technique_common>'
        '<instance_material symbol="mat" target="#m"/></technique_common></bind_material>'
        "</instance_geometry>"
    )
    text = _DAE.format(
        asset=asset,
        image=image,
        shading=shading,
        places=" ".join(map(str, places.ravel().tolist())),
        normals=" ".join([normals] * 4),
        node=node + instance.format(geometry=geometry),
        library=library.format(geometry=geometry),
    )
    path = folder / "m.dae"
    path.write_text(text)
    return path


_DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>{asset}</asset>
<library_images><image id="i"><init_from>{image}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="p"><sampler2D><source>s</source></sampler2D></newparam>
<technique sid="t"><lambert>{shading}</lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m" name="paint"><instance_effect url="#e"/></material>
</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="v"><float_array id="va" count="12">{places}</float_array><technique_common>
<accessor source="#va" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="n"><float_array id="na" count="12">{normals}</float_array><technique_common>
<accessor source="#na" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="u"><float_array id="ua" count="8">0 0 1 0 1 1 0 1</float_array><technique_common>
<accessor source="#ua" count="4" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="vs"><input semantic="POSITION" source="#v"/></vertices>
<triangles count="2" material="mat"><input semantic="VERTEX" source="#vs" offset="0"/>
<input semantic="NORMAL" source="#n" offset="0"/>
<input semantic="TEXCOORD" source="#u" offset="0" set="0"/><p>0 1 2 0 2 3</p></triangles>
</mesh></geometry></library_geometries>
{library}
<library_visual_scenes><visual_scene id="vis"><node id="top">{node}</node></visual_scene>
</library_visual_scenes>
<scene><instance_visual_scene url="#vis"/></scene></COLLADA>
"""
_DAE_TEXTURE = '<diffuse><texture texture="p" texcoord="UV"/></diffuse>'


def _daes() -> None:
    add, brown = feature, one((128.0, 64.0, 0.0))
    edges = {**brown, (1.2, 0.0): SKY, (0.9, 0.9): (128.0, 64.0, 0.0)}
    add("dae diffuse is sRGB", brown)(_dae)
    add("dae diffuse 0.4", one((102, 102, 102)))(
        lambda f: _dae(f, "<diffuse><color>0.4 0.4 0.4 1</color></diffuse>")
    )
    add("dae texture", QUARTERS)(lambda f: _dae(_image(f), _DAE_TEXTURE))
    add("dae percent-encoded name", QUARTERS)(
        lambda f: _dae(_image(f, "my q.png"), _DAE_TEXTURE, image="my%20q.png")
    )
    add("dae URI of a file", QUARTERS)(
        lambda f: _dae(_image(f), _DAE_TEXTURE, image="file:///C:/art/q.png")
    )
    add("dae textures of Gazebo's models", QUARTERS)(
        lambda f: _dae(_gazebo(f), _DAE_TEXTURE, image="../materials/textures/q.png")
    )
    add("dae bare name of Gazebo's textures", QUARTERS)(lambda f: _dae(_gazebo(f), _DAE_TEXTURE))
    metres = '<unit meter="{}"/><up_axis>{}</up_axis>'
    add("dae unit of centimetres", edges)(
        lambda f: _dae(f, asset=metres.format(0.01, "Z_UP"), places=100 * SQUARE)
    )
    add("dae unit times scale", edges, options="Scale=2")(
        lambda f: _dae(f, asset=metres.format(0.01, "Z_UP"), places=50 * SQUARE)
    )
    add("dae without an asset has y up", brown, options="Scale=1")(
        lambda f: _dae(f, asset="", places=SQUARE[:, [0, 2, 1]] * [1, 1, -1])
    )
    add("dae Y_UP", brown, options="Scale=1")(
        lambda f: _dae(f, asset=metres.format(1, "Y_UP"), places=SQUARE[:, [0, 2, 1]] * [1, 1, -1])
    )
    add("dae X_UP", brown, options="Scale=1")(
        lambda f: _dae(f, asset=metres.format(1, "X_UP"), places=SQUARE[:, [2, 0, 1]])
    )
    add("dae Z_UP", brown, options="Scale=1")(_dae)
    add("dae emission", one(light(0.7, 0.2, 0.2)))(
        lambda f: _dae(
            f,
            "<emission><color>0.73536 0 0 1</color></emission>"
            "<diffuse><color>0.48453 0.48453 0.48453 1</color></diffuse>",
        )
    )
    red = "<diffuse><color>1 0 0 1</color></diffuse>"
    clear = '<transparent opaque="{}"><color>{}</color></transparent>'
    amount = "<transparency><float>{}</float></transparency>"
    for mode, colour, value in (
        ("A_ONE", "1 1 1 0.8", 0.5),
        ("A_ONE", "1 1 1 1", 0.4),
        ("RGB_ZERO", "0.6 0.6 0.6 1", 1.0),
    ):
        add(f"dae transparency {mode} {colour} {value}", one(light(0.4, 0, 0.6)))(
            lambda f, m=mode, c=colour, v=value: _dae(
                f, red + clear.format(m, c) + amount.format(v)
            )
        )
    add("dae opaque by A_ONE", one(RED))(
        lambda f: _dae(f, red + clear.format("A_ONE", "1 1 1 1") + amount.format(1.0))
    )
    add("dae placeholder of transparency", one(RED))(
        lambda f: _dae(f, red + clear.format("RGB_ZERO", "0 0 0 1") + amount.format(1.0))
    )
    sun = "(Type=Directional,Direction=(X=0,Y=0,Z=1),Colour=(R=255,G=255,B=255))"
    add("dae normals", one(light(0.8)), lights=sun)(
        lambda f: _dae(f, "<diffuse><color>1 1 1 1</color></diffuse>", normals="0.6 0 0.8")
    )
    moved = {(1.2, 0.0): (128.0, 64.0, 0.0), (-0.9, 0.0): SKY}
    add("dae translation", moved)(lambda f: _dae(f, node="<translate>0.5 0 0</translate>"))
    add("dae matrix", moved)(
        lambda f: _dae(f, node="<matrix>1 0 0 0.5 0 1 0 0 0 0 1 0 0 0 0 1</matrix>")
    )
    add("dae rotation and child", moved)(
        lambda f: _dae(
            f,
            node="<rotate>0 0 1 180</rotate>",
            instance="<node><translate>-0.5 0 0</translate>{geometry}</node>",
        )
    )
    add("dae node of the library", moved)(
        lambda f: _dae(
            f,
            instance='<instance_node url="#lib"/>',
            library='<library_nodes><node id="lib"><translate>0.5 0 0</translate>{geometry}</node>'
            "</library_nodes>",
        )
    )
    add("dae missing texture", rejection="none.png")(
        lambda f: _dae(f, _DAE_TEXTURE, image="none.png")
    )


def _ply(folder: Path, *, form: str = "ascii", colour: str = "", face_colour: str = "") -> Path:
    properties = "".join(f"property float {axis}\n" for axis in "xyz") + colour
    header = f"ply\nformat {form} 1.0\nelement vertex 4\n{properties}element face 2\n"
    header += f"property list uchar int vertex_indices\n{face_colour}end_header\n"
    path = folder / "m.ply"
    if form == "ascii":
        ends = {"uchar": " 255 128 0", "float": " 1 0.50196 0", "": ""}
        kind = next(
            (k for k in ("uchar", "float") if k in colour.partition("property ")[2][:7]), ""
        )
        rows = "".join(f"{x} {y} {z}{ends[kind]}\n" for x, y, z in SQUARE.tolist())
        end = " 255 128 0" if face_colour else ""
        path.write_text(header + rows + f"3 0 1 2{end}\n3 0 2 3{end}\n")
        return path
    order = "<" if form == "binary_little_endian" else ">"
    rows = b"".join(
        np.array(row, dtype=f"{order}f4").tobytes() + (b"\xff\x80\0" if colour else b"")
        for row in SQUARE
    )
    faces = b"".join(
        b"\3"
        + np.array(face, dtype=f"{order}i4").tobytes()
        + (b"\xff\x80\0" if face_colour else b"")
        for face in FACES.reshape(2, 3)
    )
    path.write_bytes(header.encode() + rows + faces)
    return path


def _plys_and_stls() -> None:
    add, orange = feature, one((255.0, 128.0, 0.0))
    by_bytes = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    by_floats = by_bytes.replace("uchar", "float")
    for form in ("ascii", "binary_little_endian", "binary_big_endian"):
        add(f"ply {form}", one(light(0.5)))(lambda f, w=form: _ply(f, form=w))
        add(f"ply {form} colours", orange)(lambda f, w=form: _ply(f, form=w, colour=by_bytes))
    add("ply colours of faces", orange)(
        lambda f: _ply(f, form="binary_little_endian", face_colour=by_bytes)
    )

    def with_alpha(folder: Path, form: str, alpha: int) -> Path:
        path = _ply(folder, form=form, colour=by_bytes)
        ply = path.read_bytes().replace(b"uchar blue\n", b"uchar blue\nproperty uchar alpha\n")
        old, new = b" 255 128 0\n", f" 255 128 0 {alpha}\n".encode()
        if form != "ascii":
            old, new = b"\xff\x80\0", bytes((255, 128, 0, alpha))
        path.write_bytes(ply.replace(old, new))
        return path

    part, green = 102 / 255, float(linear_from_srgb(np.array(128 / 255)))
    for form in ("ascii", "binary_little_endian"):
        mixed = one(light(part, part * green, 1 - part))
        add(f"ply {form} alpha", mixed)(lambda f, w=form: with_alpha(f, w, 102))
        add(f"ply {form} alpha of zeros is none", orange)(lambda f, w=form: with_alpha(f, w, 0))
    add("ply colours as fractions", orange)(lambda f: _ply(f, colour=by_floats))

    def textured_ply(folder: Path) -> Path:
        _image(folder)
        rows = zip(SQUARE.tolist(), ("0 0", "1 0", "1 1", "0 1"), strict=True)
        text = "ply\nformat ascii 1.0\ncomment TextureFile q.png\nelement vertex 4\n"
        text += "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
        text += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
        text += "".join(f"{x} {y} {z} {uv}\n" for (x, y, z), uv in rows) + "3 0 1 2\n3 0 2 3\n"
        (folder / "m.ply").write_text(text)
        return folder / "m.ply"

    add("ply texture", QUARTERS)(textured_ply)

    def stl(folder: Path, *, head: bytes = b"", attribute: int = 0) -> Path:
        facet = np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
        facets = np.zeros(2, dtype=facet)
        facets["c"], facets["n"], facets["a"] = SQUARE[FACES].reshape(2, 3, 3), (0, 0, 1), attribute
        path = folder / "m.stl"
        path.write_bytes(head.ljust(80, b" ") + struct.pack("<I", 2) + facets.tobytes())
        return path

    # Five bits a channel: 31, 16 and 0 of 31; VisCAM has red highest and a bit for "valid".
    fifths = (255.0, 16 / 31 * 255, 0.0)
    add("stl is mid-grey", one(light(0.5)))(stl)
    add("stl colours of VisCAM", one(fifths))(
        lambda f: stl(f, attribute=0x8000 | 31 << 10 | 16 << 5)
    )
    add("stl colours of Magics", one(fifths))(
        lambda f: stl(f, head=b"COLOR=\x80\x80\x80\xff", attribute=16 << 5 | 31)
    )
    add("stl colour of the whole in Magics", one((128.0, 64.0, 0.0)))(
        lambda f: stl(f, head=b"part COLOR=\x80\x40\x00\xff,MATERIAL=", attribute=0x8000)
    )

    def text_stl(folder: Path) -> Path:
        facets = ""
        for face in SQUARE[FACES].reshape(2, 3, 3).tolist():
            corners = "".join(f"vertex {x} {y} {z}\n" for x, y, z in face)
            facets += f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n"
        (folder / "m.stl").write_text(f"solid m\n{facets}endsolid m\n")
        return folder / "m.stl"

    add("stl as text", one(light(0.5)))(text_stl)


for _add_rows in (
    _plain_materials,
    _vertex_colours,
    _alpha,
    _emission,
    _textures,
    _sides_and_normals,
    _geometry,
    _nodes,
    _lamps,
    _files,
    _objs,
    _daes,
    _plys_and_stls,
):
    _add_rows()
