"""The world as data: descriptions of shapes, lights and landmarks, and the triangles made of them.

From description to triangles: `world_description`, `primitives` and `mesh_files` for single shapes,
`scene_mesh` for the static world, `dynamic_object` for robots. No module here imports a renderer.
"""

from __future__ import annotations
