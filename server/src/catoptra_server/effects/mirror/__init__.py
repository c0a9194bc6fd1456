"""Effects of the mirror's surface on the image: the metal's reflectance, dust and scratches.

Both are functions of the position on the mirror, constant for a camera: maps that are computed once
and multiply or mix the linear image.
"""
