"""Ambient occlusion, computed once for a scene: by rays, on grids over its flat surfaces."""
