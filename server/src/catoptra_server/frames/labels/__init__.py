"""Ground truth of an image: what the rays of its pixels meet, without any error of the picture.

Rays go through the centres of the pixels by the exact camera model, whatever renderer, plan or
mirror mesh draws the picture; nothing is interpolated. Nothing is prepared before the first
request.
"""

from __future__ import annotations
