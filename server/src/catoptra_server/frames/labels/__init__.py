"""Ground truth of an exposure: what the rays of the pixels meet, without any error of the picture.

Rays of the exact camera model through the centres of the pixels, whatever renderer, plan or mirror
mesh draws the picture; ids are never interpolated. A camera whose labels nobody requests costs
nothing here.
"""

from __future__ import annotations
