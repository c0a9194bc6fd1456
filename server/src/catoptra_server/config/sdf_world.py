"""Worlds of Gazebo (SDF) as text of a world file: models, includes, poses, shapes, looks, lights.

SDF has x forward, y left, z up; a world file has x forward, y right, z down: y and z change sign,
pitch and yaw with them. Colours of SDF are shown by Gazebo as they are written, and are taken for
sRGB here. A point light or spot of Gazebo falls off by 1 / (c + l d + q d^2), ours by 1 / d^2: both
agree at 2 m. Whatever has no counterpart is counted, by the names of its elements.

A file is foreign: a DTD, which could define entities, is rejected; elements, depth, models and the
length of chains of frames are limited; an include that includes itself is an error; and no URI
leads out of the folders that the user names, neither by `..` nor by a link.

A material that is a script is read by its name, where that is one of Gazebo's plain colours.

Sources: SDFormat 1.11, http://sdformat.org/spec, and its pose frame semantics; Gazebo classic,
media/materials/scripts/gazebo.material.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import field
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.names import list_names
from catoptra_protocol.optics.elementary import arctan2, hypot
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.world_file import MESH_SUFFIXES

# A saved world of a building has 2 MB; with these limits a hostile one takes a second.
_MAX_FILE_BYTES = 32 * 2**20
_MAX_ELEMENTS, _MAX_DEPTH = 200_000, 64
# Each is a line or more of the world file, which may have 65 536.
_MAX_MODELS, _MAX_NESTING, _MAX_CHAIN = 10_000, 16, 64
_MAX_OUT_BYTES, _MAX_OUT_LINES = 4 * 2**20, 2**16
_MAX_NUMBER, _MIN_LENGTH = 1e5, 1e-6
# Facets of a sphere, which departs from the ball by 0.3 % of the radius.
_SPHERE = "From=0,To=180,Sectors=48,Rings=24,Solid=true"
_LIGHT_DISTANCE_M = 2.0
_IDENTITY = Pose.identity()
# y and z change sign: the half turn about x.
_SAE_FROM_SDF = np.diag((1.0, -1.0, -1.0))
# What Gazebo itself brings along, where no folder has it.
_STANDARD_MODELS = {
    "sun": "<light name='sun' type='directional'><diffuse>0.8 0.8 0.8 1</diffuse>"
    "<direction>-0.5 0.1 -0.9</direction></light>",
    "ground_plane": "<model name='ground_plane'><link name='link'><visual name='visual'><geometry>"
    "<plane><size>100 100</size></plane></geometry><material><diffuse>0.7 0.7 0.7 1</diffuse>"
    "</material></visual></link></model>",
}
# Diffuse colours of Gazebo's materials without a texture.
_COLOURS = {
    "Grey": (0.7, 0.7, 0.7),
    "DarkGrey": (0.175, 0.175, 0.175),
    "White": (1.0, 1.0, 1.0),
    "FlatBlack": (0.1, 0.1, 0.1),
    "Black": (0.0, 0.0, 0.0),
    "Red": (1.0, 0.0, 0.0),
    "RedBright": (0.87, 0.26, 0.07),
    "Green": (0.0, 1.0, 0.0),
    "Blue": (0.0, 0.0, 1.0),
    "SkyBlue": (0.0, 0.0, 1.0),
    "Yellow": (1.0, 1.0, 0.0),
    "ZincYellow": (0.9725, 0.9529, 0.2078),
    "Purple": (1.0, 0.0, 1.0),
    "Turquoise": (0.0, 1.0, 1.0),
    "Orange": (1.0, 0.5088, 0.0468),
    "Gold": (0.8, 0.64869, 0.120759),
    "Pioneer2Body": (0.681193, 0.000923, 0.000923),
}
# Those that emit light, by the colour of it; others `<name>Glow`.
_GLOWS = {"LightOn": "Green", "LightOff": "Red", "JointAnchor": "White"}
# Elements that are read, by the element around them, and those that no picture shows.
_READ = {
    "world": "model include light frame scene",
    "model": "link frame joint model include pose",
    "link": "pose visual light",
    "visual": "pose geometry material cast_shadows transparency",
    "material": "ambient diffuse emissive pbr lighting script double_sided",
    "mesh": "uri scale",
    "light": "pose diffuse direction intensity attenuation cast_shadows",
    "scene": "ambient background",
    "include": "uri name pose placement_frame",
}
_INVISIBLE = frozenset(
    "static self_collide allow_auto_disable enable_wind gravity kinematic inertial specular "
    "magnetic_field atmosphere wind visibility_flags meta".split()
)
_COPY_NUMBER = re.compile(r"[ ._-]*\d+$")
_FALSE = ("0", "false")
_UNSAFE = re.compile(r'["\x00-\x1f\x7f-\x9f]')


@dataclass(frozen=True, slots=True, eq=False)
class ImportedWorld:
    """A world of Gazebo in our form."""

    text: str
    """World file."""
    num_items: int
    num_lights: int
    left_out: dict[str, int]
    """What is not in the text, by its elements' names, with its number."""


