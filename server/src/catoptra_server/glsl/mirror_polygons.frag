// Provides the polygon mirror's picture: sRGB at one sample, linear light where they are averaged.
// Twin: catoptra_server.render.trace.polygon_rays.polygon_directions.
#include "include/atlas.glsl"
#include "include/colour.glsl"
in vec3 direction;
out vec4 colour;

void main()
{
    vec3 linear = radiance_seen(direction);
#ifdef ENCODED
    linear = srgb_from_linear(linear);
#endif
    colour = vec4(linear, 1.0);
}
