// Provides the clip position of a shadow caster's corner in the map of one light.
// Twin: catoptra_server.render.projection.shadow_projections.ShadowProjection.clip_from_scene.
uniform mat4 clip_from_scene;

in vec3 position;                    // in the scene's frame
#ifdef FILTERED
in vec3 uv_coverage;                 // texture coordinates, and opacity at the corner
out vec3 facet_uv_coverage;
#endif

void main()
{
#ifdef FILTERED
    facet_uv_coverage = uv_coverage;
#endif
    gl_Position = clip_from_scene * vec4(position, 1.0);
    // From OpenGL's range [-w, w] to the device's.
    gl_Position.z = 0.5 * (gl_Position.z + gl_Position.w);
}
