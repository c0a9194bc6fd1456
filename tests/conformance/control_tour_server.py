"""A server for the tour: a robot with every sensor in a room that is open to one side."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from conformance.check import ServerUnderTest
from conformance.server_setup import server_under_test
from helpers.cell_world import write_sensor_robot
from helpers.server_process import start_server

# Walls ahead and on both sides; behind the robot is nothing, so that rays have no echo there. Boxes
# make directions look different. Start poses are metres apart, for the resolution of a GPS.
_WORLD = """\
[Catoptra.World]
Name=Tour
Lights=(Type=Hemisphere,Up=(R=200,G=200,B=200),Down=(R=150,G=150,B=150))
GpsOrigin=(Latitude=39.1339,Longitude=-77.2167)
Rectangles=(Name="Floor",Position=(X=0,Y=0,Z=0),Size=(X=80,Y=80),Colour=(R=120,G=120,B=120))
Boxes=(Name="Ahead",Position=(X=14.5,Y=6,Z=-0.5),Size=(X=0.1,Y=5,Z=1),Colour=(R=200,G=200,B=200))
Boxes=(Name="WallRight",Position=(X=12,Y=8.3,Z=-0.5),Size=(X=5,Y=0.1,Z=1),Colour=(R=200,G=200,B=200))
Boxes=(Name="WallLeft",Position=(X=12,Y=4.1,Z=-0.5),Size=(X=3,Y=0.1,Z=1),Colour=(R=200,G=200,B=200))
Boxes=(Name="BoxRight",Position=(X=13.2,Y=7.5,Z=-0.5),Size=(X=0.6,Y=0.3,Z=1),Colour=(R=200,G=90,B=90))
Boxes=(Name="BoxLeft",Position=(X=12.3,Y=4.5,Z=-0.5),Size=(X=0.3,Y=0.5,Z=1),Colour=(R=90,G=90,B=200))
PlayerStarts=(Tag="Room",Location=(X=12,Y=6,Z=0))
PlayerStarts=(Tag="North",Location=(X=25,Y=8,Z=0),Rotation=(X=0,Y=0,Z=0.7))
PlayerStarts=(Tag="East",Location=(X=-5,Y=30,Z=0),Rotation=(X=0,Y=0,Z=-1.2))
PlayerStarts=(Tag="South",Location=(X=-20,Y=-25,Z=0),Rotation=(X=0,Y=0,Z=2.3))
RfidTags=(ID=1001,Position=(X=13,Y=7,Z=-0.5))
Victims=(Name="Chest",Position=(X=14.2,Y=6.4,Z=-0.4))
Victims=(Name="Leg",Position=(X=14.1,Y=5.7,Z=-0.9))
Victims=(Name="Head",Position=(X=12.7,Y=7.2,Z=-0.8))
Victims=(Name="Arm",Position=(X=12.6,Y=4.9,Z=-0.8))
"""
_SENSORS = """
+Sensors=(ItemClass=class'USARSensor.Tachometer',ItemName="Tach",Position=(X=0,Y=0,Z=0),Direction=(X=0,Y=0,Z=0))
JointParts=(PartName="FRFlipper",JointClass=class'KDHinge',ParentPos=(X=0.185,Y=0.110,Z=0),ParentAxis=(X=0,Y=-1,Z=0),MinRange=-2.086,MaxRange=2.086)
MotorSpeed=0.7
MotorTorque=20.0
"""
CLASS = "USARBot.OmniP2AT"
SPAWN_POSE = "{Start Room}"


def write_tour_world(folder: Path) -> Path:
    """Write the world, and return the path of its file."""
    path = folder / "tour.ini"
    path.write_text(_WORLD, encoding="utf-8")
    return path


def write_tour_robot(folder: Path) -> Path:
    """Write the robot, and return the path of its file: the bundled one and what it lacks."""
    path = write_sensor_robot(folder)
    text = path.read_text(encoding="utf-8")
    text = text.replace("\n\n[USARBot.SICKLMS]", f"{_SENSORS}\n[USARBot.SICKLMS]")
    # Less noise than the distance between start poses allows to average away.
    text = re.sub(r"(\[USARBot\.GPSSensor\][^[]*Noise=)1\.0", r"\g<1>0.1", text)
    # The scanner in the plane of the sonars: what one sees the others see.
    text = re.sub(r'("Scanner1",[^(]*\([^)]*Z=)-[\d.]+', r"\g<1>0.0", text)
    # And an INS on a mast: its pose is not the robot's.
    text = re.sub(r'("INS",[^(]*\([^)]*Z=)0', r"\g<1>-0.2", text)
    text += "\n[USARSensor.Tachometer]\nScanInterval=0.1\n"
    path.write_text(text, encoding="utf-8")
    return path


@contextmanager
def run_tour_server(folder: Path, dialect: str = "ut2004") -> Iterator[ServerUnderTest]:
    """Serve for the length of a block."""
    robot, world = write_tour_robot(folder), write_tour_world(folder)
    with start_server(folder, "--dialect", dialect, robot=robot, world=world) as running:
        yield server_under_test(running, robot_class=CLASS, spawn_pose=SPAWN_POSE, dialect=dialect)
