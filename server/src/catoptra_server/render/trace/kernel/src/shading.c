#include "shading.h"

#include "hit_points.h"
#include "light_map.h"
#include "facet_plane.h"
#include "texture_levels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Distance of a shadow ray's origin in front of its facet, relative to the largest coordinate:
 * positions and corners are rounded to 2^-24 each, and a hit on a plane loses a few times that.
 * 40 um at 10 m. */
#define SHADOW_BIAS 0x1p-18f
/* A lamp and a point of a surface may coincide: the irradiance there is that of a millimetre. */
#define MIN_SQUARED_DISTANCE 1e-6f
#define UNLIMITED INFINITY
/* A table of objects' facets takes 15 ns each, a ray's own shading 100 ns. */
enum { MAX_LIT_FACETS = 30000 };

/* The hits of a block whose radiance is not in a table. */
typedef struct {
    HitPoints points;
    Vec3 albedo[BLOCK_RAYS];
    uint32_t computed; /* rays with a hit whose radiance is computed */
    uint32_t lit;      /* those that reflect light */
    uint32_t textured; /* those with a texture */
} SurfaceBlock;

static Vec3 albedo_at(const MeshArrays *mesh, int triangle, float u, float v) {
    if (!(mesh->flags[triangle] & FACET_CORNER_COLOURS))
        return vec3(mesh->albedo + 3 * (size_t)triangle);
    const float *corners = mesh->corner_albedo + 9 * (size_t)triangle;
    Vec3 first = vec3(corners);
    return add(first, add(scale(u, subtract(vec3(corners + 3), first)),
                          scale(v, subtract(vec3(corners + 6), first))));
}

/* Irradiance from the hemisphere; z points down, so an upward facet has normal z = -1. */
static Vec3 ambient_irradiance(const Hemisphere *hemisphere, Vec3 normal) {
    float upward = 0.5f * (1.0f - normal.z);
    return add(scale(upward, vec3(hemisphere->up)), scale(1.0f - upward, vec3(hemisphere->down)));
}

int is_tabulated(const FrameState *state, int object, int triangle) {
    if (object != OBJECT_STATIC)
        return object == OBJECT_NONE || state->object_radiance;
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    if (mesh->flags[triangle] & (FACET_TEXTURED | FACET_CORNER_COLOURS))
        return 0;
    return mesh->flags[triangle] & FACET_UNLIT ||
           !(state->has_point_lights || state->frame->has_shadows);
}

Vec3 table_entry(const FrameState *state, int object, int triangle) {
    const float *table = state->frame->has_shadows ? state->scene->ambient_radiance
                                                   : state->scene->sharp_radiance;
    if (object == OBJECT_STATIC)
        return vec3(table + 3 * (size_t)triangle);
    /* The last row of the scene's table is the background. */
    if (object == OBJECT_NONE)
        return vec3(table + 3 * (size_t)state->scene->mesh->arrays.num_triangles);
    return state->object_radiance[object - 1][triangle];
}

static Vec3 light_facet(const FrameState *state, const MeshArrays *mesh, int triangle,
                        Vec3 normal) {
    Vec3 albedo = vec3(mesh->albedo + 3 * (size_t)triangle);
    if (mesh->flags[triangle] & FACET_UNLIT)
        return albedo;
    Vec3 irradiance = ambient_irradiance(&state->scene->hemisphere, normal);
    for (int i = 0; i < state->scene->num_lights; i++) {
        float cosine = dot(vec3(state->scene->lights[i].vector), normal);
        if (cosine > 0.0f)
            irradiance = add(irradiance, scale(cosine, vec3(state->scene->lights[i].intensity)));
    }
    return multiply(albedo, irradiance);
}

