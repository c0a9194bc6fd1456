// Provides the linear radiance of a facet in fog: constant or lit, with shadows, textured.
// Twin: catoptra_server.world.shading.facet_radiance, then the other functions of that file.
#ifdef SHADOWS
#include "include/shadows.glsl"
#endif
#ifdef NUM_POINT_LIGHTS
#include "include/point_irradiance.glsl"
#endif
#ifdef OCCLUDED
#include "include/occlusion.glsl"
#endif
#ifdef COLOURED_CORNERS
#define COLOUR centroid
#else
#define COLOUR flat
#endif
uniform vec4 fog;                    // airlight, and extinction per metre; 0 in clear air
in vec3 offset;                      // from the viewpoint, world axes, metres
#if defined(NUM_POINT_LIGHTS) || defined(SHADOWS)
flat in vec3 facet_normal;
COLOUR in vec3 facet_albedo;
#endif
#ifdef TEXTURED
uniform sampler2D albedo_texture;    // stored as sRGB, so that OpenGL filters linear light
in vec2 texture_coordinates;
#include "include/texture_levels.glsl"
#endif
#ifdef OCCLUDED
centroid in vec2 occlusion_position; // centroid: never beyond the facet's grid
COLOUR in vec3 facet_ambient;        // zero where nothing is hidden
#endif
COLOUR in vec3 facet_radiance;
out vec4 colour;

void main()
{
    vec3 linear = facet_radiance;
#ifdef OCCLUDED
    linear -= hidden_sky(occlusion_position) * facet_ambient;
#endif
#ifdef NUM_POINT_LIGHTS
    linear += facet_albedo * point_irradiance(offset, facet_normal);
#endif
#ifdef SHADOWS
    linear += facet_albedo * direct_irradiance(offset, facet_normal);
#endif
#ifdef TEXTURED
    linear *= texture_mean(albedo_texture, texture_coordinates, offset);
#endif
    if (fog.a > 0.0)
        linear = mix(fog.rgb, linear, exp(-fog.a * length(offset)));
    colour = vec4(linear, 1.0);
}
