/* Provides shading.h: linear radiance of the hits of a block.
 * Float64 twin: world/shading.py. render.c frees the table of light_objects.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "shading.h"

#include "direct_light.h"
#include "facet_plane.h"
#include "hit_textures.h"
#include "lanes.h"
#include "occlusion.h"
#include "sky.h"

#include <stdlib.h>
#include <string.h>

/* A table of objects' facets takes 15 ns each, a ray's own shading 100 ns. */
enum { MAX_LIT_FACETS = 30000 };
/* Twice the squared angle of a turn, 0.1 radians, during which a facet's light is that of its
 * middle to 0.0004. */
#define MAX_SQUARED_TURN 0.02f

static Vec3 albedo_at(const MeshArrays *mesh, int triangle, float u, float v) {
    if (!(mesh->flags[triangle] & FACET_CORNER_COLOURS))
        return vec3(mesh->albedo + 3 * (size_t)triangle);
    const float *corners = mesh->corner_albedo + 9 * (size_t)triangle;
    Vec3 first = vec3(corners);
    return add(first, add(scale(u, subtract(vec3(corners + 3), first)),
                          scale(v, subtract(vec3(corners + 6), first))));
}

Vec3 ambient_irradiance(const Hemisphere *hemisphere, Vec3 normal) {
    float upward = 0.5f * (1.0f - normal.z);
    return add(scale(upward, vec3(hemisphere->up)), scale(1.0f - upward, vec3(hemisphere->down)));
}

/* Light of an object, from 0 on: the even part weighs the means of opposite sides by squares of the
 * normal. */
static Vec3 object_irradiance(const FrameState *state, int object, Vec3 normal) {
    if (!state->frame->object_light)
        return ambient_irradiance(&state->scene->object_hemisphere, normal);
    const float *faces = state->frame->object_light + 18 * (size_t)object;
    float along[3] = {normal.x, normal.y, normal.z}, total[3] = {0, 0, 0};
    for (int channel = 0; channel < 3; channel++) {
        for (int axis = 0; axis < 3; axis++) {
            float one = faces[6 * axis + channel], other = faces[6 * axis + 3 + channel];
            total[channel] += 0.5f * along[axis] * (one - other + along[axis] * (one + other));
        }
        total[channel] = total[channel] > 0.0f ? total[channel] : 0.0f;
    }
    return vec3(total);
}

/* Whether a ray sees the back of a facet that is lit on both sides. */
static int sees_back(const FrameState *state, const RayBlock *rays, int lane, int object,
                     int triangle) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    return object == OBJECT_STATIC && mesh->flags[triangle] & FACET_TWO_SIDED &&
           dot(vec3(mesh->normals + 3 * (size_t)triangle), get_lane(rays->direction, lane)) > 0.0f;
}

