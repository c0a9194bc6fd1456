// Provides the clip position of a scene vertex in one atlas cell, with its shading attributes.
// Twin: catoptra_server.render.projection.atlas.AtlasCell.clip_from_mirror.
// Depth is NEAR_M / w: 1 on the near plane, 0 at infinity (render/projection/frustum.py).
const float NEAR_M = 0.001;          // what is nearer is clipped

uniform vec3 viewpoint;              // in the scene's frame: world axes, metres
uniform vec3 viewpoint_rest;         // what float32 lacks of it
uniform mat3 clip_from_scene;        // rows give x, y and w of the clip position

#ifdef COLOURED_CORNERS              // interpolated; centroid: never beyond the corners' colours
#define COLOUR centroid
#else
#define COLOUR flat
#endif

in vec3 position;                    // in the scene's frame
in vec3 position_rest;               // what float32 lacks of it
in vec3 radiance;
COLOUR out vec3 facet_radiance;
#ifdef OCCLUDED
in vec2 occlusion_at;                // column and row of the atlas, nodes
in vec3 ambient;                     // radiance by hemisphere lights, zero where nothing is hidden
centroid out vec2 occlusion_position;
COLOUR out vec3 facet_ambient;
#endif
#ifdef TEXTURED
in vec2 uv;
out vec2 texture_coordinates;
#endif
out vec3 offset;
#ifdef EMISSIVE
in vec3 emission;
flat out vec3 facet_emission;
#endif
#ifdef BENT
in vec3 bent_normal;
in float bend;                       // 0: the facet's own normal, 2: backs have the opposite one
out vec3 shading_normal;
flat out float facet_bend;
#endif
#ifdef FILTERED
in vec2 passing;                     // coverage at the corner; 1: no back
out vec2 facet_filter;
#endif
#if defined(NUM_POINT_LIGHTS) || defined(SHADOWS) || defined(BENT) || defined(FILTERED)
in vec3 normal;
flat out vec3 facet_normal;
#endif
#if defined(NUM_POINT_LIGHTS) || defined(SHADOWS) || defined(BENT)
in vec3 lit_albedo;                  // zero for unlit materials
COLOUR out vec3 facet_albedo;
#endif

void main()
{
    vec3 from_viewpoint = (position - viewpoint) + (position_rest - viewpoint_rest);
    vec3 clip = clip_from_scene * from_viewpoint;
    gl_Position = vec4(clip.xy, NEAR_M, clip.z);
    facet_radiance = radiance;
#ifdef OCCLUDED
    occlusion_position = occlusion_at;
    facet_ambient = ambient;
#endif
#ifdef TEXTURED
    texture_coordinates = uv;
#endif
    offset = from_viewpoint;
#ifdef EMISSIVE
    facet_emission = emission;
#endif
#ifdef BENT
    shading_normal = bent_normal;
    facet_bend = bend;
#endif
#ifdef FILTERED
    facet_filter = passing;
#endif
#if defined(NUM_POINT_LIGHTS) || defined(SHADOWS) || defined(BENT) || defined(FILTERED)
    facet_normal = normal;
#endif
#if defined(NUM_POINT_LIGHTS) || defined(SHADOWS) || defined(BENT)
    facet_albedo = lit_albedo;
#endif
}
