"""The reference of the native kernel: single rays in NumPy and float64.

Short instead of fast: each light, texture and sample is computed for every ray by the functions of
`world/shading.py`. Serves, two hundred times slower and with a warning, where the kernel cannot.
Before the kernel NumPy was the product, with packed radiance and silhouettes followed through the
image, at half to a fifth of the kernel's speed.
"""
