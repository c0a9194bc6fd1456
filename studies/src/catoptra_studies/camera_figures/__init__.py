"""Pictures of the camera itself, without a socket: faces, cube, rings, mirrors, comparisons."""
