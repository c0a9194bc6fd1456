"""What a robot file says of its omnidirectional camera: the paper's three groups of elements.

`StaticMeshes` (a mirror), `CamTexActors` (the effective viewpoint and its five texture clients),
`Cameras` (the capture camera at the pinhole).
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera import OmniCamera, camera_with_rim_inscribed
from catoptra_protocol.optics.cube import Face
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.mirrors import CentralMirror, HyperbolicMirror, ParabolicMirror
from catoptra_server.config.effects import read_effects
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.settings import Settings
from catoptra_server.robot.description import OmniCameraDescription, TextureClient
from catoptra_server.robot.render_wish import Dial, PerPixel, RenderWish, Surface
from catoptra_server.scene.mirror_mesh import Interpolation, PolygonSplit, split_for

# Largest picture side: 8192^2 pixels are what OpenGL and a msgpack-sized world still take.
_LARGEST_SIDE_PX = 8192
# A capture camera this far off the pinhole (metres) moves the picture by 0.04 px at 360 px: below
# any use. Farther off it is a misalignment, which is an effect, not a camera law.
_PINHOLE_TOLERANCE_M = 5e-5
_AXIS_TOLERANCE_RAD = 1e-3


def read_omni_camera(file: IniFile, section: Settings) -> OmniCameraDescription | None:
    """Return the camera of a robot's section; None where CamTexActors names none."""
    clients = section.structs("CamTexActors")
    if not clients:
        return None
    if not clients[0].text("ItemName"):  # as in USARSim: no name, no camera
        clients[0].pass_over()
        return None
    viewpoint = clients[0]
    viewpoint.text("ItemClass", "")
    viewpoint.text("Parent", "")
    mirror_item = _child(section, "StaticMeshes", viewpoint)
    capture_item = _child(section, "Cameras", viewpoint)
    mirror_settings = file.section(mirror_item.text("ItemClass"))
    capture = file.section(capture_item.text("ItemClass"))
    mirror = _mirror(mirror_item, mirror_settings)
    camera = _camera_law(mirror, mirror_settings, capture, capture_item)
    return OmniCameraDescription(
        name=capture_item.word("ItemName"),
        camera=camera,
        robot_from_mirror=_upright_pose(viewpoint),
        texture_clients=_texture_clients(file),
        wish=_wish(file, mirror_settings, capture),
        frame_interval_s=capture.number("FrameInterval", 0.0, at_least=0.0, at_most=60.0),
        capture_fov_rad=_rim_fov(camera),
        effects=read_effects(capture),
    )


def _child(section: Settings, key: str, viewpoint: Settings) -> Settings:
    """Return the item of a list that is mounted on the effective viewpoint."""
    name = viewpoint.text("ItemName")
    for item in section.structs(key):
        if item.text("Parent", "").lower() == name.lower():
            return item
    raise section.complain(key, expected=f'an item with Parent="{name}", placed at the viewpoint')


def _upright_pose(viewpoint: Settings) -> Pose:
    direction = viewpoint.vector("Direction", (0.0, 0.0, 0.0))
    return Pose.from_rpy(viewpoint.vector("Position"), direction)


def _mirror(item: Settings, settings: Settings) -> CentralMirror:
    if any(abs(value) > _PINHOLE_TOLERANCE_M for value in item.vector("Position", (0.0, 0.0, 0.0))):
        raise item.complain(
            "Position", expected="(X=0,Y=0,Z=0): meshes are placed by the viewpoint"
        )
    item.vector("Direction", (0.0, 0.0, 0.0))
    item.text("ItemName")
    metres = settings.number("MetresPerUnit", 0.1, at_least=1e-9)
    match settings.name.rpartition(".")[2].lower():
        case "hyperbolicmirror":
            k = settings.number("K", at_least=2.0)
            c_m = settings.number("C", at_least=0.0) * metres
            try:
                return HyperbolicMirror(k, c_m)
            except DomainError as error:
                raise settings.complain(
                    "K" if k <= 2.0 else "C", expected=f"a possible value: {error}"
                ) from error
        case "parabolicmirror":
            radius = settings.number("HorizonRadius", at_least=1e-9)
            return ParabolicMirror(radius * metres)
    raise item.complain(
        "ItemClass", expected="Catoptra.HyperbolicMirror or Catoptra.ParabolicMirror with a section"
    )


def _camera_law(
    mirror: CentralMirror, settings: Settings, capture: Settings, item: Settings
) -> OmniCamera:
    _refuse_misplaced(mirror, item)
    rim = settings.number("RimAngle", 120.0, at_least=1.0, at_most=179.0)
    try:
        return camera_with_rim_inscribed(
            mirror,
            width_px=capture.integer("ResolutionX", 360, at_least=1, at_most=_LARGEST_SIDE_PX),
            height_px=capture.integer("ResolutionY", 360, at_least=1, at_most=_LARGEST_SIDE_PX),
            rim_rad=math.radians(rim),
            up_azimuth_rad=_up_azimuth(item),
        )
    except DomainError as error:
        raise settings.complain("RimAngle", expected=f"a possible value: {error}") from error


