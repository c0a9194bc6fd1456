"""Files broken in the ways that users break them: each message names the line and the remedy.

A case replaces a text of a whole file. The message has to start with the line of the replacement,
or with the line of another text where the case states one; empty = the file as a whole.
"""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.startup import read_startup_config

ROBOT = """\
[USARBot.Mine]
SteeringType=SkidSteered
Dimensions=(X=0.5,Y=0.4,Z=0.3)
WheelRadius=0.13
WheelSeparation=0.4
WheelBase=0.3
RideHeight=0.15
Mass=14.0
MaxSpeed=5.4
StaticMeshes=(ItemClass=class'Catoptra.HyperbolicMirror',ItemName="Mirror",Parent="Eye")
CamTexActors=(ItemName="Eye",Position=(X=0,Y=0,Z=-0.45))
Cameras=(ItemClass=class'Catoptra.OmniCaptureCamera',ItemName="Omni",Parent="Eye")
Sensors=(ItemClass=class'USARBot.OdometrySensor',ItemName="Odometry",Position=(X=0,Y=0,Z=0))
[Catoptra.HyperbolicMirror]
K=11.546
C=2.321
RimAngle=120
[USARBot.USARCameraTextureClientN]
FOV=90
[USARBot.USARCameraTextureClientE]
[USARBot.USARCameraTextureClientS]
[USARBot.USARCameraTextureClientW]
[USARBot.USARCameraTextureClientC]
[Catoptra.OmniCaptureCamera]
ResolutionX=32
ResolutionY=32
"""
WORLD = """\
[Catoptra.World]
Boxes=(Name="box",Size=(X=1,Y=1,Z=1),Position=(X=3,Y=0,Z=-0.5))
Lights=(Type=Hemisphere)
PlayerStarts=(Tag="Door",Location=(X=0,Y=0,Z=0))
"""
LANDMARKS = """\
name,kind,x_m,y_m,width_m,depth_m,band_bottom_m,band_top_m,lower_colour,upper_colour
a,beacon,1,2,0.1,0,0.2,0.4,cyan,yellow
"""
CAPTURE_ITEM = 'ItemName="Omni",Parent="Eye"'
SENSOR = "Sensors=(ItemClass=class'USARBot.OdometrySensor',ItemName=\"Odometry\""
TRUTH = ',ItemName="Truth")\n[USARBot.GroundTruth]\nDecimals=2.5\nRest=('


