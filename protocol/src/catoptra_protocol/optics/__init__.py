"""Camera models: pure float64 functions on frozen parameters, with a mask beside each value.

Frames are SAE (x forward, y right, z down). The mirror frame has its origin in the effective
viewpoint and +z towards the pinhole, straight down on an upright robot. See `transforms`.
"""