def _refuse_misplaced(mirror: CentralMirror, item: Settings) -> None:
    """Refuse a capture camera beside the pinhole or the axis: the law holds only there."""
    position = np.asarray(item.vector("Position"))
    if math.isinf(mirror.pinhole_m):
        off = float(np.hypot(position[0], position[1]))
        place = "on the axis (X=0,Y=0)"
    else:
        off = float(np.linalg.norm(position - (0.0, 0.0, mirror.pinhole_m)))
        place = f"(X=0,Y=0,Z={mirror.pinhole_m:g}), the mirror's second focus"
    if off > _PINHOLE_TOLERANCE_M:
        raise item.complain(
            "Position", expected=f"the pinhole {place}; it is {1e3 * off:.3g} mm off"
        )
    forward = Pose.from_rpy((0, 0, 0), item.vector("Direction")).rotation[:, 0]
    if np.linalg.norm(forward - (0.0, 0.0, -1.0)) > _AXIS_TOLERANCE_RAD:
        raise item.complain("Direction", expected="a pitch Y=1.5708, looking up into the mirror")


def _up_azimuth(item: Settings) -> float:
    """Return the azimuth in the mirror frame that the top of the capture camera's picture shows."""
    rotation = Pose.from_rpy((0, 0, 0), item.vector("Direction")).rotation
    up = -rotation[:, 2]
    azimuth = math.atan2(float(up[1]), float(up[0]))
    # Directions in files have five digits: quarter turns are meant exactly.
    quarters = azimuth / (0.5 * math.pi)
    nearest = round(quarters)
    near = abs(quarters - nearest) < 1e-4
    return (nearest % 4) * 0.5 * math.pi if near else azimuth


def _rim_fov(camera: OmniCamera) -> float:
    """Return the capture camera's field of view over the rim; 0 for an orthographic one."""
    if math.isinf(camera.mirror.pinhole_m):
        return 0.0
    r, z = camera.mirror.surface(np.array(camera.rim_t))
    return 2.0 * math.atan2(float(r), camera.mirror.pinhole_m - float(z))


def _texture_clients(file: IniFile) -> tuple[TextureClient, ...]:
    """Return N, E, S, W, C, as USARSim spawns them, and U where the file has it."""
    clients = []
    for face in Face:
        section = file.section(f"USARBot.USARCameraTextureClient{face.name}")
        if face is Face.U and not file.has(section.name):
            continue
        fov = section.number("FOV", 90.0)
        if abs(fov - 90.0) > 1e-6:
            raise section.complain("FOV", expected="90: the faces of a cube")
        clients.append(
            TextureClient(
                face=face,
                texture=section.text("DestTexture", f"OmniCam{face.name}"),
                fov_rad=math.radians(fov),
                size_px=section.integer("TextureSize", 0, at_most=_LARGEST_SIDE_PX),
            )
        )
    return tuple(clients)


def _wish(file: IniFile, mirror: Settings, capture: Settings) -> RenderWish:
    return RenderWish(
        surface=_surface(mirror),
        samples=capture.integer("Samples", 0, at_most=16),
        face_size_px=max(client.size_px for client in _texture_clients(file)),
        face_samples=capture.integer("FaceSamples", 0, at_most=8),
        stride_px=capture.integer("TraceStride", 0, at_most=64),
        dial=Dial(
            max_error_px=capture.number("MaxErrorPx", 0.0, at_least=0.0, at_most=1000.0),
            budget_ms=capture.number("BudgetMs", 0.0, at_least=0.0, at_most=60_000.0),
        ),
    )


def _surface(mirror: Settings) -> Surface:
    """Return the polygon split of the mirror: Polygons=N, or Sectors= and Rings=; 0 = per pixel."""
    name = mirror.choice("Interpolation", [i.value for i in Interpolation], Interpolation.UV.value)
    interpolation = Interpolation(name)
    polygons = mirror.integer("Polygons", 0, at_most=1_000_000)
    sectors = mirror.integer("Sectors", 0, at_most=10_000)
    rings = mirror.integer("Rings", 0, at_most=10_000)
    if sectors or rings:
        if sectors < 3 or rings < 1:
            raise mirror.complain(
                "Sectors", expected="Sectors of at least 3 with Rings of at least 1"
            )
        return PolygonSplit(sectors, rings, interpolation)
    if not polygons:
        return PerPixel()
    if polygons < 4:
        raise mirror.complain("Polygons", expected="0 for the exact mirror, or at least 4")
    return split_for(polygons, interpolation)
