"""Figures of the camera itself, rendered without a socket: faces, cube, rings, mirror meshes."""
