#include "tiles.h"

#include "camera_rays.h"
#include "facet_plane.h"
#include "hit_points.h"
#include "light_map.h"
#include "pixels.h"
#include "shading.h"

#include <math.h>
#include <string.h>

static void clear_hits(HitBlock *hits) {
    memset(hits->triangle, 0xff, sizeof hits->triangle);
    memset(hits->object, 0xff, sizeof hits->object);
}

/* The hits of rays that all meet one facet's plane; their distances limit the rays. */
static void set_hits(const FrameState *state, RayBlock *rays, HitBlock *hits, int32_t triangle) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        hits->triangle[lane] = triangle;
        hits->object[lane] = OBJECT_STATIC;
    }
    FacetPlane plane = find_facet_plane(state, triangle);
    find_distances(&plane, rays, rays->limit);
}

/* Rays in the frame of an object. */
static void move_rays(const RayBlock *rays, const Pose *pose, RayBlock *moved) {
    const float *r = pose->rotation;
    *moved = *rays;
    Vec3 origin = rotate_back(r, subtract(get_lane(rays->origin, 0), vec3(pose->translation)));
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        set_lane(moved->origin, lane, origin);
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            moved->direction[axis][lane] = r[axis] * rays->direction[0][lane] +
                                           r[3 + axis] * rays->direction[1][lane] +
                                           r[6 + axis] * rays->direction[2][lane];
}

/* Hits with one dynamic object, in its own frame: without the search among instances. */
static void intersect_object(const FrameState *state, int32_t object, RayBlock *rays,
                             HitBlock *hits) {
    RTCScene scene = state->frame->objects[object - 1]->scene;
    const Pose *pose = state->frame->object_poses + object - 1;
    RayBlock local;
    if (!scene)
        return;
    move_rays(rays, pose, &local);
    intersect_block(state->device, scene, object, &local, hits);
    memcpy(rays->limit, local.limit, sizeof rays->limit);
}

static void intersect_scene(const FrameState *state, const ShortList *short_list, RayBlock *rays,
                            HitBlock *hits) {
    if (short_list && intersect_short_list(short_list, rays, hits))
        return;
    if (state->scene->mesh->scene)
        intersect_block(state->device, state->scene->mesh->scene, OBJECT_STATIC, rays, hits);
}

static void find_hits(const FrameState *state, RayBlock *rays, HitBlock *hits,
                      const TileContent *content) {
    clear_hits(hits);
    if (content->triangle == SURFACE_UNKNOWN)
        intersect_scene(state, content->short_list, rays, hits);
    else if (content->triangle >= 0)
        set_hits(state, rays, hits, content->triangle);
    /* The scene's hits limit the rays: only nearer objects overwrite them. */
    if (state->objects && content->object == OBJECT_ANY)
        intersect_block(state->device, state->objects, OBJECT_ANY, rays, hits);
    else if (content->object != OBJECT_NONE && content->object != OBJECT_ANY)
        intersect_object(state, content->object, rays, hits);
}

void trace_tile(const FrameState *state, int tile) {
    int blocks = state->rays->samples * state->rays->samples;
    for (int block = 0; block < blocks; block++) {
        RayBlock rays;
        HitBlock hits;
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        find_hits(state, &rays, &hits, &UNKNOWN_CONTENT);
    }
}

static void store_hits(const FrameState *state, size_t block, const RayBlock *rays,
                       const HitBlock *hits) {
    const Frame *frame = state->frame;
    HitPoints points;
    uint32_t met = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        met |= (uint32_t)(hits->object[lane] != OBJECT_NONE) << lane;
    met &= rays->active;
    find_hit_points(state, rays, hits, met, &points);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        size_t at = block * BLOCK_RAYS + (size_t)lane;
        int is_met = met >> lane & 1;
        /* Rounding can put a plane that holds the viewpoint behind it. */
        frame->range_m[at] = is_met ? fmaxf(points.distance[lane], 0.0f) : INFINITY;
        frame->triangle[at] = is_met ? hits->triangle[lane] : -1;
        frame->object[at] = is_met ? hits->object[lane] : OBJECT_NONE;
    }
}