int is_tabulated(const FrameState *state, int object, int triangle) {
    if (object != OBJECT_STATIC)
        return object == OBJECT_NONE ||
               (state->object_radiance &&
                !(mesh_of(state, object)->flags[triangle] & (FACET_TEXTURED | FACET_COMPUTED)));
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    if (mesh->flags[triangle] & (FACET_TEXTURED | FACET_COMPUTED))
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

static Vec3 light_facet(const FrameState *state, int object, int triangle, Vec3 normal) {
    const MeshArrays *mesh = &state->frame->objects[object]->arrays;
    Vec3 albedo = vec3(mesh->albedo + 3 * (size_t)triangle);
    if (mesh->flags[triangle] & FACET_UNLIT)
        return albedo;
    Vec3 irradiance = object_irradiance(state, object, normal);
    for (int i = 0; i < state->scene->num_lights; i++) {
        float cosine = dot(vec3(state->scene->lights[i].vector), normal);
        if (cosine > 0.0f)
            irradiance = add(irradiance, scale(cosine, vec3(state->scene->lights[i].intensity)));
    }
    return multiply(albedo, irradiance);
}

/* Whether some facet's light differs between the poses of the exposure. The mean of a short turn
 * about its middle is the light there, but for half the square of its angle; rows of a rolling
 * shutter have no such mean. */
static int do_objects_turn(const FrameState *state) {
    const Frame *frame = state->frame;
    int last = frame->num_objects * (frame->num_poses - 1);
    if (last && (!state->plan_wanted || state->is_rolling))
        return 1;
    for (int object = 0; last && object < frame->num_objects; object++) {
        const Pose *first = frame->object_poses + object;
        float squared = 0.0f;
        for (int i = 0; i < 9; i++) {
            float difference = first[last].rotation[i] - first->rotation[i];
            squared += difference * difference;
        }
        if (squared > MAX_SQUARED_TURN)
            return 1;
    }
    return 0;
}

const Vec3 **light_objects(const FrameState *state) {
    const Frame *frame = state->frame;
    size_t count = 0;
    for (int object = 0; object < frame->num_objects; object++)
        count += (size_t)frame->objects[object]->arrays.num_triangles;
    for (int i = 0; i < state->scene->num_lights; i++)
        if (state->scene->lights[i].kind == LIGHT_POINT)
            return NULL;
    if (!count || count > MAX_LIT_FACETS || frame->has_shadows || do_objects_turn(state))
        return NULL;
    /* One block: where each object's facets begin, then the facets. */
    size_t pointers = sizeof(Vec3 *) * (size_t)frame->num_objects;
    const Vec3 **radiance = malloc(pointers + sizeof(Vec3) * count);
    Vec3 *next = (Vec3 *)((char *)radiance + pointers);
    for (int object = 0; radiance && object < frame->num_objects; object++) {
        radiance[object] = next;
        const MeshArrays *mesh = &frame->objects[object]->arrays;
        Pose pose;
        object_pose(state, object, &pose);
        for (int32_t i = 0; i < mesh->num_triangles; i++)
            *next++ = light_facet(state, object, i,
                                  rotate(pose.rotation, vec3(mesh->normals + 3 * (size_t)i)));
    }
    return radiance;
}

/* Radiance without the lights that are added one by one. */
static Vec3 base_radiance(const FrameState *state, int object, int triangle, int is_coloured,
                          Vec3 albedo, Vec3 normal) {
    const MeshArrays *mesh = mesh_of(state, object);
    if (mesh->flags[triangle] & FACET_UNLIT)
        return albedo;
    if (object == OBJECT_STATIC && !is_coloured)
        return table_entry(state, object, triangle);
    if (object != OBJECT_STATIC)
        return multiply(albedo, object_irradiance(state, object - 1, normal));
    Vec3 irradiance = ambient_irradiance(&state->scene->hemisphere, normal);
    if (state->scene->occlusion.flat_factors)
        irradiance =
            multiply(irradiance, vec3(state->scene->occlusion.flat_factors + 3 * (size_t)triangle));
    return multiply(albedo, irradiance);
}

/* Whether less than all of the sky may reach points of a static facet. */
static int is_dim(const FrameState *state, int32_t triangle) {
    return has_occlusion(state->scene, triangle) ||
           (state->frame->shades &&
            !(state->scene->mesh->arrays.flags[triangle] & FACET_UNLIT));
}

/* Radiance from the tables; which other rays' radiance has to be computed, and how. */
static void look_up(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                    SurfaceBlock *surface, float radiance[3][BLOCK_RAYS]) {
    surface->computed = surface->lit = surface->textured = surface->dim = 0;
    surface->objects = surface->coloured = 0;
    surface->backs = surface->emissive = surface->smooth = 0;
    for (uint32_t left = rays->active, same; left; left &= ~same) {
        int lane = __builtin_ctz(left), object = hits->object[lane];
        int triangle = hits->triangle[lane];
        uint32_t is_back = (uint32_t)sees_back(state, rays, lane, object, triangle);
        same = find_same(hits, lane) & left;
        /* Rays with origins of their own may see both sides of a facet. */
        if (object == OBJECT_STATIC &&
            state->scene->mesh->arrays.flags[triangle] & FACET_TWO_SIDED)
            same = 1u << lane;
        if (object == OBJECT_STATIC && is_dim(state, triangle))
            surface->dim |= same;
        if (!is_back && is_tabulated(state, object, triangle)) {
            set_lanes(radiance, same, table_entry(state, object, triangle));
            continue;
        }
        uint8_t flags = mesh_of(state, object)->flags[triangle];
        surface->computed |= same;
        surface->lit |= flags & FACET_UNLIT ? 0 : same;
        surface->textured |= flags & FACET_TEXTURED ? same : 0;
        surface->objects |= object != OBJECT_STATIC ? same : 0;
        surface->coloured |= flags & FACET_COMPUTED || is_back ? same : 0;
        surface->backs |= is_back ? same : 0;
        surface->emissive |= flags & FACET_EMISSIVE ? same : 0;
        surface->smooth |= flags & FACET_SMOOTH ? same : 0;
    }
}

/* Static triangle that all computed rays of a block meet, if there are 16; -1 otherwise. */
static int32_t find_common_triangle(const HitBlock *hits, uint32_t computed) {
    if (computed != 0xffff)
        return -1;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        if (hits->object[lane] != OBJECT_STATIC || hits->triangle[lane] != hits->triangle[0])
            return -1;
    return hits->triangle[0];
}

/* Points of rays on one plane: without a look at each ray's triangle. */
static void find_plane_points(const FacetPlane *plane, Vec3 normal, const RayBlock *rays,
                              HitPoints *points) {
    find_distances(plane, rays, points->distance);
    float unit[3] = {normal.x, normal.y, normal.z};
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < BLOCK_RAYS; i++) {
            points->normal[axis][i] = unit[axis];
            points->position[axis][i] =
                rays->origin[axis][i] + points->distance[i] * rays->direction[axis][i];
        }
}