# old, new, text of the line that the message names (default: that of `new`), part of the message
ROBOT_CASES = [
    ("RimAngle=120", "RimAngel=120", None, "did you mean RimAngle?"),
    ("K=11.546", "K=11.546\nPolygon=16", "Polygon=", "did you mean Polygons?"),
    ("ResolutionX=", "ResolutonX=", None, "did you mean ResolutionX?"),
    ("ResolutionX=32", "Vigneting=auto", None, "did you mean Vignetting?"),
    ("[Catoptra.OmniCapt", "[Catoptra.OmnCapt", None, "Catoptra.OmniCaptureCamera"),
    ("[Catoptra.Hyper", "[Catoptra.Hyber", None, "is [Catoptra.HyberbolicMirror] meant to be it?"),
    ("'Catoptra.Hyperbolic", "'Catoptra.Hyper", None, "Catoptra.ParabolicMirror"),
    ("CamTexActors=", "CamTexActor=", "[USARBot.Mine]", 'such as (ItemName="Eye",'),
    ('(ItemName="Eye"', '(ItemName="Eyes"', "StaticMeshes=", 'an item with Parent="Eyes"'),
    ("StaticMeshes=", "StaticMesh=", "[USARBot.Mine]", "is StaticMesh meant to be it?"),
    (CAPTURE_ITEM, CAPTURE_ITEM + ",Position=(Z=0.3)", None, "it is 67.9 mm off"),
    (CAPTURE_ITEM, CAPTURE_ITEM + ",Position=(X=0.1,Z=0.2321)", None, "it is 100 mm off"),
    (CAPTURE_ITEM, CAPTURE_ITEM + ",Direction=(Y=0)", None, "looking up into the mirror"),
    ("FOV=90", "FOV=80", None, "90: the faces of a cube"),
    (CAPTURE_ITEM, CAPTURE_ITEM + ",Position=(Z=0.2322)", None, "or no Position; it is 0.1 mm off"),
    ("Z=-0.45", "Z=abc", None, "Position.Z='abc': expected a number"),
    ("Y=0,Z=-0.45", "Y=1e6,Z=-0.45", None, "within 100 m"),
    ('"Omni",', '"Omni Cam",', None, "Cameras.ItemName='\"Omni Cam\"': expected one word"),
    ("RimAngle=120", "RimAngle=175", None, "below 155.405 deg"),
    ("RimAngle=120", "RimAngle=0", None, "from 1 to 179"),
    ("RimAngle=120", "Interpolation=cubic", None, "one of uv, position"),
    ("K=11.546", "K=2", None, "k > 2"),
    ("K=11.546", "K=1.9", None, "at least 2"),
    ("K=11.546", "K=nan", None, "a number of at least 2"),
    ("K=11.546", "K=11,546", None, "a number of at least 2"),
    ("K=11.546\n", "", "[Catoptra.Hyper", "it is missing"),
    ("C=2.321", "C=0", None, "a possible value: a hyperbolic mirror needs c > 0"),
    ("C=2.321", "C=-2.321", None, "of at least 0"),
    ("RimAngle=120", "Polygons=17", None, "such as 16: 17 is one ring"),
    ("RimAngle=120", "Polygons=3", None, "0 for the exact mirror, or at least 4"),
    ("RimAngle=120", "Sectors=8", None, "Sectors of at least 3 with Rings of at least 1"),
    ("ResolutionX=32", "Samples=0", None, "a whole number from 1 to 16"),
    ("ResolutionX=32", "Samples=17", None, "a whole number from 1 to 16"),
    ("ResolutionX=32", "Samples=2x2", None, "a whole number from 1 to 16"),
    ("ResolutionX=32", "ResolutionX=0", None, "from 1 to 8192"),
    ("ResolutionX=32", "ResolutionX=100000", None, "from 1 to 8192"),
    ("ResolutionX=32", "BudgetMs=soon", None, "BudgetMs='soon': expected a number"),
    ("ResolutionX=32", "Fog=on", None, "one of auto, always, never"),
    ("ResolutionX=32", "ExposureTime=0", None, "from 1e-06 to 60"),
    ("ResolutionX=32", "ResponseCurve=bt708", None, "there is no bt708"),
    ("ResolutionX=32", "Response=auto\nResponseCurve=falls.csv", "ResponseC", "row 3 has another"),
    ("ResolutionX=32", "Response=auto\nResponseCurve=step.csv", "ResponseC", "without steps"),
    ("ResolutionX=32", "Response=auto\nResponseCurve=empty.glb", "ResponseC", "two rows at least"),
    ("ResolutionX=32", "WhiteBalance=auto\nRedGain=0", "RedGain", "from 0.05 to 20"),
    ("ResolutionX=32", "MaxErrorPx=-1", None, "from 0 to 1000"),
    ("SkidSteered", "Ackermann", None, "one of SkidSteered"),
    ("WheelRadius=0.13", "WheelRadius=0", None, "from 0.001 to 10"),
    ("WheelRadius=0.13", "WheelRadus=0.13", "[USARBot.Mine]", "is WheelRadus meant to be it?"),
    ("Mass=14.0", "Mass=14 kg", None, "a number of at least 0"),
    ("Mass=14.0", "Mass=14.0\nTurnSlip=1.5", "TurnSlip", "from 0 to 0.9"),
    ("Mass=14.0", "Mass=14.0\nmsgTimer=0", "msgTimer", "from 0.01 to 60"),
    ("Y=0.4", "Y=-1", None, "Dimensions.Y='-1': expected a number from 0.001 to 100"),
    ("(X=0.5,Y=0.4,Z=0.3)", "(X=0.5", None, "a struct such as (X=0,Y=0,Z=0)"),
    ("(X=0.5,", "(", None, "Dimensions.X='': expected a number from 0.001 to 100; it is missing"),
    ("(X=0.5,Y=0.4,Z=0.3)", "0.5", None, "a struct such as (X=0,Y=0,Z=0)"),
    ("(X=0.5,Y=0.4,Z=0.3)", "(X=0.5;Y=0.4;Z=0.3)", None, "a ; has made the rest a comment"),
    (',ItemName="Odometry"', "", "Sensors=", "Sensors.ItemName"),
    ('="Odometry"', '="Odo metry"', None, "one word without spaces"),
    ('="Odometry"', '=""', "Sensors=", "Sensors.ItemName='\"\"': expected one word"),
    ('="Odometry"', '="a{b"', None, "Sensors.ItemName='\"a{b\"': expected one word"),
    (SENSOR, SENSOR + f")\n{SENSOR}", 14, "robot.ini:13 has it"),
    ("OdometrySensor'", f"GroundTruth'{TRUTH}", "Decimals", "a whole number from 0 to 12"),
    ("[USARBot.Mine]", "SteeringType=SkidSteered\n[A.B]", "Steer", "a [Package.Class] first"),
    ("[USARBot.Mine]", "[USARBot.Mine", None, "[Package.Class]"),
    ("[USARBot.Mine]", "[USARBot.My own]", None, "one word"),
    (ROBOT, "", "", "a section such as [USARBot.MyRobot] with SteeringType=SkidSteered"),
    (ROBOT, WORLD, "", "this is a world's file"),
    (ROBOT, "[Configuration]\nBasedOn=p2at_omnii\n", "Based", "did you mean p2at_omni?"),
    (ROBOT, "[Configuration]\nBasedOn=robot.ini\n", "Based", "a file that is not based on this"),
]  # fmt: skip

