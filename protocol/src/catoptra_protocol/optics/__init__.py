"""The camera law: float64, pure functions, frozen parameters, value and validity.

Frames are SAE (x forward, y right, z down); the mirror frame has its origin in the effective
viewpoint and +z towards the pinhole, straight down on an upright robot. See `frames`.
"""
