// Provides no colour: OpenGL writes the depth of a shadow map, but in holes.
// Twin: catoptra_server.render.trace.reference.meshes, of holes.
#ifdef FILTERED
in vec3 facet_uv_coverage;
uniform sampler2D albedo_texture;    // opaque where the caster has none
#endif

void main()
{
#ifdef FILTERED
    // Interpolation may lose something of a coverage of 1 at all corners.
    if (facet_uv_coverage.z * textureLod(albedo_texture, facet_uv_coverage.xy, 0.0).a < 0.99999)
        discard;
#endif
}