/* Pixels of one sample each, whose radiance is all in tables. */
static void write_table_colours(const FrameState *state, int tile, uint32_t active,
                                const HitBlock *hits) {
    const uint32_t *encoded = state->scene->encoded;
    TilePixels pixels = find_pixels(state, tile);
    for (int row = 0; row < pixels.rows; row++)
        for (int column = 0; column < pixels.columns; column++) {
            int lane = row * TILE_PX + column, object = hits->object[lane];
            char *pixel = pixel_at(&pixels, row, column);
            /* Pixels beside the mirror stay black. */
            if (!(active >> lane & 1))
                continue;
            if (object == OBJECT_STATIC)
                write_encoded(pixel, encoded[hits->triangle[lane]]);
            else if (object == OBJECT_NONE)
                write_encoded(pixel, encoded[state->scene->mesh->arrays.num_triangles]);
            else
                write_mean(state, pixel, table_entry(state, object, hits->triangle[lane]));
        }
}

static int has_table_colours(const FrameState *state, const HitBlock *hits) {
    int meets_object = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        meets_object |= hits->object[lane] > OBJECT_STATIC;
    return state->is_constant && state->frame->output == OUTPUT_SRGB &&
           (!meets_object || state->object_radiance);
}

static int is_wholly_valid(const FrameState *state, int tile) {
    int blocks = state->rays->samples * state->rays->samples;
    for (int block = 0; block < blocks; block++)
        if (state->rays->valid[(size_t)tile * (size_t)blocks + (size_t)block] != 0xffff)
            return 0;
    return 1;
}

/* A tile of one radiance: no ray, no sum. */
static void fill_tile(const FrameState *state, int tile, size_t entry) {
    const Scene *scene = state->scene;
    TilePixels pixels = find_pixels(state, tile);
    char row_of_pixels[TILE_PX * 3 * sizeof(float)];
    for (int column = 0; column < TILE_PX; column++) {
        char *pixel = row_of_pixels + (size_t)column * pixels.pixel_bytes;
        if (state->frame->output == OUTPUT_LINEAR)
            write_mean(state, pixel, vec3(scene->sharp_radiance + 3 * entry));
        else
            write_encoded(pixel, scene->encoded[entry]);
    }
    for (int row = 0; row < pixels.rows; row++)
        memcpy(pixel_at(&pixels, row, 0), row_of_pixels,
               (size_t)pixels.columns * pixels.pixel_bytes);
}

/* Row of the radiance table if that is all that a tile shows, -1 otherwise. */
static int64_t find_single_radiance(const FrameState *state, int32_t triangle, int is_unshadowed) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    if (triangle == SURFACE_BACKGROUND)
        return mesh->num_triangles;
    int is_textured = mesh->flags[triangle] & FACET_TEXTURED;
    return !is_textured && has_constant_light(state, triangle, is_unshadowed) ? triangle : -1;
}

/* Where a ray of a tile meets a facet's plane. */
static Vec3 meet_plane(const FrameState *state, const FacetPlane *plane, size_t block, int lane) {
    const Pose *pose = state->frame->camera;
    const float *from = state->rays->directions + block * 3 * BLOCK_RAYS + lane;
    Vec3 direction = rotate(pose->rotation,
                            (Vec3){from[0], from[BLOCK_RAYS], from[2 * BLOCK_RAYS]});
    Vec3 origin = vec3(pose->translation);
    float height = dot(plane->normal, subtract(plane->first, origin));
    return add(origin, scale(height / dot(plane->normal, direction), direction));
}

