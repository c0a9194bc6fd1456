"""The reference of the native kernel: float64 in NumPy around single rays of Embree.

Short instead of fast: each light, texture and sample is computed for every ray by the functions of
`scene/shading`. Serves where the kernel cannot.
"""
