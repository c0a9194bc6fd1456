"""Worlds of Gazebo (SDF) as text of a world file: models, includes, poses, shapes, looks, lights.

SDF has x forward, y left, z up; a world file has x forward, y right, z down: y and z change sign,
pitch and yaw with them. Colours of SDF are shown by Gazebo as they are written, and are taken for
sRGB here. A point light or spot of Gazebo falls off by 1 / (c + l d + q d^2), ours by 1 / d^2: both
agree at 2 m. Whatever has no counterpart is counted, by the names of its elements.

A file is foreign: a DTD, which could define entities, is rejected; elements, depth, models and the
length of chains of frames are limited; an include that includes itself is an error; and no URI
leads out of the folders that the user names, neither by `..` nor by a link.

Source: SDFormat 1.11, http://sdformat.org/spec, and its pose frame semantics.
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
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.world_file import MESH_SUFFIXES

# A saved world of a building has 2 MB; with these limits a hostile one takes a second.
_MAX_FILE_BYTES = 32 * 2**20
_MAX_ELEMENTS, _MAX_DEPTH = 200_000, 64
# Each is a line or more of the world file, which may have 65 536.
_MAX_MODELS, _MAX_NESTING, _MAX_CHAIN = 10_000, 16, 64
_MAX_OUT_BYTES, _MAX_OUT_LINES = 4 * 2**20, 2**16
_MAX_NUMBER, _MIN_LENGTH = 1e5, 1e-6
# Facets of a sphere: it departs from the ball by 0.3 % of the radius.
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
# Elements that are read, by the element around them, and those that no picture shows.
_READ = {
    "world": "model include light frame scene spherical_coordinates",
    "model": "link frame joint model include pose",
    "link": "pose visual light",
    "visual": "pose geometry material cast_shadows",
    "material": "ambient diffuse emissive pbr lighting",
    "mesh": "uri scale",
    "light": "pose diffuse direction intensity attenuation",
    "scene": "ambient background",
    "include": "uri name pose placement_frame",
}
_INVISIBLE = frozenset(
    "static self_collide allow_auto_disable enable_wind gravity kinematic inertial specular "
    "magnetic_field atmosphere wind cast_shadows visibility_flags meta".split()
)
_COPY_NUMBER = re.compile(r"[ ._-]*\d+$")
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
    """World of an SDF file.

    Args:
        path: The file, with a world or a single model.
        models: Folders of models, in which `model://` URIs are searched in this order.
        out_folder: Folder of the world file, to which its paths are relative.

    Raises:
        ConfigError: The file, or one that it includes, is unreadable, hostile or no SDF, or a URI
            leads out of all folders.
    """
    return _Importer(path, models, out_folder).run()


@dataclass(frozen=True, slots=True, eq=False)
class _Scope:
    """A model, or the world, whose frames are named within it."""

    element: Element
    file: Path
    class_name: str
    frames: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    """Frame that each link, frame, joint and nested model is relative to, empty for the scope's
    own, and its pose in there."""
    nested: dict[str, _Scope] = field(default_factory=dict)
    """Nested models."""
    lights: list[tuple[Element, Element, str]] = field(default_factory=list)
    """Lights, with the element of their pose, and the link that carries them, if any."""

    def find_pose(self, name: str, chain: tuple[str, ...] = ()) -> Pose:
        """Pose of a frame in the scope.

        Raises:
            ConfigError: There is no such frame, or it is relative to itself.
        """
        if name in ("", "__model__", "__root__", "world"):
            return _IDENTITY
        outer, separator, inner = name.partition("::")
        if separator and outer in self.nested:
            return self.find_pose(outer, chain) @ self.nested[outer].find_pose(inner)
        if name not in self.frames:
            raise _make_error(
                self.file, "relative_to", name, f"a frame: {list_names(name, self.frames)}"
            )
        if name in chain or len(chain) >= _MAX_CHAIN:
            expected = f"a chain of at most {_MAX_CHAIN} frames without a cycle"
            raise _make_error(self.file, "relative_to", name, expected)
        parent, pose = self.frames[name]
        return self.find_pose(parent, (*chain, name)) @ pose


class _Importer:
    """One import."""

    def __init__(self, path: Path, models: Sequence[Path], out_folder: Path) -> None:
        self._path = path
        self._roots = [*(folder.resolve() for folder in models), path.resolve().parent]
        self._out_folder = out_folder.resolve()
        self._files: dict[Path, Element] = {}
        self._num_models = 0
        self._settings: list[str] = []
        self._items: list[str] = []
        self._lights: list[str] = []
        self._left_out: Counter[str] = Counter()

    def run(self) -> ImportedWorld:
        path = self._path.resolve()
        root = self._parse(path)
        world = root.find("world")
        if world is None:
            world = Element("world", {"name": path.stem})
            world.extend(root)
        scope = self._read_scope(world, path, "", (path,))
        self._settings.append(f"Name={_quote(_name(world))}")
        self._write_settings(world)
        self._write_scope(scope, _IDENTITY, "")
        head = f"; Imported from {_UNSAFE.sub('_', path.name)}.\n[Catoptra.World]"
        text = "\n".join((head, *self._settings, *self._items, *self._lights, ""))
        if len(text.encode()) > _MAX_OUT_BYTES or text.count("\n") > _MAX_OUT_LINES:
            expected = (
                f"a world of at most {_MAX_OUT_LINES} lines and {_MAX_OUT_BYTES} bytes of ours"
            )
            raise _make_error(path, "world", f"{len(self._items)} shapes", expected)
        return ImportedWorld(text, len(self._items), len(self._lights), dict(self._left_out))

    # Files

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

    def _find_file(self, uri: str, file: Path) -> Path | None:
        """File or folder of a URI in a file; None where there is none.

        Raises:
            ConfigError: It lies outside of all folders.
        """
        scheme, separator, rest = unquote(uri).replace("\\", "/").strip().rpartition("://")
        if separator and scheme not in ("model", "package", "file"):
            return None
        if not separator:
            bases = [file.parent]
        else:
            bases = [Path("/")] if scheme == "file" else self._roots
        for base in bases:
            try:
                path = (base / rest.lstrip("/")).resolve()
            except (OSError, RuntimeError, ValueError) as error:
                raise _make_error(file, "uri", uri, f"a path ({error})") from error
            if not any(path.is_relative_to(root) for root in self._roots):
                expected = "a file inside of the world's folder or a folder of --models"
                raise _make_error(file, "uri", uri, expected)
            # By os.path: no error for a name longer than the system's names.
            if os.path.exists(path):
                return path
        return None

    def _find_model(self, uri: str, file: Path) -> tuple[Element, Path] | None:
        """Model or light that a URI names, and its file; None where there is none."""
        path = self._find_file(uri, file)
        if path is None:
            name = uri.rpartition("://")[2].strip("/")
            text = _STANDARD_MODELS.get(name)
            return None if text is None else (ElementTree.fromstring(text), file.parent / name)
        if path.is_dir():
            config = path / "model.config"
            listed = self._parse(config).findall("sdf") if config.is_file() else []
            # The newest form of several.
            names = sorted(listed, key=lambda sdf: _parse_version(sdf.get("version", "")))
            found = self._find_file(names[-1].text or "" if names else "model.sdf", config)
            if found is None or not found.is_file():
                return None
            path = found
        root = self._parse(path)
        for tag in ("model", "light"):
            if (element := root.find(tag)) is not None:
                return element, path
        return None

    # Frames

    def _read_scope(
        self, element: Element, file: Path, class_name: str, open_files: tuple[Path, ...]
    ) -> _Scope:
        """Frames and models of a model or the world.

        Args:
            element: The model or the world.
            file: Its file.
            class_name: Class of its objects; empty: by its own name.
            open_files: Files that include one another down to this one.
        """
        self._num_models += 1
        if self._num_models > _MAX_MODELS:
            raise _make_error(file, "model", _name(element), f"at most {_MAX_MODELS} models")
        if len(open_files) > _MAX_NESTING:
            expected = f"models nested {_MAX_NESTING} deep at most"
            raise _make_error(file, "model", _name(element), expected)
        scope = _Scope(element, file, _COPY_NUMBER.sub("", class_name or _name(element)))
        self._count_unread(element, "world" if element.tag == "world" else "model")
        for child in element:
            match child.tag:
                case "link":
                    self._add_frame(scope, child, "")
                    self._count_unread(child, "link")
                    scope.lights.extend(
                        (light, light, _name(child)) for light in child.findall("light")
                    )
                case "frame":
                    self._add_frame(scope, child, child.get("attached_to", ""))
                case "joint":
                    self._add_frame(scope, child, (child.findtext("child") or "").strip())
                case "light":
                    scope.lights.append((child, child, ""))
                case "model":
                    self._add_model(scope, child, child, file, "", (*open_files, file))
                case "include":
                    self._include(scope, child, open_files)
        return scope

    def _add_frame(self, scope: _Scope, element: Element, parent: str) -> None:
        pose, relative_to = self._read_pose(element, scope.file)
        scope.frames.setdefault(_name(element), (relative_to or parent, pose))

    def _include(self, scope: _Scope, include: Element, open_files: tuple[Path, ...]) -> None:
        uri = (include.findtext("uri") or "").strip()
        self._count_unread(include, "include")
        found = self._find_model(uri, scope.file)
        if found is None:
            self._left_out[f"include of {uri}, which no folder has"] += 1
            return
        element, file = found
        if file in open_files:
            raise _make_error(scope.file, "include", uri, "a model that does not include itself")
        placed = element if include.find("pose") is None else include
        if element.tag == "light":
            scope.lights.append((element, placed, ""))
            return
        class_name = uri.rpartition("://")[2].partition("/")[0]
        self._add_model(scope, placed, element, file, class_name, (*open_files, file), include)

    def _add_model(
        self,
        scope: _Scope,
        placed: Element,
        element: Element,
        file: Path,
        class_name: str,
        open_files: tuple[Path, ...],
        include: Element | None = None,
    ) -> None:
        """Add a nested model.

        Args:
            scope: The scope around it.
            placed: Element with its pose.
            element: The model.
            file: File of the model.
            class_name: Class of its objects; empty: by its own name.
            open_files: Files that include one another, down to the model's.
            include: Include that names it, if any.
        """
        child = self._read_scope(element, file, class_name, open_files)
        name = ((include.findtext("name") if include is not None else "") or "").strip()
        name = _make_unique(name or _name(element), scope.frames)
        pose, relative_to = self._read_pose(placed, scope.file)
        frame = element.get("placement_frame", "")
        if include is not None:
            frame = (include.findtext("placement_frame") or frame).strip()
        # The pose is that of the placement frame.
        pose = pose @ child.find_pose(frame).inverse()
        scope.frames[name] = (relative_to, pose)
        scope.nested[name] = child

    def _read_pose(self, element: Element, file: Path) -> tuple[Pose, str]:
        """Pose of an element, and the frame that it is relative to, empty for the default."""
        pose = element.find("pose")
        if pose is None:
            return _IDENTITY, ""
        relative_to = pose.get("relative_to", "").strip()
        if pose.get("rotation_format") == "quat_xyzw":
            x, y, z, *quaternion = _read_numbers(pose, file, 7)
            return Pose(_rotation_from_quaternion(quaternion), np.array((x, y, z))), relative_to
        x, y, z, *angles = _read_numbers(pose, file, 6)
        if pose.get("degrees") in ("true", "1"):
            angles = [math.radians(angle) for angle in angles]
        return Pose.from_rpy((x, y, z), angles), relative_to

    # Lines

    def _write_scope(self, scope: _Scope, world_from_scope: Pose, path: str) -> None:
        """Write the shapes and lights of a model or the world, and those of its models."""
        for link in scope.element.findall("link"):
            world_from_link = world_from_scope @ scope.find_pose(_name(link))
            for visual in link.findall("visual"):
                pose, relative_to = self._read_pose(visual, scope.file)
                parent = (
                    world_from_scope @ scope.find_pose(relative_to)
                    if relative_to
                    else world_from_link
                )
                self._write_visual(visual, parent @ pose, path, scope)
        for light, placed, link_name in scope.lights:
            pose, relative_to = self._read_pose(placed, scope.file)
            parent = world_from_scope @ scope.find_pose(relative_to or link_name)
            self._write_light(light, parent @ pose, scope.file)
        for name, child in scope.nested.items():
            pose = world_from_scope @ scope.find_pose(name)
            self._write_scope(child, pose, f"{path}/{name}" if path else name)

    def _write_visual(self, visual: Element, pose: Pose, name: str, scope: _Scope) -> None:
        self._count_unread(visual, "visual")
        geometry = visual.find("geometry")
        look = self._read_look(visual, scope.file)
        for shape in [] if geometry is None else geometry:
            for list_name, members, shape_pose in self._read_shape(shape, scope.file):
                self._items.append(
                    f"{list_name}=(Name={_quote(name or _name(visual))},"
                    f"Class={_quote(scope.class_name)},{members}"
                    f"{_format_pose(pose @ shape_pose)}{look})"
                )

    def _read_shape(self, shape: Element, file: Path) -> Iterator[tuple[str, str, Pose]]:
        """Yield list, members and pose of the parts of a shape."""

        def read(name: str, count: int = 1) -> list[float]:
            lengths = _read_numbers(shape.find(name), file, count, [1.0] * count)
            if min(lengths) < _MIN_LENGTH:
                raise _make_error(file, f"{shape.tag}/{name}", str(lengths), "lengths above 0")
            return lengths

        match shape.tag:
            case "box":
                yield "Boxes", f"Size={_format(read('size', 3))}", _IDENTITY
            case "cylinder":
                yield "Cylinders", _format_cylinder(*read("radius"), *read("length")), _IDENTITY
            case "sphere":
                yield "SphereBands", f"Radius={read('radius')[0]!r},{_SPHERE}", _IDENTITY
            case "ellipsoid":
                scale = _format(read("radii", 3))
                yield "SphereBands", f"Radius=1,{_SPHERE},Scale={scale}", _IDENTITY
            case "capsule":
                (radius,), (length,) = read("radius"), read("length")
                yield "Cylinders", _format_cylinder(radius, length), _IDENTITY
                for end in (-0.5 * length, 0.5 * length):
                    ball = f"Radius={radius!r},{_SPHERE}"
                    yield "SphereBands", ball, Pose.from_rpy((0.0, 0.0, end))
            case "plane":
                x, y = read("size", 2)
                normal = np.array(_read_numbers(shape.find("normal"), file, 3, [0.0, 0.0, 1.0]))
                yield "Rectangles", f"Size=(X={x!r},Y={y!r})", _pose_of_normal(normal)
            case "mesh":
                yield from self._read_mesh(shape, file)
            case _:
                self._left_out[f"geometry/{shape.tag}"] += 1

    def _read_mesh(self, mesh: Element, file: Path) -> Iterator[tuple[str, str, Pose]]:
        self._count_unread(mesh, "mesh")
        uri = (mesh.findtext("uri") or "").strip()
        path = self._find_file(uri, file)
        scale = _read_numbers(mesh.find("scale"), file, 3, [1.0, 1.0, 1.0])
        if path is None or not path.is_file() or _UNSAFE.search(str(path)):
            self._left_out[f"mesh {uri}, which no folder has"] += 1
            return
        if path.suffix.lower() not in MESH_SUFFIXES:
            self._left_out[f"mesh {uri}, of an unknown format"] += 1
            return
        if min(map(abs, scale)) < _MIN_LENGTH:
            self._left_out[f"mesh {uri}, scaled to nothing"] += 1
            return
        up = ",Up=y" if path.suffix.lower() in (".glb", ".gltf") else ""
        yield "Meshes", f"File={self._format_path(path)}{up},Scale={_format(scale)}", _IDENTITY

    def _read_look(self, visual: Element, file: Path) -> str:
        """Members of a visual's material; none for that of its mesh file."""
        members = []
        if _is_false(visual.find("cast_shadows")):
            members.append("CastShadow=false")
        material = visual.find("material")
        if material is not None:
            self._count_unread(material, "material")
            members += self._read_material(material, file)
        return "".join(f",{member}" for member in members)

    def _read_material(self, material: Element, file: Path) -> Iterator[str]:
        diffuse = material.find("diffuse")
        plain = material.find("ambient") if diffuse is None else diffuse
        colour = None if plain is None else _read_colour(plain, file)
        emissive = material.find("emissive")
        light = [0.0] * 3 if emissive is None else _read_colour(emissive, file)
        is_luminous = max(light) > 0.0 and max(light) >= max(colour or [0.0])
        if max(light) > 0.0 and not is_luminous:
            self._left_out["material/emissive beside a brighter diffuse colour"] += 1
        uri = material.findtext("pbr/metal/albedo_map") or material.findtext(
            "pbr/specular/albedo_map"
        )
        if uri:
            path = self._find_file(uri.strip(), file)
            if path is None or not path.is_file() or _UNSAFE.search(str(path)):
                self._left_out[f"texture {uri.strip()}, which no folder has"] += 1
            else:
                yield f"Texture={self._format_path(path)}"
        if is_luminous or colour is not None:
            yield f"Colour={_format_colour(light if is_luminous or colour is None else colour)}"
        if is_luminous or _is_false(material.find("lighting")):
            yield "Unlit=true"
        for part in (*material.findall("pbr/metal/*"), *material.findall("pbr/specular/*")):
            if part.tag != "albedo_map":
                self._left_out[f"material/pbr/{part.tag}"] += 1

    def _write_light(self, light: Element, pose: Pose, file: Path) -> None:
        self._count_unread(light, "light")
        kind = light.get("type", "point")
        colour = [1.0] * 3
        if (diffuse := light.find("diffuse")) is not None:
            colour = _read_colour(diffuse, file)
        (brightness,) = _read_numbers(light.find("intensity"), file, 1, [1.0])
        if kind == "directional":
            default = [0.0, 0.0, -1.0]
            direction = _read_numbers(light.find("direction"), file, 3, default)
            turned = pose.rotate_directions(np.array(direction if any(direction) else default))
            members = f"Type=Directional,Direction={_format(_SAE_FROM_SDF @ turned)}"
        else:
            if kind == "spot":
                self._left_out["light/spot: its cone, drawn as a point light"] += 1
            brightness *= self._read_falloff(light, file)
            members = f"Type=Point,Position={_format(_SAE_FROM_SDF @ pose.translation)}"
        brightness = _round(max(brightness, 0.0))
        self._lights.append(
            f"Lights=({members},Colour={_format_colour(colour)},Brightness={brightness!r})"
        )

    def _read_falloff(self, light: Element, file: Path) -> float:
        """Factor by which our light has Gazebo's irradiance at a distance."""
        attenuation = light.find("attenuation")
        if attenuation is None:
            return 1.0
        coefficients = (("constant", 1.0), ("linear", 0.0), ("quadratic", 0.0))
        c, l, q = (  # noqa: E741 # as in the formula
            _read_numbers(attenuation.find(name), file, 1, [default])[0]
            for name, default in coefficients
        )
        d = _LIGHT_DISTANCE_M
        divisor = c + l * d + q * d * d
        if (c, l) != (0.0, 0.0):
            self._left_out[
                f"light/attenuation other than by distance squared, equal at {d:g} m"
            ] += 1
        return d * d / divisor if divisor > 0.0 else 1.0

    def _write_settings(self, world: Element) -> None:
        """Write background, ambient light (Gazebo's where none is stated) and GPS origin."""
        scene = world.find("scene")
        scene = Element("scene") if scene is None else scene
        self._count_unread(scene, "scene")
        ambient, background = scene.find("ambient"), scene.find("background")
        if background is not None:
            colour = _format_colour(_read_colour(background, self._path))
            self._settings.append(f"Background={colour}")
        light = [0.4] * 3 if ambient is None else _read_colour(ambient, self._path)
        up = _format_colour(light)
        self._lights.append(f"Lights=(Type=Hemisphere,Up={up},Down={up})")
        if (place := world.find("spherical_coordinates")) is not None:
            latitude, longitude = (
                _read_numbers(place.find(f"{name}_deg"), self._path, 1)[0]
                for name in ("latitude", "longitude")
            )
            self._settings.append(f"GpsOrigin=(Latitude={latitude!r},Longitude={longitude!r})")

    def _format_path(self, path: Path) -> str:
        return _quote(os.path.relpath(path, self._out_folder))

    def _count_unread(self, element: Element, kind: str) -> None:
        """Count the children of an element that nothing reads."""
        read = _READ[kind].split()
        for child in element:
            if child.tag not in read and child.tag not in _INVISIBLE:
                self._left_out[f"{kind}/{child.tag}"] += 1


