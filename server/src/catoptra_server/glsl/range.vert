// Provides the clip position of a vertex in one atlas cell, and its offset from the viewpoint.
// Twin: catoptra_server.render.projection.atlas.AtlasCell.clip_from_mirror.
uniform vec3 viewpoint;              // in the scene's frame: world axes, metres
uniform mat3 clip_from_scene;        // rows give x, y and w of the clip position
uniform vec2 depth_from_forward;     // z = first * w + second

in vec3 position;                    // in the scene's frame
out vec3 offset;                     // from the viewpoint

void main()
{
    offset = position - viewpoint;
    vec3 clip = clip_from_scene * offset;
    gl_Position = vec4(clip.xy, depth_from_forward.x * clip.z + depth_from_forward.y, clip.z);
}
