"""Effects that change the scene before it is rendered: objects, shadows, fog, exposure times.

Each one adds to the camera state (`apply_to_scene`); the renderers then draw the ego body like any
object, trace or map shadows, fog samples by their distances, and average renderings at several
times.
"""
