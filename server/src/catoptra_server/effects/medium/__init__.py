"""Effects of air and lens on the image: fog, defocus, misalignment, aberration, diffraction.

All of them act on linear radiance. Fog and near defocus need the range of each pixel; the lens
effects depend on camera and lens alone, and most of their maps are computed once per camera.
"""
