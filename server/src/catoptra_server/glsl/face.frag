// Provides the linear radiance of a facet: constant, lit by point lights or with shadows, textured.
// Twin: catoptra_server.scene.shading.facet_radiance, then the other functions of that file.
#ifdef SHADOWS
#include "include/shadows.glsl"
#endif
#ifdef POINT_LIGHTS
#include "include/point_irradiance.glsl"
#endif
#if defined(POINT_LIGHTS) || defined(SHADOWS)
in vec3 place;
flat in vec3 facet_normal;
flat in vec3 facet_albedo;
#endif
#ifdef TEXTURED
uniform sampler2D albedo_texture;    // stored as sRGB, so that it is filtered in linear light
in vec2 texture_place;
#endif
flat in vec3 facet_radiance;
out vec4 colour;

void main()
{
    vec3 linear = facet_radiance;
#ifdef POINT_LIGHTS
    linear += facet_albedo * point_irradiance(place, facet_normal);
#endif
#ifdef SHADOWS
    linear += facet_albedo * direct_irradiance(place, facet_normal);
#endif
#ifdef TEXTURED
    linear *= texture(albedo_texture, texture_place).rgb;
#endif
    colour = vec4(linear, 1.0);
}
