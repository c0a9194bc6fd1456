// Provides vec3 direct_irradiance(vec3 offset, vec3 normal) of all shadow-casting lights.
// Twin: catoptra_server.world.shading.unshadowed_irradiance, with every triangle tested.
uniform sampler2D scene_shadow_maps;   // depths of the static scene, MAP_COLUMNS cells a row
uniform sampler2D object_shadow_maps;  // depths of dynamic objects, in the same layout
uniform bool has_objects;

// The depth buffer's 24 bits and a few float32 operations: closer depths are equal.
const float SAME_DEPTH = 1e-6;

float sample_depth(sampler2D maps, int cell, vec2 position_in_cell)
{
    int side = textureSize(maps, 0).x / MAP_COLUMNS;
    ivec2 texel = clamp(ivec2(floor(position_in_cell * float(side))), ivec2(0), ivec2(side - 1));
    return texelFetch(maps, texel + side * ivec2(cell % MAP_COLUMNS, cell / MAP_COLUMNS), 0).r;
}

// A point beyond the map's far plane is behind every caster.
bool is_behind(sampler2D maps, int cell, vec3 at)
{
    return min(at.z, 1.0) - SAME_DEPTH > sample_depth(maps, cell, at.xy);
}

#ifdef NUM_SHADOWED_DIRECTIONAL_LIGHTS
uniform vec3 directional_light_to_source[NUM_SHADOWED_DIRECTIONAL_LIGHTS];   // unit, world axes
uniform vec3 directional_light_irradiance[NUM_SHADOWED_DIRECTIONAL_LIGHTS];  // perpendicular facet
uniform mat4 map_from_offset_scene[NUM_SHADOWED_DIRECTIONAL_LIGHTS];         // to (u, v, depth)
uniform mat4 map_from_offset_objects[NUM_SHADOWED_DIRECTIONAL_LIGHTS];

bool is_directional_shadowed(sampler2D maps, int cell, mat4 map_from_offset, vec3 offset)
{
    vec3 at = (map_from_offset * vec4(offset, 1.0)).xyz;
    return at.xy == clamp(at.xy, 0.0, 1.0) && is_behind(maps, cell, at);
}

vec3 directional_irradiance(int i, vec3 offset, vec3 normal)
{
    float cosine = dot(directional_light_to_source[i], normal);
    if (cosine <= 0.0
            || is_directional_shadowed(scene_shadow_maps, i, map_from_offset_scene[i], offset)
            || (has_objects && is_directional_shadowed(
                    object_shadow_maps, i, map_from_offset_objects[i], offset)))
        return vec3(0.0);
    return cosine * directional_light_irradiance[i];
}
#else
#define NUM_SHADOWED_DIRECTIONAL_LIGHTS 0
vec3 directional_irradiance(int i, vec3 offset, vec3 normal)
{
    return vec3(0.0);
}
#endif

#ifdef NUM_SHADOWED_POINT_LIGHTS
uniform vec3 point_light_positions[NUM_SHADOWED_POINT_LIGHTS];    // relative to the viewpoint
uniform vec3 point_light_intensities[NUM_SHADOWED_POINT_LIGHTS];  // irradiance at one metre
// depth = first + second / forward: xy of the scene's map, zw of the objects' map.
uniform vec4 point_light_depth_from_forward[NUM_SHADOWED_POINT_LIGHTS];

// Six faces a light: +x, -x, +y, -y, +z, -z; u and v are the next two axes.
bool is_point_shadowed(sampler2D maps, int light, vec2 depth, vec3 from_light)
{
    vec3 size = abs(from_light);
    int axis = size.x >= max(size.y, size.z) ? 0 : (size.y >= size.z ? 1 : 2);
    float forward = size[axis];
    vec2 uv = vec2(from_light[(axis + 1) % 3], from_light[(axis + 2) % 3]) / forward;
    int face = 2 * axis + (from_light[axis] < 0.0 ? 1 : 0);
    vec3 at = vec3(0.5 + 0.5 * uv, depth.x + depth.y / forward);
    return is_behind(maps, NUM_SHADOWED_DIRECTIONAL_LIGHTS + 6 * light + face, at);
}

vec3 shadowed_point_irradiance(int i, vec3 offset, vec3 normal)
{
    vec3 to_light = point_light_positions[i] - offset;
    // The inverse square is infinite at the light itself: no distance is below a millimetre.
    float squared = max(dot(to_light, to_light), 1e-6);
    float cosine = max(dot(to_light, normal), 0.0) * inversesqrt(squared);
    vec4 depth = point_light_depth_from_forward[i];
    if (cosine == 0.0 || is_point_shadowed(scene_shadow_maps, i, depth.xy, -to_light)
            || (has_objects && is_point_shadowed(object_shadow_maps, i, depth.zw, -to_light)))
        return vec3(0.0);
    return (cosine / squared) * point_light_intensities[i];
}
#else
#define NUM_SHADOWED_POINT_LIGHTS 0
vec3 shadowed_point_irradiance(int i, vec3 offset, vec3 normal)
{
    return vec3(0.0);
}
#endif

vec3 direct_irradiance(vec3 offset, vec3 normal)
{
    vec3 total = vec3(0.0);
    for (int i = 0; i < NUM_SHADOWED_DIRECTIONAL_LIGHTS; ++i)
        total += directional_irradiance(i, offset, normal);
    for (int i = 0; i < NUM_SHADOWED_POINT_LIGHTS; ++i)
        total += shadowed_point_irradiance(i, offset, normal);
    return total;
}
