"""Bounds on the content of a frame before rendering: radiance, distances, speeds, shadows.

Criteria of effects read them as one `SceneSummary`; `scene_summarizer` makes a summary of a camera
state, the other modules one bound each. Every number errs on the safe side and is rounded outward,
so that a driving robot meets the same summary, and so the same cached decision, for many frames.
There is no hysteresis: a decision follows from the camera state alone.
"""

from __future__ import annotations
