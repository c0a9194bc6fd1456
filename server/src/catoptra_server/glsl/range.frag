// Provides the range of a surface from the viewpoint.
// Twin: catoptra_server.render.trace.trace_engine.RayHits.
in vec3 offset;
#ifdef FILTERED
flat in vec3 facet_normal;
#ifdef TEXTURED
uniform sampler2D albedo_texture;
in vec2 texture_coordinates;
#endif
#include "include/holes.glsl"
#endif
out float range_m;

void main()
{
#ifdef FILTERED
    if (is_passed())
        discard;
#endif
    range_m = length(offset);
}