def import_sdf(path: Path, models: Sequence[Path], out_folder: Path) -> ImportedWorld:
    """World of an SDF file, which has a world or a single model.

    Args:
        path: The file.
        models: Folders of models, in which `model://` URIs are searched in this order.
        out_folder: Folder of the world file, to which its paths are relative.

    Raises:
        ConfigError: The file, or one that it includes, is unreadable, hostile or no SDF, or a URI
            leads out of all folders.
    """
    return _Importer(path.resolve(), models, out_folder.resolve()).run()


@dataclass(frozen=True, slots=True, eq=False)
class _Scope:
    """A model, or the world, whose frames are named within it."""

    element: Element
    files: tuple[Path, ...]
    """Files around the element, of models that hold one another; its own is the last one."""
    class_name: str
    frames: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    """Frame that each link, frame, joint and nested model is relative to, empty for the scope's
    own, and its pose in there."""
    nested: dict[str, _Scope] = field(default_factory=dict)
    lights: list[tuple[Element, Element, str]] = field(default_factory=list)
    """Lights, with the element of their pose, and the link that carries them, if any."""

    @property
    def file(self) -> Path:
        return self.files[-1]

    def add_frame(self, element: Element, parent: str = "") -> None:
        pose, relative_to = _read_pose(element, self.file)
        self.frames.setdefault(_name(element), (relative_to or parent, pose))

    def find_pose(self, name: str, chain: tuple[str, ...] = ()) -> Pose:
        """Pose of a frame in the scope.

        Raises:
            ConfigError: There is no such frame, or it is relative to itself.
        """
        if name in ("", "__model__", "world"):
            return _IDENTITY
        outer, separator, inner = name.partition("::")
        if separator and outer in self.nested:
            return self.find_pose(outer, chain) @ self.nested[outer].find_pose(inner)
        expected = ""
        if name not in self.frames:
            expected = f"a frame: {list_names(name, self.frames)}"
        elif name in chain or len(chain) >= _MAX_CHAIN:
            expected = f"a chain of at most {_MAX_CHAIN} frames without a cycle"
        if expected:
            raise _make_error(self.file, "relative_to", name, expected)
        parent, pose = self.frames[name]
        return self.find_pose(parent, (*chain, name)) @ pose


