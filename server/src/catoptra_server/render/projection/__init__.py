"""Projection geometry in float64, without OpenGL: atlas, lookup map, large triangles, shadow maps.

`raster` uploads these results; planning and tests use them without a device.
"""
