"""Decisions before a frame is rendered: renderer, plan, and the bound of the plan's error.

From settings to a plan: `render_planner` chooses for one camera, by explicit numbers
(`explicit_plan`) or by an accuracy target (`candidate_plans`, `error_bound`, `cost_model`,
`plan_choice`); `exposure_budget` limits the renderings of a long exposure. Nothing here needs a
GPU; nothing on a GPU decides.
"""

from __future__ import annotations
