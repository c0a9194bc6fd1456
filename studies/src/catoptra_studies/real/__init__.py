"""Photographs of boards through a real camera, compared with pictures of a twin of the scene."""