class _Importer:
    """One import."""

    def __init__(self, path: Path, models: Sequence[Path], out_folder: Path) -> None:
        self._path = path
        self._roots = [*(folder.resolve() for folder in models), path.parent]
        self._out_folder = out_folder
        self._files: dict[Path, Element] = {}
        self._num_models = 0
        self._items: list[str] = []
        self._lights: list[str] = []
        self._left_out: Counter[str] = Counter()

    def run(self) -> ImportedWorld:
        root = self._parse(self._path)
        world = root.find("world")
        if world is None:
            world = Element("world", {"name": self._path.stem})
            world.extend(root)
        head = [f"; Imported from {_UNSAFE.sub('_', self._path.name)}.", "[Catoptra.World]"]
        head += [f"Name={_quote(_name(world))}", *self._read_scene(world.find("scene"))]
        self._write_scope(self._read_scope(world, "", (self._path,)), _IDENTITY, "")
        lines = [*head, *self._items, *self._lights, ""]
        text = "\n".join(lines)
        if len(text.encode()) > _MAX_OUT_BYTES or len(lines) > _MAX_OUT_LINES:
            expected = f"a world file of at most {_MAX_OUT_LINES} lines and {_MAX_OUT_BYTES} bytes"
            raise _make_error(self._path, "world", f"{len(self._items)} shapes", expected)
        return ImportedWorld(text, len(self._items), len(self._lights), dict(self._left_out))

    def _parse(self, path: Path) -> Element:
        """Root element of a file, which is read once."""
        if path not in self._files:
            try:
                with path.open("rb") as file:
                    data = file.read(_MAX_FILE_BYTES + 1)
            except OSError as error:
                raise _make_error(path, "file", path.name, f"a readable file ({error})") from error
            if len(data) > _MAX_FILE_BYTES:
                raise _make_error(path, "file", path.name, f"at most {_MAX_FILE_BYTES} bytes")
            self._files[path] = _parse_xml(data, path)
        return self._files[path]

    def _find(self, uri: str, file: Path, kind: str) -> Path | None:
        """File or folder of a URI in a file; None, and counted, where no folder has it.

        Raises:
            ConfigError: It lies outside of all folders.
        """
        scheme, _, rest = unquote(uri).replace("\\", "/").strip().rpartition("://")
        bases = {"": [file.parent], "file": [Path("/")]}.get(scheme, self._roots)
        for base in bases if scheme in ("", "file", "model", "package") else []:
            try:
                path = (base / rest.lstrip("/")).resolve()
            except (OSError, RuntimeError, ValueError) as error:
                raise _make_error(file, "uri", uri, f"a path ({error})") from error
            if not any(path.is_relative_to(root) for root in self._roots):
                expected = "a file inside of the world's folder or a folder of --models"
                raise _make_error(file, "uri", uri, expected)
            # By os.path: no error for a name longer than the system's names.
            if os.path.exists(path) and not _UNSAFE.search(str(path)):
                return path
        self._left_out[_describe_missing(kind, uri)] += 1
        return None

    def _find_model(self, uri: str, file: Path) -> tuple[Element, Path] | None:
        """Model or light that a URI names, and its file; None where there is none."""
        name = uri.rpartition("://")[2].strip("/")
        path = self._find(uri, file, "include")
        if path is None and name in _STANDARD_MODELS:
            del self._left_out[_describe_missing("include", uri)]
            return ElementTree.fromstring(_STANDARD_MODELS[name]), file.parent / name
        if path is not None and path.is_dir():
            config = path / "model.config"
            # The newest form of several is the last.
            forms = self._parse(config).findall("sdf") if config.is_file() else []
            path = self._find(forms[-1].text or "" if forms else "model.sdf", config, "include")
        if path is None:
            return None
        root = self._parse(path)
        found = [element for element in root if element.tag in ("model", "light")]
        return (found[0], path) if found else None

    def _read_scope(self, element: Element, class_name: str, files: tuple[Path, ...]) -> _Scope:
        """Frames, models and lights of a model or the world, and of its models.

        Args:
            element: The model or the world.
            class_name: Class of its objects; empty: by its own name.
            files: Files around the element.
        """
        self._num_models += 1
        if self._num_models > _MAX_MODELS:
            raise _make_error(files[-1], "model", _name(element), f"at most {_MAX_MODELS} models")
        if len(files) > _MAX_NESTING:
            expected = f"models nested {_MAX_NESTING} deep at most"
            raise _make_error(files[-1], "model", _name(element), expected)
        scope = _Scope(element, files, _COPY_NUMBER.sub("", class_name or _name(element)))
        self._count_unread(element)
        for child in element:
            match child.tag:
                case "link":
                    scope.add_frame(child)
                    self._count_unread(child)
                    lights = child.findall("light")
                    scope.lights.extend((light, light, _name(child)) for light in lights)
                case "frame":
                    scope.add_frame(child, child.get("attached_to", ""))
                case "joint":
                    scope.add_frame(child, _text(child, "child"))
                case "light":
                    scope.lights.append((child, child, ""))
                case "model":
                    model = self._read_scope(child, "", (*files, files[-1]))
                    self._add_model(scope, model, child)
                case "include":
                    self._include(scope, child)
        return scope

    def _include(self, scope: _Scope, include: Element) -> None:
        uri = _text(include, "uri")
        self._count_unread(include)
        found = self._find_model(uri, scope.file)
        if found is None:
            return
        element, file = found
        if file in scope.files:
            raise _make_error(scope.file, "include", uri, "a model that does not include itself")
        if element.tag == "light":
            placed = element if include.find("pose") is None else include
            scope.lights.append((element, placed, ""))
            return
        class_name = uri.rpartition("://")[2].partition("/")[0]
        self._add_model(scope, self._read_scope(element, class_name, (*scope.files, file)), include)

    def _add_model(self, scope: _Scope, model: _Scope, placed: Element) -> None:
        """Add a model to a scope, by the element that names and places it."""
        name = first = _text(placed, "name") or _name(model.element)
        while name in scope.frames:  # Gazebo numbers copies, too
            name = f"{first}_{len(scope.frames)}"
            first += "_"
        source = model.element if placed.find("pose") is None else placed
        pose, relative_to = _read_pose(source, scope.file)
        # The pose is that of a frame of the model.
        frame = _text(placed, "placement_frame") or model.element.get("placement_frame", "")
        scope.frames[name] = (relative_to, pose @ model.find_pose(frame).inverse())
        scope.nested[name] = model

    def _write_scope(self, scope: _Scope, world_from_scope: Pose, path: str) -> None:
        """Write the shapes and lights of a model or the world, and those of its models."""

        def place(element: Element, parent: str) -> Pose:
            pose, relative_to = _read_pose(element, scope.file)
            return world_from_scope @ scope.find_pose(relative_to or parent) @ pose

        for link in scope.element.findall("link"):
            for visual in link.findall("visual"):
                self._write_visual(visual, place(visual, _name(link)), path, scope)
        for light, placed, link_name in scope.lights:
            self._write_light(light, place(placed, link_name), scope.file)
        for name, model in scope.nested.items():
            pose = world_from_scope @ scope.find_pose(name)
            self._write_scope(model, pose, f"{path}/{name}" if path else name)

    def _write_visual(self, visual: Element, pose: Pose, name: str, scope: _Scope) -> None:
        self._count_unread(visual)
        look = "".join(f",{member}" for member in self._read_look(visual, scope.file))
        who = f"Name={_quote(name or _name(visual))},Class={_quote(scope.class_name)}"
        for shape in visual.findall("geometry/*"):
            if (found := self._read_shape(shape, scope.file)) is not None:
                kind, members = found
                if kind == "Rectangles":
                    normal = _read_numbers(shape.find("normal"), scope.file, [0.0, 0.0, 1.0])
                    pose = pose @ _pose_of_normal(normal)
                # The half turn about x, before and after.
                rotation = _SAE_FROM_SDF @ pose.rotation @ _SAE_FROM_SDF
                rpy = Pose(rotation, np.zeros(3)).to_rpy()
                where = f"Position={_format(_SAE_FROM_SDF @ pose.translation)}"
                self._items.append(
                    f"{kind}=({who},{members},{where},Direction={_format(rpy)}{look})"
                )

    def _read_shape(self, shape: Element, file: Path) -> tuple[str, str] | None:
        """List and members of a shape; None, and counted, for one without a counterpart."""

        def read(name: str, count: int = 1) -> list[float]:
            lengths = _read_numbers(shape.find(name), file, [1.0] * count)
            if min(lengths) < _MIN_LENGTH:
                raise _make_error(file, f"{shape.tag}/{name}", str(lengths), "lengths above 0")
            return lengths

        match shape.tag:
            case "box":
                return "Boxes", f"Size={_format(read('size', 3))}"
            case "cylinder":
                return "Cylinders", f"Radius={read('radius')[0]!r},Height={read('length')[0]!r}"
            case "sphere":
                return "SphereBands", f"Radius={read('radius')[0]!r},{_SPHERE}"
            case "ellipsoid":
                return "SphereBands", f"Radius=1,{_SPHERE},Scale={_format(read('radii', 3))}"
            case "plane":
                x, y = read("size", 2)
                return "Rectangles", f"Size=(X={x!r},Y={y!r})"
            case "mesh":
                return self._read_mesh(shape, file)
        self._left_out[f"geometry/{shape.tag}"] += 1
        return None

    def _read_mesh(self, mesh: Element, file: Path) -> tuple[str, str] | None:
        self._count_unread(mesh)
        uri = _text(mesh, "uri")
        scale = _read_numbers(mesh.find("scale"), file, [1.0, 1.0, 1.0])
        path = self._find(uri, file, "mesh")
        if path is None:
            return None
        if path.suffix.lower() not in MESH_SUFFIXES or min(map(abs, scale)) < _MIN_LENGTH:
            self._left_out[f"mesh {path.name}, of an unknown format or scaled to nothing"] += 1
            return None
        up = "Up=y," if path.suffix.lower() in (".glb", ".gltf") else ""
        return "Meshes", f"File={self._format_path(path)},{up}Scale={_format(scale)}"

    def _read_look(self, visual: Element, file: Path) -> Iterator[str]:
        """Yield the members of a visual's material; none for that of its mesh file."""
        if _text(visual, "cast_shadows") in _FALSE:
            yield "CastShadow=false"
        if _read_numbers(visual.find("transparency"), file, [0.0])[0] > 0.0:
            self._left_out["visual/transparency, drawn opaque"] += 1
        material = visual.find("material")
        if material is None:
            return
        self._count_unread(material)
        if (_text(material, "double_sided") or "false") not in _FALSE:
            self._left_out["material/double_sided"] += 1
        named, emitted = self._read_script(material)
        diffuse, ambient = (_read_colour(material, name, file) for name in ("diffuse", "ambient"))
        # What the material states itself comes before its script, as in Gazebo.
        colour = diffuse or named or ambient
        light = _read_colour(material, "emissive", file) or emitted or [0.0]
        is_luminous = max(light) > 0.0 and max(light) >= max(colour or [0.0])
        if max(light) > 0.0 and not is_luminous:
            self._left_out["material/emissive beside a brighter diffuse colour"] += 1
        for part in material.findall("pbr/*/*"):
            if part.tag != "albedo_map":
                self._left_out[f"material/pbr/{part.tag}"] += 1
            elif (path := self._find((part.text or "").strip(), file, "texture")) is not None:
                yield f"Texture={self._format_path(path)}"
        if is_luminous or colour:
            yield f"Colour={_format_colour(light if is_luminous else colour or [])}"
        if is_luminous or _text(material, "lighting") in _FALSE:
            yield "Unlit=true"

    def _read_script(self, material: Element) -> tuple[list[float], list[float]]:
        """Colour and emitted light of a material's script; empty where there is none."""
        name = _text(material, "script/name")
        if not name:
            return [], []
        plain = name.removeprefix("Gazebo/")
        glow = _GLOWS.get(plain, plain.removesuffix("Glow"))
        if plain == name or glow not in _COLOURS:
            self._left_out[f"material/script {_UNSAFE.sub('_', name[:100])}"] += 1
            return [], []
        return [*_COLOURS[glow]], [] if glow == plain else [*_COLOURS[glow]]

    def _write_light(self, light: Element, pose: Pose, file: Path) -> None:
        self._count_unread(light)
        if _text(light, "cast_shadows") in _FALSE:
            self._left_out["light/cast_shadows of false: it casts them"] += 1
        colour = _read_colour(light, "diffuse", file) or [1.0] * 3
        (brightness,) = _read_numbers(light.find("intensity"), file, [1.0])
        if light.get("type") == "directional":
            direction = _read_numbers(light.find("direction"), file, [0.0, 0.0, -1.0])
            turned = pose.rotate_directions(np.array(direction if any(direction) else (0, 0, -1)))
            members = f"Type=Directional,Direction={_format(_SAE_FROM_SDF @ turned)}"
        else:
            if light.get("type") == "spot":
                self._left_out["light/spot: its cone, drawn as a point light"] += 1
            brightness *= self._read_falloff(light, file)
            members = f"Type=Point,Position={_format(_SAE_FROM_SDF @ pose.translation)}"
        members += f",Colour={_format_colour(colour)},Brightness={round(max(brightness, 0.0), 9)!r}"
        self._lights.append(f"Lights=({members})")

    def _read_falloff(self, light: Element, file: Path) -> float:
        """Factor by which our light has Gazebo's irradiance at a distance."""
        if light.find("attenuation") is None:
            return 1.0
        constant, linear, quadratic = (
            _read_numbers(light.find(f"attenuation/{name}"), file, [default])[0]
            for name, default in (("constant", 1.0), ("linear", 0.0), ("quadratic", 0.0))
        )
        d = _LIGHT_DISTANCE_M
        if constant or linear:
            self._left_out[f"light/attenuation other than by distance squared, as at {d:g} m"] += 1
        divisor = constant + linear * d + quadratic * d * d
        return d * d / divisor if divisor > 0.0 else 1.0

    def _read_scene(self, scene: Element | None) -> Iterator[str]:
        """Yield the background, and write the ambient light, Gazebo's where none is stated."""
        scene = Element("scene") if scene is None else scene
        self._count_unread(scene)
        if background := _read_colour(scene, "background", self._path):
            yield f"Background={_format_colour(background)}"
        up = _format_colour(_read_colour(scene, "ambient", self._path) or [0.4] * 3)
        self._lights.append(f"Lights=(Type=Hemisphere,Up={up},Down={up})")

    def _format_path(self, path: Path) -> str:
        return _quote(os.path.relpath(path, self._out_folder))

    def _count_unread(self, element: Element) -> None:
        """Count the children of an element that nothing reads."""
        for child in element:
            if child.tag not in _READ[element.tag].split() and child.tag not in _INVISIBLE:
                self._left_out[f"{element.tag}/{child.tag}"] += 1