class _LimitedBuilder(ElementTree.TreeBuilder):
    """Builder of a tree of limited size, without a DTD."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._depth = self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> Element:
        self._depth += 1
        self._count += 1
        if self._depth > _MAX_DEPTH:
            raise _make_error(self._path, "element", tag, f"elements {_MAX_DEPTH} deep at most")
        if self._count > _MAX_ELEMENTS:
            raise _make_error(self._path, "element", tag, f"at most {_MAX_ELEMENTS} elements")
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


def _name(element: Element) -> str:
    return element.get("name") or element.tag


def _make_unique(name: str, known: dict[str, tuple[str, Pose]]) -> str:
    """Name, or the name with a number, as Gazebo tells copies apart."""
    number = len(known)
    return name if name not in known else f"{name}_{number}"


def _parse_version(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(".") if part.isascii() and part.isdigit())


def _read_numbers(
    element: Element | None, file: Path, count: int, default: list[float] | None = None
) -> list[float]:
    """Numbers of an element's text; a default for an absent or empty one, else zeros."""
    text = "" if element is None else (element.text or "").strip()
    if not text:
        return [0.0] * count if default is None else default
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    # NaN fails the comparison and so is rejected, too.
    if len(values) != count or not all(abs(value) <= _MAX_NUMBER for value in values):
        tag = "" if element is None else element.tag
        numbers = f"{count} numbers" if count > 1 else "a number"
        raise _make_error(file, tag, text, f"{numbers} of at most {_MAX_NUMBER:g}")
    return values


