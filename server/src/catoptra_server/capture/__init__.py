"""State of a camera in one exposure: pose, motion, objects in view, shutter and noise seed."""