const Vec3 **light_objects(const FrameState *state) {
    const Frame *frame = state->frame;
    size_t count = 0;
    for (int object = 0; object < frame->num_objects; object++)
        count += (size_t)frame->objects[object]->arrays.num_triangles;
    for (int i = 0; i < state->scene->num_lights; i++)
        if (state->scene->lights[i].kind == LIGHT_POINT)
            return NULL;
    if (!count || count > MAX_LIT_FACETS || frame->has_shadows || frame->num_poses > 1)
        return NULL;
    /* One block: where each object's facets begin, then the facets. */
    size_t pointers = sizeof(Vec3 *) * (size_t)frame->num_objects;
    const Vec3 **radiance = malloc(pointers + sizeof(Vec3) * count);
    Vec3 *next = (Vec3 *)((char *)radiance + pointers);
    for (int object = 0; radiance && object < frame->num_objects; object++) {
        radiance[object] = next;
        const MeshArrays *mesh = &frame->objects[object]->arrays;
        const float *rotation = frame->object_poses[object].rotation;
        for (int32_t i = 0; i < mesh->num_triangles; i++)
            *next++ = light_facet(state, mesh, i,
                                  rotate(rotation, vec3(mesh->normals + 3 * (size_t)i)));
    }
    return radiance;
}

/* Radiance without the lights that are added one by one. */
static Vec3 base_radiance(const FrameState *state, int object, int triangle, Vec3 albedo,
                          Vec3 normal) {
    const MeshArrays *mesh = mesh_of(state, object);
    if (mesh->flags[triangle] & FACET_UNLIT)
        return albedo;
    if (object == OBJECT_STATIC && !(mesh->flags[triangle] & FACET_CORNER_COLOURS))
        return table_entry(state, object, triangle);
    return multiply(albedo, ambient_irradiance(&state->scene->hemisphere, normal));
}

/* Whether a light is added one by one to an object's facets, instead of from the tables. */
static int is_added(const FrameState *state, const Light *light, int object, int triangle) {
    if (object != OBJECT_STATIC)
        return 1;
    uint8_t flags = state->scene->mesh->arrays.flags[triangle];
    int is_in_table = light->kind == LIGHT_DIRECTIONAL && !state->frame->has_shadows &&
                      !(flags & FACET_CORNER_COLOURS);
    return light->lights_scene && !is_in_table;
}

/* Irradiance of an unoccluded light, as one factor of its intensity; direction and distance. */
static float light_cosine(const Light *light, Vec3 position, Vec3 normal, Vec3 *direction,
                          float *distance) {
    if (light->kind == LIGHT_DIRECTIONAL) {
        *direction = vec3(light->vector);
        *distance = UNLIMITED;
        return dot(*direction, normal);
    }
    Vec3 towards = subtract(vec3(light->vector), position);
    float squared = dot(towards, towards);
    squared = squared > MIN_SQUARED_DISTANCE ? squared : MIN_SQUARED_DISTANCE;
    float length = sqrtf(squared);
    *direction = scale(1.0f / length, towards);
    *distance = length;
    return dot(*direction, normal) / squared;
}

static void set_shadow_ray(RayBlock *shadow, int lane, const RayBlock *rays,
                           const HitPoints *points, Vec3 direction, float distance) {
    Vec3 position = get_lane(points->position, lane);
    float here = max_abs(position), there = max_abs(get_lane(rays->origin, lane));
    float bias = SHADOW_BIAS * (here > there ? here : there);
    Vec3 origin = add(position, scale(bias, get_lane(points->normal, lane)));
    set_lane(shadow->origin, lane, origin);
    set_lane(shadow->direction, lane, direction);
    shadow->limit[lane] = distance;
    shadow->time[lane] = rays->time[lane];
    shadow->active |= 1u << lane;
}

static uint32_t find_occluded(const FrameState *state, RayBlock *shadow, int is_coherent) {
    const Scene *scene = state->scene;
    const Mesh *casters = scene->casters ? scene->casters : scene->mesh;
    uint32_t occluded = 0;
    if (casters->scene)
        occluded = occlude_block(state->device, casters->scene, shadow, is_coherent);
    shadow->active &= ~occluded;
    if (state->objects && shadow->active)
        occluded |= occlude_block(state->device, state->objects, shadow, is_coherent);
    return occluded;
}