def _read_colour(element: Element, file: Path) -> list[float]:
    """Red, green and blue of an element, without its opacity."""
    num_words = len((element.text or "").split())
    return _read_numbers(element, file, 3 if num_words == 3 else 4)[:3]


def _is_false(element: Element | None) -> bool:
    return element is not None and (element.text or "").strip() in ("0", "false")


def _rotation_from_quaternion(quaternion: Sequence[float]) -> Floats:
    """(3, 3) rotation of a quaternion x, y, z, w of any length; that of zeros is none."""
    length = hypot(*quaternion)
    if length == 0.0:
        return np.eye(3)
    x, y, z, w = (value / length for value in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _pose_of_normal(normal: Floats) -> Pose:
    """Pose whose z axis is a (3,) normal of any length."""
    level = float(hypot(normal[0], normal[1]))
    pitch = float(arctan2(level, normal[2]))
    yaw = float(arctan2(normal[1], normal[0])) if level else 0.0
    return Pose.from_rpy((0.0, 0.0, 0.0), (0.0, pitch, yaw))


def _format_pose(world_from_shape: Pose) -> str:
    """Members of a pose in SDF's world."""
    rotation = _SAE_FROM_SDF @ world_from_shape.rotation @ _SAE_FROM_SDF
    position = _SAE_FROM_SDF @ world_from_shape.translation
    rpy = Pose(rotation, np.zeros(3)).to_rpy()
    return f",Position={_format(position)},Direction={_format(rpy)}"


def _format_cylinder(radius: float, length: float) -> str:
    return f"Radius={radius!r},Height={length!r}"


def _format(values: Sequence[float] | Floats) -> str:
    x, y, z = (_round(float(value)) for value in values)
    return f"(X={x!r},Y={y!r},Z={z!r})"


def _round(value: float) -> float:
    # A nanometre; zero without a sign.
    return round(value, 9) + 0.0


def _format_colour(colour: Sequence[float]) -> str:
    r, g, b = (round(255.0 * min(max(value, 0.0), 1.0)) for value in colour)
    return f"(R={r},G={g},B={b})"


def _quote(text: str) -> str:
    return f'"{_UNSAFE.sub("_", text)}"'