/* Whether no light is occluded anywhere on a block that a facet's plane fills. */
static int is_block_lit(const FrameState *state, int32_t triangle, size_t block) {
    if (!state->frame->has_shadows || !state->scene->light_maps || triangle < 0)
        return 0;
    FacetPlane plane = find_facet_plane(state, triangle);
    Vec3 corners[4] = {
        meet_plane(state, &plane, block, 0),
        meet_plane(state, &plane, block, TILE_PX - 1),
        meet_plane(state, &plane, block, BLOCK_RAYS - TILE_PX),
        meet_plane(state, &plane, block, BLOCK_RAYS - 1),
    };
    return is_quad_lit(state, triangle, corners);
}

static void set_all(float radiance[3][BLOCK_RAYS], Vec3 value) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        set_lane(radiance, lane, value);
}

/* Triangle that all rays of a block meet, or SURFACE_UNKNOWN. */
static int32_t find_common_triangle(const RayBlock *rays, const HitBlock *hits) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        if (hits->object[lane] != OBJECT_STATIC || hits->triangle[lane] != hits->triangle[0])
            return SURFACE_UNKNOWN;
    return rays->active == 0xffff ? hits->triangle[0] : SURFACE_UNKNOWN;
}

static void shade(const FrameState *state, size_t block, const RayBlock *rays,
                  const HitBlock *hits, int is_unshadowed, float radiance[3][BLOCK_RAYS]) {
    int32_t triangle = state->has_one_origin ? find_common_triangle(rays, hits) : SURFACE_UNKNOWN;
    is_unshadowed = is_unshadowed || is_block_lit(state, triangle, block);
    if (triangle < 0 || !has_constant_light(state, triangle, is_unshadowed)) {
        shade_block(state, rays, hits, radiance);
        return;
    }
    Vec3 light = constant_radiance(state, triangle, is_unshadowed);
    if (state->scene->mesh->arrays.flags[triangle] & FACET_TEXTURED) {
        FacetPlane plane = find_facet_plane(state, triangle);
        texture_block(state, triangle, &plane, rays, light, radiance);
    } else {
        set_all(radiance, light);
    }
}

static void render_samples(const FrameState *state, int tile, const TileContent *content) {
    int blocks = state->rays->samples * state->rays->samples;
    PixelSums sums;
    for (int block = 0; block < blocks; block++) {
        size_t index = (size_t)tile * (size_t)blocks + (size_t)block;
        RayBlock rays;
        HitBlock hits;
        _Alignas(64) float radiance[3][BLOCK_RAYS];
        load_block(state, index, &rays);
        find_hits(state, &rays, &hits, content);
        if (blocks == 1 && has_table_colours(state, &hits)) {
            write_table_colours(state, tile, rays.active, &hits);
            return;
        }
        shade(state, index, &rays, &hits, content->is_unshadowed, radiance);
        add_samples(state, block, rays.active, radiance, &sums);
    }
    write_pixels(state, tile, &sums);
}

static void identify_samples(const FrameState *state, int tile) {
    int blocks = state->rays->samples * state->rays->samples;
    for (int block = 0; block < blocks; block++) {
        size_t index = (size_t)tile * (size_t)blocks + (size_t)block;
        RayBlock rays;
        HitBlock hits;
        load_block(state, index, &rays);
        find_hits(state, &rays, &hits, &UNKNOWN_CONTENT);
        store_hits(state, index, &rays, &hits);
    }
}

void render_tile(const FrameState *state, int tile, const TileContent *content) {
    if (state->frame->output == OUTPUT_HITS) {
        identify_samples(state, tile);
        return;
    }
    int32_t triangle = content->triangle;
    int may_fill = triangle != SURFACE_UNKNOWN && content->object == OBJECT_NONE &&
                   is_wholly_valid(state, tile);
    int64_t entry =
        may_fill ? find_single_radiance(state, triangle, content->is_unshadowed) : -1;
    if (entry >= 0)
        fill_tile(state, tile, (size_t)entry);
    else
        render_samples(state, tile, content);
}
