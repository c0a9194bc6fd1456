"""Driving the robots of others: only shared ones, and none rolls on without its driver."""

from __future__ import annotations

import pytest

from catoptra_protocol.usarsim.commands import Drive, Init, ShareControl
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.world.scene_mesh import build_scene
from helpers.robots import FakeClient, make_p2at, make_walled_world

ROLLING = (1.0, -1.0)


class SharingFleet:
    """Fleet of an owner's robot, and another client without one."""

    def __init__(self, *, shared: bool = True) -> None:
        world = make_walled_world()
        self.fleet = Fleet([make_p2at()], world, build_scene(world), seed=1)
        self.owner, self.driver = FakeClient(), FakeClient()
        init = Init("USARBot.OmniP2AT", name="R", location_m=(0.0, 0.0, 0.0))
        self.fleet.execute(self.owner, init, 0.0)
        if shared:
            self.fleet.execute(self.owner, ShareControl(True), 0.0)

    def drive(
        self, client: FakeClient, left: float | None = 1.0, right: float | None = -1.0
    ) -> str:
        """Drive the robot by its name; the reason against it."""
        return self.fleet.drive_by_name(client, "R", Drive(left, right), 0.0)

    @property
    def speeds(self) -> tuple[float, float]:
        """Commanded wheel speeds of the robot."""
        robot = self.fleet.find_robot(self.owner)
        assert robot is not None
        return robot.wheel_speeds_rad_s


def test_robot_when_shared_is_driven_by_others() -> None:
    sharing = SharingFleet()
    assert sharing.drive(sharing.driver) == ""
    assert sharing.speeds == ROLLING


def test_robot_when_not_shared_is_driven_by_its_owner_only() -> None:
    sharing = SharingFleet(shared=False)
    assert "does not share its control" in sharing.drive(sharing.driver)
    assert sharing.speeds == (0.0, 0.0)
    assert sharing.drive(sharing.owner) == ""
    assert sharing.speeds == ROLLING


@pytest.mark.parametrize("name", ["", "r", "R2", "R\n"])
def test_robot_when_unknown_is_not_driven(name: str) -> None:
    sharing = SharingFleet()
    reason = sharing.fleet.drive_by_name(sharing.driver, name, Drive(1.0, 1.0), 0.0)
    assert reason == f"there is no robot {name!r}"
    assert sharing.speeds == (0.0, 0.0)


def test_robot_when_its_owner_has_left_is_unknown() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver)
    sharing.fleet.remove(sharing.owner)
    assert "no robot 'R'" in sharing.drive(sharing.driver)
    # Nothing is left to halt.
    sharing.fleet.halt_robots_driven_by(sharing.driver, 0.0)


def test_robot_when_no_longer_shared_halts() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver)
    sharing.fleet.execute(sharing.owner, ShareControl(False), 0.0)
    assert sharing.speeds == (0.0, 0.0)
    assert "does not share" in sharing.drive(sharing.driver)


def test_robot_when_driven_by_its_owner_rolls_on_as_the_sharing_ends() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver)
    sharing.fleet.execute(sharing.owner, Drive(2.0, 2.0), 0.0)
    sharing.fleet.execute(sharing.owner, ShareControl(False), 0.0)
    assert sharing.speeds == (2.0, 2.0)


def test_robot_when_its_driver_disconnects_halts() -> None:
    sharing, other = SharingFleet(), FakeClient()
    sharing.drive(sharing.driver)
    sharing.fleet.halt_robots_driven_by(other, 0.0)
    assert sharing.speeds == ROLLING
    sharing.fleet.halt_robots_driven_by(sharing.driver, 0.0)
    assert sharing.speeds == (0.0, 0.0)


def test_robot_when_another_has_taken_over_rolls_on_as_its_former_driver_disconnects() -> None:
    sharing, other = SharingFleet(), FakeClient()
    sharing.drive(sharing.driver)
    sharing.drive(other, 0.5, 0.5)
    sharing.fleet.halt_robots_driven_by(sharing.driver, 0.0)
    assert sharing.speeds == (0.5, 0.5)


def test_robot_when_halted_by_its_driver_is_no_longer_driven() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver)
    sharing.drive(sharing.driver, 0.0, 0.0)
    sharing.fleet.execute(sharing.owner, Drive(2.0, 2.0), 0.0)
    sharing.fleet.halt_robots_driven_by(sharing.driver, 0.0)
    assert sharing.speeds == (2.0, 2.0)


def test_speeds_of_others_are_limited_as_those_of_the_owner() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver, 1e300, -1e300)
    assert sharing.speeds == (5.385, -5.385)


def test_sharing_without_a_robot_has_no_effect() -> None:
    sharing = SharingFleet(shared=False)
    sharing.fleet.execute(sharing.driver, ShareControl(True), 0.0)
    assert "does not share" in sharing.drive(sharing.driver)