static void add_light(const FrameState *state, const Light *light, const RayBlock *rays,
                      const HitBlock *hits, const SurfaceBlock *surface,
                      float radiance[3][BLOCK_RAYS]) {
    float factor[BLOCK_RAYS];
    RayBlock shadow;
    uint32_t facing = 0;
    shadow.active = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        if (!(surface->lit >> lane & 1) ||
            !is_added(state, light, hits->object[lane], hits->triangle[lane]))
            continue;
        Vec3 direction;
        float distance;
        factor[lane] = light_cosine(light, get_lane(surface->points.position, lane),
                                    get_lane(surface->points.normal, lane), &direction, &distance);
        /* Facets turned away from a light are dark without a ray. */
        if (!(factor[lane] > 0.0f))
            continue;
        facing |= 1u << lane;
        if (state->frame->has_shadows)
            set_shadow_ray(&shadow, lane, rays, &surface->points, direction, distance);
    }
    if (shadow.active)
        facing &= ~find_occluded(state, &shadow, light->kind == LIGHT_DIRECTIONAL);
    Vec3 intensity = vec3(light->intensity);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        if (facing >> lane & 1)
            add_lane(radiance, lane,
                     scale(factor[lane], multiply(surface->albedo[lane], intensity)));
}

/* Coordinates and footprints of the hits with one facet, a bit mask of which is returned: vector
 * code for all rays of the block, kept where they meet the facet. */
static uint32_t find_facet_points(const FrameState *state, const RayBlock *rays,
                                  const HitBlock *hits, const HitPoints *at,
                                  const RaySteps *ray_steps, int32_t triangle,
                                  TexturePoints *points) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    const TextureLevel *image = state->scene->textures[mesh->texture[triangle]].levels;
    const float *uv = mesh->uv + 6 * (size_t)triangle;
    FacetPlane plane = find_facet_plane(state, triangle);
    PlaneSteps steps = find_plane_steps(&plane, ray_steps, image);
    Vec3 n = plane.normal, gu = scale((float)image->width, plane.u_gradient);
    Vec3 gv = scale((float)image->height, plane.v_gradient);
    uint32_t mask = 0;
    for (int i = 0; i < BLOCK_RAYS; i++) {
        int is_here = hits->triangle[i] == triangle;
        float x = rays->direction[0][i], y = rays->direction[1][i], z = rays->direction[2][i];
        Footprint footprint = find_footprint(
            &steps, at->distance[i], 1.0f / (n.x * x + n.y * y + n.z * z),
            gu.x * x + gu.y * y + gu.z * z, gv.x * x + gv.y * y + gv.z * z);
        float u = uv[0] + at->u[i] * uv[2] + at->v[i] * uv[4];
        float v = uv[1] + at->u[i] * uv[3] + at->v[i] * uv[5];
        points->u[i] = is_here ? u : points->u[i];
        points->v[i] = is_here ? v : points->v[i];
        points->squares[i] = is_here ? footprint.squares : points->squares[i];
        points->area[i] = is_here ? footprint.area : points->area[i];
    }
    for (int i = 0; i < BLOCK_RAYS; i++)
        mask |= (uint32_t)(hits->triangle[i] == triangle) << i;
    return mask;
}

/* Coordinates and footprints of textured hits; of the other rays, points without a size. */
static void find_texture_points(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                                const SurfaceBlock *surface, TexturePoints *points) {
    RaySteps steps = find_ray_steps(state, rays);
    memset(points, 0, sizeof *points);
    /* Objects have no textures: a triangle's number is one of the static scene. */
    for (uint32_t left = surface->textured; left;)
        left &= ~find_facet_points(state, rays, hits, &surface->points, &steps,
                                   hits->triangle[__builtin_ctz(left)], points);
}