class _LimitedBuilder(ElementTree.TreeBuilder):
    """Builder of a tree of limited size, without a DTD."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._depth = self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> Element:
        self._depth += 1
        self._count += 1
        if self._depth > _MAX_DEPTH or self._count > _MAX_ELEMENTS:
            expected = f"at most {_MAX_ELEMENTS} elements, {_MAX_DEPTH} deep at most"
            raise _make_error(self._path, "element", tag, expected)
        return super().start(tag, attributes)

    def end(self, tag: str) -> Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, _public: str | None, _system: str | None) -> None:
        """Reject a DTD, before its entities are known."""
        raise _make_error(self._path, "DOCTYPE", name, "a file without a DTD")


def _parse_xml(data: bytes, path: Path) -> Element:
    parser = ElementTree.XMLParser(target=_LimitedBuilder(path))
    try:
        parser.feed(data)
        root: Element = parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        line = error.position[0] if isinstance(error, ElementTree.ParseError) else 0
        raise _make_error(path, "file", path.name, f"XML of an SDF file ({error})", line) from error
    if root.tag not in ("sdf", "gazebo", "model"):
        raise _make_error(path, "element", root.tag, "<sdf>, as Gazebo's files begin")
    return root


def _make_error(path: Path, key: str, value: str, expected: str, line: int = 0) -> ConfigError:
    where = SourceLocation(str(path), line) if line else SourceLocation(str(path))
    return ConfigError(where, key=key, value=value[:100], expected=expected)


def _describe_missing(kind: str, uri: str) -> str:
    return f"{kind} {_UNSAFE.sub('_', uri[:100])}, which no folder has"


def _name(element: Element) -> str:
    return element.get("name") or element.tag


def _text(element: Element, name: str) -> str:
    """Text of a child, empty without one."""
    return (element.findtext(name) or "").strip()


def _read_pose(element: Element, file: Path) -> tuple[Pose, str]:
    """Pose of an element, and the frame that it is relative to, empty for the default."""
    pose = element.find("pose")
    if pose is None:
        return _IDENTITY, ""
    is_quaternion = pose.get("rotation_format") == "quat_xyzw"
    x, y, z, *turn = _read_numbers(pose, file, [0.0] * (7 if is_quaternion else 6))
    if pose.get("degrees") in ("true", "1"):
        turn = [math.radians(angle) for angle in turn]
    rotation = _rotation_from_quaternion(turn) if is_quaternion else rotation_from_rpy(*turn)
    return Pose(rotation, np.array((x, y, z))), pose.get("relative_to", "").strip()


def _read_numbers(element: Element | None, file: Path, default: list[float]) -> list[float]:
    """Numbers of an element's text; the default, which tells how many, for an empty one."""
    text = "" if element is None else (element.text or "").strip()
    if element is None or not text:
        return default
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    # NaN fails the comparison and so is rejected, too.
    if len(values) != len(default) or not all(abs(value) <= _MAX_NUMBER for value in values):
        expected = f"{len(default)} numbers of at most {_MAX_NUMBER:g}"
        raise _make_error(file, element.tag, text, expected)
    return values


