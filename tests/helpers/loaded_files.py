"""Mesh files and textures loaded whole, each by a reader of its own."""

from __future__ import annotations

from pathlib import Path

from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.world import mesh_files
from catoptra_server.world.scene_mesh import MeshPart
from catoptra_server.world.textures import Texture, TextureReader
from catoptra_server.world.world_description import MeshFile


def load_mesh_file(shape: MeshFile, memory: MemoryBudget | None = None) -> list[MeshPart]:
    """Meshes of a file, their textures decoded."""
    with TextureReader(memory) as textures:
        meshes = mesh_files.MeshFileLoader([shape], textures).load(shape)
        for mesh in meshes:
            textures.wait(mesh.appearance.texture)
    return meshes


def load_texture(path: Path) -> Texture:
    """Decoded texture of an image file."""
    with TextureReader() as textures:
        texture = textures.load(path)
        textures.wait(texture)
    return texture
