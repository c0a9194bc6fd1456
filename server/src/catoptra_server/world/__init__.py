"""The world as data: descriptions of shapes, lights and landmarks, and the triangles made of them.

From description to triangles: `world_description`, `shapes` and `mesh_files` for single shapes,
`scene_mesh` for the static world, `objects` for robots. No module here imports a renderer.
"""

from __future__ import annotations
