"""Effects of the lens on the image: defocus, vignetting, misalignment, aberration, diffraction.

All of them act on linear radiance. Near defocus needs the range of each pixel; the others depend on
camera and lens alone, and most of their maps are computed once per camera.
"""
