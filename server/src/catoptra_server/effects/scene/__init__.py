"""Effects that change the scene before it is rendered: objects, shadows, times of the exposure.

Each one adds to the camera state (`apply_to_scene`); the renderers then draw the ego body like any
object, trace or map shadows, and average renderings at several times. None has a shader.
"""
