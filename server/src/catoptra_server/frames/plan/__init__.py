"""Plans of cameras: renderer, numbers and error bound, chosen before a frame is rendered.

`planner` chooses for one camera: by explicit numbers (`plans`), or by an accuracy target among
candidates with an error bound (`error_bound`) and a predicted time (`costs`). Nothing here needs
a GPU, and nothing on a GPU decides. Frames enter by `frame_plan` alone.
"""

from __future__ import annotations
