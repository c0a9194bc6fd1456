"""Projection geometry in float64, without OpenGL: atlas, perspective image, lookup map, depth range.

`raster` uploads these results; the decisions of a plan and the tests read them without a device.
"""