static void apply_textures(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                           const SurfaceBlock *surface, float radiance[3][BLOCK_RAYS]) {
    TexturePoints points;
    find_texture_points(state, rays, hits, surface, &points);
    measure_footprints(&points);
    TexelChoice texels[BLOCK_RAYS];
    /* All texels are requested before the first is used. */
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        if (!(surface->textured >> lane & 1))
            continue;
        int32_t number = state->scene->mesh->arrays.texture[hits->triangle[lane]];
        const Texture *texture = state->scene->textures + number;
        texels[lane] = find_level_texels(texture, choose_level(texture, points.texels[lane]),
                                         points.u[lane], points.v[lane]);
    }
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        if (surface->textured >> lane & 1)
            multiply_lane(radiance, lane, mix_levels(&texels[lane]));
}

/* Radiance from the tables; which other rays' radiance has to be computed, and how. */
static void look_up(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                    SurfaceBlock *surface, float radiance[3][BLOCK_RAYS]) {
    surface->computed = surface->lit = surface->textured = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        if (!(rays->active >> lane & 1))
            continue;
        int object = hits->object[lane], triangle = hits->triangle[lane];
        if (is_tabulated(state, object, triangle)) {
            set_lane(radiance, lane, table_entry(state, object, triangle));
            continue;
        }
        uint8_t flags = mesh_of(state, object)->flags[triangle];
        surface->computed |= 1u << lane;
        surface->lit |= (uint32_t)!(flags & FACET_UNLIT) << lane;
        surface->textured |= (uint32_t)!!(flags & FACET_TEXTURED) << lane;
    }
}

/* Whether nothing occludes any light at a point of the static scene: then the table of frames
 * without shadows holds its radiance. */
static int is_unshadowed(const FrameState *state, const HitBlock *hits,
                         const SurfaceBlock *surface, int lane) {
    if (!state->frame->has_shadows || state->has_point_lights ||
        hits->object[lane] != OBJECT_STATIC ||
        state->scene->mesh->arrays.flags[hits->triangle[lane]] & FACET_CORNER_COLOURS)
        return 0;
    Vec3 normal = get_lane(surface->points.normal, lane);
    Vec3 position = get_lane(surface->points.position, lane);
    for (int i = 0; i < state->scene->num_lights; i++) {
        const Light *light = &state->scene->lights[i];
        int shines = light->lights_scene && dot(normal, vec3(light->vector)) > 0.0f;
        if (shines && !is_lit_by_map(state, i, hits->triangle[lane], position))
            return 0;
    }
    return 1;
}

static void begin_surfaces(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                           SurfaceBlock *surface, float radiance[3][BLOCK_RAYS]) {
    find_hit_points(state, rays, hits, surface->computed, &surface->points);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        if (!(surface->computed >> lane & 1))
            continue;
        int object = hits->object[lane], triangle = hits->triangle[lane];
        if (is_unshadowed(state, hits, surface, lane)) {
            set_lane(radiance, lane, vec3(state->scene->sharp_radiance + 3 * (size_t)triangle));
            surface->lit &= ~(1u << lane);
            continue;
        }
        surface->albedo[lane] = albedo_at(mesh_of(state, object), triangle,
                                          surface->points.u[lane], surface->points.v[lane]);
        set_lane(radiance, lane,
                 base_radiance(state, object, triangle, surface->albedo[lane],
                               get_lane(surface->points.normal, lane)));
    }
}

void shade_block(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                 float radiance[3][BLOCK_RAYS]) {
    SurfaceBlock surface;
    look_up(state, rays, hits, &surface, radiance);
    if (!surface.computed)
        return;
    begin_surfaces(state, rays, hits, &surface, radiance);
    if (surface.lit)
        for (int light = 0; light < state->scene->num_lights; light++)
            add_light(state, &state->scene->lights[light], rays, hits, &surface, radiance);
    if (surface.textured)
        apply_textures(state, rays, hits, &surface, radiance);
}