static LightProof prove_block(const FrameState *state, int32_t triangle, const HitPoints *points) {
    Vec3 corners[4] = {
        get_lane(points->position, 0),
        get_lane(points->position, TILE_PX - 1),
        get_lane(points->position, BLOCK_RAYS - TILE_PX),
        get_lane(points->position, BLOCK_RAYS - 1),
    };
    return prove_lights(state, triangle, corners, 0);
}

static void add_proof(SurfaceBlock *surface, uint32_t rays, LightProof proof) {
    surface->proven[surface->num_proven].rays = rays;
    surface->proven[surface->num_proven++].proof = proof;
}

/* What is known of the lights where the computed rays meet some facets. */
static void find_proven(const FacetProofs *proofs, const HitBlock *hits, SurfaceBlock *surface) {
    for (int i = 0; i < proofs->count; i++) {
        uint32_t rays = bits16(load_ints16(hits->triangle) == proofs->triangle[i]) &
                        surface->computed & ~surface->objects;
        if (rays)
            add_proof(surface, rays, proofs->proof[i]);
    }
}

static void set_all(float values[3][BLOCK_RAYS], Vec3 value) {
    float parts[3] = {value.x, value.y, value.z};
    for (int channel = 0; channel < 3; channel++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            values[channel][lane] = parts[channel];
}

/* The same as `look_up` for 16 rays that meet one facet. */
static void look_up_plane(const FrameState *state, int32_t triangle, SurfaceBlock *surface,
                          float radiance[3][BLOCK_RAYS]) {
    uint8_t flags = state->scene->mesh->arrays.flags[triangle];
    int is_computed = !is_tabulated(state, OBJECT_STATIC, triangle);
    surface->computed = is_computed ? 0xffff : 0;
    surface->lit = is_computed && !(flags & FACET_UNLIT) ? 0xffff : 0;
    surface->textured = is_computed && flags & FACET_TEXTURED ? 0xffff : 0;
    surface->dim = has_occlusion(state->scene, triangle) ? 0xffff : 0;
    surface->objects = 0;
    surface->coloured = flags & FACET_COMPUTED ? 0xffff : 0;
    surface->backs = 0;
    surface->emissive = flags & FACET_EMISSIVE ? 0xffff : 0;
    surface->smooth = flags & FACET_SMOOTH ? 0xffff : 0;
    if (!is_computed)
        set_all(radiance, table_entry(state, OBJECT_STATIC, triangle));
}

static void begin_plane(const FrameState *state, const RayBlock *rays, int32_t triangle,
                        const FacetPlane *plane, const LightProof *proof, SurfaceBlock *surface,
                        float radiance[3][BLOCK_RAYS]) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    set_all(radiance, table_entry(state, OBJECT_STATIC, triangle));
    /* Without point lights and shadows the table holds all light. */
    surface->lit = state->has_point_lights || state->frame->has_shadows ? surface->lit : 0;
    if (!surface->lit)
        return;
    find_plane_points(plane, vec3(mesh->normals + 3 * (size_t)triangle), rays, &surface->points);
    set_all(surface->albedo, vec3(mesh->albedo + 3 * (size_t)triangle));
    if (state->frame->has_shadows && !surface->num_proven)
        add_proof(surface, 0xffff,
                  proof ? *proof : prove_block(state, triangle, &surface->points));
}

/* Shading normals of smooth facets and of backs; geometry stays as it is. */
static void bend_normals(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                         SurfaceBlock *surface) {
    for (uint32_t left = surface->smooth | surface->backs; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        Vec3 normal = get_lane(surface->points.normal, lane);
        if (surface->smooth >> lane & 1) {
            int object = hits->object[lane];
            const float *corners =
                mesh_of(state, object)->corner_normals + 9 * (size_t)hits->triangle[lane];
            Vec3 first = vec3(corners);
            Vec3 along_u = scale(surface->points.u[lane], subtract(vec3(corners + 3), first));
            Vec3 along_v = scale(surface->points.v[lane], subtract(vec3(corners + 6), first));
            Vec3 between = add(first, add(along_u, along_v));
            float squared = dot(between, between);
            if (squared > 0.0f)
                normal = turn_normal(state, object, rays->time[lane],
                                     scale(1.0f / __builtin_sqrtf(squared), between));
        }
        set_lane(surface->points.normal, lane,
                 surface->backs >> lane & 1 ? scale(-1.0f, normal) : normal);
    }
}

