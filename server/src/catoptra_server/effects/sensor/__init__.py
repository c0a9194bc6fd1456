"""Effects of the image sensor: exposure, gain, blooming, noise, converter, mosaic, white balance.

Radiance 1 fills a pixel's well here. The noise model is EMVA Standard 1288's; random numbers depend
on the noise seed and the effect's name alone, never on the number of frames before.
"""