def _read_colour(element: Element, name: str, file: Path) -> list[float]:
    """Red, green and blue of a child, without its opacity; empty without one."""
    count = 3 if len(_text(element, name).split()) == 3 else 4
    return (
        _read_numbers(element.find(name), file, [0.0] * count)[:3] if _text(element, name) else []
    )


def _rotation_from_quaternion(quaternion: Sequence[float]) -> Floats:
    """(3, 3) rotation of a quaternion x, y, z, w of any length; that of zeros is none."""
    length = hypot(*quaternion) or 1.0
    x, y, z, w = (value / length for value in quaternion)
    # Rodrigues' formula, with the sine and the cosine of half the angle.
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Floats = np.eye(3) + 2.0 * (w * skew + skew @ skew)
    return rotation


def _pose_of_normal(normal: Sequence[float]) -> Pose:
    """Pose whose z axis is a normal of any length."""
    x, y, z = normal
    yaw = float(arctan2(y, x)) if x or y else 0.0
    return Pose(rotation_from_rpy(0.0, float(arctan2(hypot(x, y), z)), yaw), np.zeros(3))


def _format(values: Sequence[float] | Floats) -> str:
    # To a nanometre; zero without a sign.
    x, y, z = (round(float(value), 9) + 0.0 for value in values)
    return f"(X={x!r},Y={y!r},Z={z!r})"


def _format_colour(colour: Sequence[float]) -> str:
    r, g, b = (round(255.0 * min(max(value, 0.0), 1.0)) for value in colour)
    return f"(R={r},G={g},B={b})"


def _quote(text: str) -> str:
    return f'"{_UNSAFE.sub("_", text)}"'