static void add_emission(const FrameState *state, const HitBlock *hits, uint32_t emissive,
                         float radiance[3][BLOCK_RAYS]) {
    for (; emissive; emissive &= emissive - 1) {
        int lane = __builtin_ctz(emissive);
        const float *own = state->scene->mesh->arrays.emission + 3 * (size_t)hits->triangle[lane];
        set_lane(radiance, lane, add(get_lane(radiance, lane), vec3(own)));
    }
}

static void begin_surfaces(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                           SurfaceBlock *surface, float radiance[3][BLOCK_RAYS]) {
    find_hit_points(state, rays, hits, surface->computed, &surface->points);
    bend_normals(state, rays, hits, surface);
    memset(surface->albedo, 0, sizeof surface->albedo);
    uint32_t single = surface->objects | surface->coloured;
    for (uint32_t left = surface->computed, same; left; left &= ~same) {
        int lane = __builtin_ctz(left), object = hits->object[lane];
        int triangle = hits->triangle[lane];
        same = single >> lane & 1 ? 1u << lane : find_same(hits, lane) & left;
        Vec3 albedo = albedo_at(mesh_of(state, object), triangle, surface->points.u[lane],
                                surface->points.v[lane]);
        set_lanes(surface->albedo, same, albedo);
        set_lanes(radiance, same,
                  base_radiance(state, object, triangle, surface->coloured >> lane & 1, albedo,
                                get_lane(surface->points.normal, lane)));
    }
}

static void multiply_block(float values[3][BLOCK_RAYS], float factors[3][BLOCK_RAYS]) {
    for (int channel = 0; channel < 3; channel++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            values[channel][lane] *= factors[channel][lane];
}

void shade_block(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                 const LightProof *proof, const FacetProofs *proofs, int is_open,
                 float radiance[3][BLOCK_RAYS], LostLight *lost) {
    SurfaceBlock surface = {.num_proven = 0};
    int32_t triangle = proof && rays->active == 0xffff ? hits->triangle[0] : -1;
    for (int lane = 0; triangle >= 0 && lane < BLOCK_RAYS; lane++)
        if (sees_back(state, rays, lane, OBJECT_STATIC, triangle))
            triangle = -1;
    if (triangle >= 0)
        look_up_plane(state, triangle, &surface, radiance);
    else
        look_up(state, rays, hits, &surface, radiance);
    if (triangle < 0 && state->scene->sky)
        show_sky(state->scene, rays, bits16(load_ints16(hits->object) == OBJECT_NONE) & rays->active,
                 radiance);
    surface.dim = is_open ? 0 : surface.dim;
    if (!surface.computed) {
        hide_sky(state, surface.dim, 0, rays, hits, radiance);
        return;
    }
    if (triangle < 0 && state->has_one_pose)
        triangle = find_common_triangle(hits, surface.computed);
    int is_plane = triangle >= 0 && !surface.backs &&
                   !(state->scene->mesh->arrays.flags[triangle] & FACET_COMPUTED);
    if (proofs)
        find_proven(proofs, hits, &surface);
    FacetPlane plane;
    if (is_plane) {
        plane = find_facet_plane(state, triangle);
        begin_plane(state, rays, triangle, &plane, proof, &surface, radiance);
    } else {
        begin_surfaces(state, rays, hits, &surface, radiance);
    }
    /* The lights take as long as memory. */
    PlacedTexels placed;
    if (surface.textured && is_plane)
        place_plane_texels(state, triangle, &plane, rays, &placed);
    else if (surface.textured)
        place_hit_textures(state, rays, hits, &surface, &placed);
    /* Before any other light is added. */
    hide_sky(state, surface.dim, surface.coloured, rays, hits, radiance);
    if (surface.lit)
        memcpy(surface.unseen, radiance, sizeof surface.unseen);
    for (int light = 0; surface.lit && light < state->scene->num_lights; light++)
        add_light(state, light, rays, hits, &surface, radiance, lost);
    float texels[3][BLOCK_RAYS];
    if (surface.textured) {
        mix_textures(&placed, texels);
        multiply_block(radiance, texels);
    }
    if (surface.textured && lost && lost->rays)
        multiply_block(lost->radiance, texels);
    add_emission(state, hits, surface.emissive, radiance);
}