# A line to add to the world, and a part of the message; `None` for the world's text as a whole.
WORLD_CASES = [
    ("Boxs=(Size=(X=1,Y=1,Z=1))", "did you mean Boxes?"),
    ("Mesh=(File=box.glb)", "did you mean Meshes?"),
    ("Light=(Type=Hemisphere)", "did you mean Lights?"),
    ('PlayerStart=(Tag="A",Location=(X=0))', "did you mean PlayerStarts?"),
    ("Bakground=(R=1)", "did you mean Background?"),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Positon=(X=0))", "did you mean Position?"),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Color=(R=30))", "did you mean Colour?"),
    ("Boxes=(Sise=(X=1,Y=1,Z=1))", "is Sise meant to be it?"),
    ("Boxes=(Size=(X=1,Y=1))", "Size.Z='': expected a number from 1e-06 to 100000; it is missing"),
    ("Boxes=(Size=(X=-1,Y=1,Z=1))", "Size.X='-1': expected a number from 1e-06"),
    ("Boxes=(Size=(X=1,Y=1,Z=1)", "a parenthesis is missing"),
    ('Boxes=(Name="b,Size=(X=1,Y=1,Z=1))', "a quotation mark is missing"),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Position=(X=1e6))", "from -100000 to 100000"),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Colour=(R=300))", "from 0 to 255"),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Unlit=yes)", "true or false"),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Texture=no.png)", "there is no "),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Texture=cutt.png)", "did you mean cut.png?"),
    ("Boxes=(Name=b,Size=(X=1,Y=1,Z=1),Texture=cut.png)", "b.Texture="),
    ("Boxes=(Name=b,Size=(X=1,Y=1,Z=1),Texture=box.glb)", "it is damaged, or none of PNG, JPEG"),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Texture=folder.glb)", "is a folder"),
    ("Cylinders=(Radius=1,Heigth=2)", "is Heigth meant to be it?"),
    ("Rings=(InnerRadius=2,OuterRadius=1)", "from 2 to"),
    ("SphereBands=(Radius=1,From=90,To=10)", "from 90 to 180"),
    ("Meshes=(Name=house,File=cut.glb)", "it is cut off"),
    ("Meshes=(Name=house,File=empty.glb)", "it is empty"),
    ("Meshes=(File=none.glb)", "there is no "),
    ("Meshes=(File=boxx.glb)", "did you mean box.glb?"),
    ("Meshes=(File=folder.glb)", "is a folder"),
    ("Meshes=(Name=house,File=points.obj)", "house.File="),
    ("Meshes=(File=nan.obj)", "corners within 1e+06 m at Scale=1"),
    ("Meshes=(File=box.glb,Scale=1e8)", "corners within 1e+06 m at Scale=1e+08"),
    ("Meshes=(File=box.glb,Scale=(X=0))", "Scale.X='0': expected a factor of at least"),
    ("Boxes=(Size=(X=1,Y=1,Z=1),Scale=2)", "a struct such as (X=1,Y=-1,Z=2)"),
    ("Meshes=(File=part.step)", ".glb, .gltf, .obj, .ply, .stl, .dae"),
    ("Meshes=(File=bare.gltf)", "its buffer none.bin is not a file inside"),
    ("Meshes=(File=box.glb,Up=w)", "one of x, y, z"),
    ("Meshes=(File=box.glb,Scale=0)", "from 1e-09"),
    ("Lights=(Type=Spot)", "one of Hemisphere, Directional, Point"),
    ("Lights=(Type=Point)", "Lights.Position='': expected a struct such as (X=0,Y=0,Z=0)"),
    ("Lights=(Type=Directional,Direction=(X=0))", "a direction that is not zero"),
    ("Lights=(Type=Hemisphere,Brightness=inf)", "Lights.Brightness='inf': expected a number"),
    ("Lights=(Type=Hemisphere,Brightness=nan)", "Lights.Brightness='nan': expected a number"),
    ('PlayerStarts=(Tag="a b",Location=(X=0))', "one word without spaces"),
    ('PlayerStarts=(Tag="door",Location=(X=1))', "a name that no other start has; line 4 has it"),
    ("Background=black", "a struct such as (R=0,G=0,B=0)"),
    ("Background=none.hdr", "there is no "),
    ("Background=cut.hdr", "a panorama in Radiance HDR, of a whole file: it is cut off"),
    ("Background=huge.hdr", "100000 x 10000 px"),
    ("Background=folder.hdr", "is a folder"),
    ("Sky=(Elevation=91)", "Sky.Elevation='91': expected a number from 0 to 90"),
    ("Sky=(Azimuth=90)", "Sky.Elevation='': expected a number from 0 to 90; it is missing"),
    ("Sky=(Elevation=40,Turbidity=0)", "Sky.Turbidity='0': expected a number from 1 to 10"),
    ("Sky=(Elevation=40,Clouds=2)", "Sky.Clouds='2': expected a number from 0 to 1"),
    ("Sky=(Elevation=40,Clouds=nan)", "Sky.Clouds='nan': expected a number from 0 to 1"),
    ("Sky=40", "a struct such as (Elevation=40,Azimuth=120"),
    ("Landmarks=four_legged_2007", "did you mean four_legged_2006?"),
    ("Landmarks=folder.glb", "is a folder"),
    ("RfidTags=(ID=x,Position=(X=1))", "a whole number of at least 0"),
    ("GpsOrigin=(Latitude=95,Longitude=0)", "from -89 to 89"),
]

