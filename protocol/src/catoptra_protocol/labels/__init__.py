"""Labels of an image, known from what each ray meets: channels of pixels, objects, boxes.

A channel has one value, or a few, for each pixel of the picture; its ray is that of the pixel's
centre. Lengths are metres along the ray, directions are in the mirror
frame, positions in the world.
"""
