// Provides the linear radiance of a facet in fog: constant or lit, with shadows, textured.
// Twin: catoptra_server.world.shading.facet_radiance, then the other functions of that file.
#ifdef LEAST_LAYER
#include "include/layer_samples.glsl"
uniform LAYER_SAMPLER depth_before;  // of the layer that is nearer than this one
layout(location = 1) out float depth;
#endif
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
#if defined(NUM_POINT_LIGHTS) || defined(SHADOWS) || defined(BENT) || defined(FILTERED)
flat in vec3 facet_normal;
#endif
#if defined(NUM_POINT_LIGHTS) || defined(SHADOWS) || defined(BENT)
COLOUR in vec3 facet_albedo;
#endif
#ifdef EMISSIVE
flat in vec3 facet_emission;         // added to what is reflected
#endif
#ifdef BENT
in vec3 shading_normal;              // between the corners, of any length
flat in float facet_bend;
uniform vec3 sky_faces[6];           // irradiance of surfaces that face x, -x, y, -y, down, up
#if NUM_SUNS > 0
uniform vec3 sun_directions[NUM_SUNS];   // unit, towards the lights that nothing occludes
uniform vec3 sun_irradiances[NUM_SUNS];
#endif

vec3 bent_normal()
{
    if (facet_bend == 0.0)
        return facet_normal;
    float squared = dot(shading_normal, shading_normal);
    vec3 normal = squared > 0.0 ? shading_normal * inversesqrt(squared) : facet_normal;
    return facet_bend > 1.5 && dot(facet_normal, offset) > 0.0 ? -normal : normal;
}

vec3 sky_irradiance(vec3 normal)
{
    vec3 total = vec3(0.0);
    for (int i = 0; i < 3; i++) {
        vec3 one = sky_faces[2 * i], other = sky_faces[2 * i + 1];
        total += 0.5 * normal[i] * (one - other + normal[i] * (one + other));
    }
    return max(total, vec3(0.0));
}

vec3 sun_irradiance(vec3 normal)
{
    vec3 total = vec3(0.0);
#if NUM_SUNS > 0
    for (int i = 0; i < NUM_SUNS; i++)
        total += max(dot(sun_directions[i], normal), 0.0) * sun_irradiances[i];
#endif
    return total;
}
#endif
#ifdef TEXTURED
uniform sampler2D albedo_texture;    // stored as sRGB, so that OpenGL filters linear light
in vec2 texture_coordinates;
#include "include/texture_levels.glsl"
#endif
#ifdef FILTERED
#include "include/holes.glsl"
#endif
#ifdef OCCLUDED
centroid in vec2 occlusion_position; // centroid: never beyond the facet's grid
COLOUR in vec3 facet_ambient;        // zero where nothing is hidden
#endif
COLOUR in vec3 facet_radiance;
layout(location = 0) out vec4 colour;

void main()
{
#ifdef FILTERED
    bool is_hole = is_passed();
#ifdef LEAST_LAYER
    depth = gl_FragCoord.z;          // smaller where it is farther
    is_hole = is_hole || depth >= texelFetch(depth_before, ivec2(gl_FragCoord.xy), LAYER_SAMPLE).r;
#endif
#endif
    vec3 linear = facet_radiance;
#ifdef BENT
    vec3 normal = bent_normal();
    vec3 sky = facet_albedo * sky_irradiance(normal);
    if (facet_bend > 0.0)
        linear = sky + facet_albedo * sun_irradiance(normal);
#elif defined(NUM_POINT_LIGHTS) || defined(SHADOWS)
    vec3 normal = facet_normal;
#endif
#ifdef OCCLUDED
    vec3 ambient = facet_ambient;
#ifdef BENT
    ambient = facet_bend > 0.0 && ambient != vec3(0.0) ? sky : ambient;
#endif
    linear -= hidden_sky(occlusion_position) * ambient;
#endif
#ifdef NUM_POINT_LIGHTS
    linear += facet_albedo * point_irradiance(offset, normal);
#endif
#ifdef SHADOWS
    linear += facet_albedo * direct_irradiance(offset, normal);
#endif
#ifdef TEXTURED
    linear *= texture_mean(albedo_texture, texture_coordinates, offset);
#endif
#ifdef EMISSIVE
    linear += facet_emission;
#endif
    if (fog.a > 0.0)
        linear = mix(fog.rgb, linear, exp(-fog.a * length(offset)));
#ifdef FILTERED
    if (is_hole)                     // after all derivatives
        discard;
#endif
    colour = vec4(linear, 1.0);
#ifdef LEAST_LAYER
    colour *= min(0.5 * find_coverage(), 1.0);
#endif
}