LANDMARK_CASES = [
    ("y_m,", "", 1, "missing: y_m"),
    ("name,kind", "# 2026\nid,kind", 2, "missing: name; unknown: id"),
    ("a,beacon,1,", "a,beacon,one,", 2, "x_m='one'"),
    (",yellow\n", ",yellow\na,beacon,1,2,0.1,0,0.2,0.4,cyan,cyan\n", 3, "each name only once"),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder of a whole robot, a whole world, a mesh and damaged files."""
    (tmp_path / "robot.ini").write_text(ROBOT)
    (tmp_path / "world.ini").write_text(WORLD)
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.glb")
    glb = (tmp_path / "box.glb").read_bytes()
    (tmp_path / "cut.glb").write_bytes(glb[: len(glb) // 2])
    (tmp_path / "empty.glb").write_bytes(b"")
    (tmp_path / "folder.glb").mkdir()
    (tmp_path / "folder.hdr").mkdir()
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
    (tmp_path / "cut.hdr").write_bytes(head + b"-Y 16 +X 32\n" + b"\2\2\0\40\240")
    (tmp_path / "huge.hdr").write_bytes(head + b"-Y 10000 +X 100000\n")
    (tmp_path / "falls.csv").write_text("light,grey\n0,0\n0.5,200\n1,190\n")
    (tmp_path / "step.csv").write_text("0 0\n0.5 10\n0.501 240\n1 255\n")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    (tmp_path / "nan.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    (tmp_path / "bare.gltf").write_text(
        '{"asset":{"version":"2.0"},"buffers":[{"uri":"none.bin","byteLength":36}],'
        '"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],'
        '"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],'
        '"bufferViews":[{"buffer":0,"byteLength":36}]}'
    )
    (tmp_path / "cut.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(40))
    return tmp_path


def read(folder: Path, *, is_strict: bool = False) -> None:
    startup = read_startup_config([folder / "robot.ini"], folder / "world.ini", is_strict=is_strict)
    assert np.isfinite(startup.scene.corners).all()


def read_message(folder: Path) -> str:
    """Message of the error that a folder's files raise, without the folder."""
    with pytest.raises(ConfigError) as caught:
        read(folder)
    return str(caught.value).replace(f"{folder}/", "")


def find_line(text: str, part: str) -> int:
    """Number of the line that contains a text."""
    assert part in text
    return text[: text.index(part)].count("\n") + 1


def test_whole_files_are_read_without_a_warning(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        read(folder, is_strict=True)
    assert not caplog.messages


@pytest.mark.parametrize(("old", "new", "at", "expected"), ROBOT_CASES)
def test_robot_s_message_names_line_and_remedy(
    folder: Path, old: str, new: str, at: str | int | None, expected: str
) -> None:
    assert ROBOT.count(old) == 1, "an edit is of one place"
    text = ROBOT.replace(old, new)
    (folder / "robot.ini").write_text(text)
    message = read_message(folder)
    line = at if isinstance(at, int) else at != "" and find_line(text, at or new)
    assert message.startswith(f"robot.ini:{line}: " if line else "robot.ini: ")
    assert expected in message


@pytest.mark.parametrize(("line", "expected"), WORLD_CASES)
def test_world_s_message_names_line_and_remedy(folder: Path, line: str, expected: str) -> None:
    (folder / "world.ini").write_text(WORLD + line + "\n")
    message = read_message(folder)
    assert message.startswith("world.ini:5: ")
    assert expected in message


@pytest.mark.parametrize(
    ("text", "place", "expected"),
    [
        ("", "world.ini: ", "expected [Catoptra.World]"),
        (WORLD.replace("World", "Wrold"), "world.ini:1: ", "expected [Catoptra.World]"),
        ("[Catoptra.World]\nBox=(Size=(X=1,Y=1,Z=1))\n", "world.ini:2: ", "did you mean Boxes?"),
        ("[Catoptra.World]\nName=w\n", "world.ini:1: ", "at least one visible object"),
        (
            WORLD + "[Catoptra.LandmarkColors]\ncyan=(R=1)\n",
            "world.ini:5: ",
            "a section in use: Catoptra.LandmarkColours",
        ),
    ],
)
def test_world_s_message_names_the_section(
    folder: Path, text: str, place: str, expected: str
) -> None:
    (folder / "world.ini").write_text(text)
    message = read_message(folder)
    assert message.startswith(place)
    assert expected in message


@pytest.mark.parametrize(("old", "new", "line", "expected"), LANDMARK_CASES)
def test_landmarks_message_names_line_and_remedy(
    folder: Path, old: str, new: str, line: int, expected: str
) -> None:
    assert old in LANDMARKS
    (folder / "mine.csv").write_text(LANDMARKS.replace(old, new, 1))
    (folder / "world.ini").write_text(WORLD + "Landmarks=mine.csv\n")
    message = read_message(folder)
    assert message.startswith(f"mine.csv:{line}: ")
    assert expected in message


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("Mass=14.0", "Mass=14\nTurnSlipp=0.1", "key TurnSlipp is unknown and has no effect; "
                                                "did you mean TurnSlip?"),
        ("USARBot.OdometrySensor", "USARBot.OdometrySenso", "did you mean odometrysensor?"),
        ("[USARBot.USARCameraTextureClientE]", "", "no section [USARBot.USARCameraTextureClientE]"),
        (ROBOT, ROBOT + "[USARBot.Talon]\nbatteryLife=9\n", "not served: USARBot.Talon"),
    ],
)  # fmt: skip
def test_robot_s_warning_names_what_has_no_effect(
    folder: Path, caplog: pytest.LogCaptureFixture, old: str, new: str, expected: str
) -> None:
    (folder / "robot.ini").write_text(ROBOT.replace(old, new))
    with caplog.at_level(logging.WARNING):
        read(folder)
    assert expected in caplog.text
