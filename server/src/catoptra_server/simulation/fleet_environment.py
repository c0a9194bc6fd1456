"""Environment of each robot of a fleet: the world, and the other robots as boxes."""

from __future__ import annotations

from collections.abc import Collection

from catoptra_server.sensors.sensor_environment import RayCaster, SensorEnvironment
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.pixel_view import NamedScene
from catoptra_server.simulation.robot import Robot
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import World


class FleetEnvironment:
    """World and robots as sensors and views meet them."""

    def __init__(
        self,
        robots: Collection[Robot],
        world: World,
        scene: SceneMesh,
        ray_caster: RayCaster,
        collision_index: CollisionIndex,
    ) -> None:
        """Create the environment of a fleet.

        Args:
            robots: All robots; a view, in which robots come and go.
            world: Tags, victims and GPS origin.
            scene: The world as triangles, for names of items.
            ray_caster: The world as sensors measure it.
            collision_index: Boxes of robots at their present poses.
        """
        self._robots = robots
        self._world = world
        self._scene = scene
        self._ray_caster = ray_caster
        self._collision_index = collision_index

    def sense(self, robot: Robot) -> SensorEnvironment:
        """Environment of a robot, with the other robots as boxes at their present poses."""
        world = self._world
        return SensorEnvironment(
            scene=self._ray_caster,
            robot_boxes=tuple(map(self._collision_index.bounding_box, self._others(robot))),
            rfid_tags=world.rfid_tags,
            victims=world.victims,
            gps_origin=world.gps_origin,
        )

    def name_things(self, robot: Robot) -> NamedScene:
        """Everything that a robot's cameras may see, by name."""
        others = self._others(robot)
        return NamedScene(
            self._scene,
            self._ray_caster,
            [other.name for other in others],
            [self._collision_index.bounding_box(other) for other in others],
        )

    def _others(self, robot: Robot) -> list[Robot]:
        return [other for other in self._robots if other is not robot]
