// Provides vec3 direct_irradiance(vec3 place, vec3 normal) by all lights that something may hide.
// Twin: catoptra_server.scene.shading.light_irradiance, with every triangle tried.
uniform sampler2D scene_maps;        // depths of what stands, cells of MAP_COLUMNS a row
uniform sampler2D body_maps;         // depths of what moves, laid out alike
uniform bool has_bodies;

// The depth buffer's 24 bits and a few float32 operations: depths this near are one.
const float SAME_DEPTH = 1e-6;

float depth_at(sampler2D maps, int cell, vec2 place_in_cell)
{
    int side = textureSize(maps, 0).x / MAP_COLUMNS;
    ivec2 texel = clamp(ivec2(floor(place_in_cell * float(side))), ivec2(0), ivec2(side - 1));
    return texelFetch(maps, texel + side * ivec2(cell % MAP_COLUMNS, cell / MAP_COLUMNS), 0).r;
}

// What lies beyond the map's far plane is behind all that casts a shadow.
bool is_behind(sampler2D maps, int cell, vec3 at)
{
    return min(at.z, 1.0) - SAME_DEPTH > depth_at(maps, cell, at.xy);
}

#ifdef SUNS
uniform vec3 sun_towards[SUNS];      // unit, world axes
uniform vec3 sun_irradiance[SUNS];   // on a facet that faces it
uniform mat4 sun_scene_map[SUNS];    // from places relative to the viewpoint to (u, v, depth)
uniform mat4 sun_body_map[SUNS];

bool sun_is_behind(sampler2D maps, int cell, mat4 map_from_offset, vec3 place)
{
    vec3 at = (map_from_offset * vec4(place, 1.0)).xyz;
    return at.xy == clamp(at.xy, 0.0, 1.0) && is_behind(maps, cell, at);
}

vec3 sun_light(int i, vec3 place, vec3 normal)
{
    float cosine = dot(sun_towards[i], normal);
    if (cosine <= 0.0 || sun_is_behind(scene_maps, i, sun_scene_map[i], place)
            || (has_bodies && sun_is_behind(body_maps, i, sun_body_map[i], place)))
        return vec3(0.0);
    return cosine * sun_irradiance[i];
}
#else
#define SUNS 0
vec3 sun_light(int i, vec3 place, vec3 normal)
{
    return vec3(0.0);
}
#endif

#ifdef LAMPS
uniform vec3 lamp_place[LAMPS];      // relative to the viewpoint, world axes, metres
uniform vec3 lamp_intensity[LAMPS];  // irradiance at one metre
uniform vec4 lamp_depth[LAMPS];      // depth = first + second / forward: the scene's map, the bodies'

// Six faces a lamp: +x, -x, +y, -y, +z, -z; across are the next two axes.
bool lamp_is_behind(sampler2D maps, int lamp, vec2 depth, vec3 from_lamp)
{
    vec3 size = abs(from_lamp);
    int axis = size.x >= max(size.y, size.z) ? 0 : (size.y >= size.z ? 1 : 2);
    float forward = size[axis];
    vec2 across = vec2(from_lamp[(axis + 1) % 3], from_lamp[(axis + 2) % 3]) / forward;
    int face = 2 * axis + (from_lamp[axis] < 0.0 ? 1 : 0);
    vec3 at = vec3(0.5 + 0.5 * across, depth.x + depth.y / forward);
    return is_behind(maps, SUNS + 6 * lamp + face, at);
}

vec3 lamp_light(int i, vec3 place, vec3 normal)
{
    vec3 towards = lamp_place[i] - place;
    // At the light itself the inverse square has no value: that of a millimetre instead.
    float squared = max(dot(towards, towards), 1e-6);
    float cosine = max(dot(towards, normal), 0.0) * inversesqrt(squared);
    if (cosine == 0.0 || lamp_is_behind(scene_maps, i, lamp_depth[i].xy, -towards)
            || (has_bodies && lamp_is_behind(body_maps, i, lamp_depth[i].zw, -towards)))
        return vec3(0.0);
    return (cosine / squared) * lamp_intensity[i];
}
#else
#define LAMPS 0
vec3 lamp_light(int i, vec3 place, vec3 normal)
{
    return vec3(0.0);
}
#endif

vec3 direct_irradiance(vec3 place, vec3 normal)
{
    vec3 total = vec3(0.0);
    for (int i = 0; i < SUNS; ++i)
        total += sun_light(i, place, normal);
    for (int i = 0; i < LAMPS; ++i)
        total += lamp_light(i, place, normal);
    return total;
}
