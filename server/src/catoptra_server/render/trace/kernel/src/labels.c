#include "labels.h"

#include "camera_rays.h"
#include "facet_plane.h"
#include "hit_points.h"
#include "pixels.h"

#include <string.h>

static int number_of(const Labels *labels, int32_t object, int32_t triangle) {
    if (object == OBJECT_NONE)
        return 0;
    return object == OBJECT_STATIC ? labels->triangle_numbers[triangle]
                                   : labels->object_numbers[object - 1];
}

/* Position in the channels of a pixel of a tile; -1 beyond the image. */
static int64_t find_place(const FrameState *state, int tile, int pixel) {
    const RayTable *table = state->rays;
    int32_t number = table->tiles[tile];
    int row = number / table->tile_columns * TILE_PX + pixel / TILE_PX;
    int column = number % table->tile_columns * TILE_PX + pixel % TILE_PX;
    return row < table->height_px && column < table->width_px
               ? (int64_t)row * table->width_px + column
               : -1;
}

static Vec3 turn_to_mirror(const FrameState *state, float time, Vec3 vector) {
    Pose pose = state->camera;
    if (!state->has_one_pose)
        rigid_pose_at(state->frame->camera, state->frame->num_poses, 1, time, &pose);
    return rotate_back(pose.rotation, vector);
}

static void write_vector(float *values, Vec3 vector) {
    values[0] = vector.x;
    values[1] = vector.y;
    values[2] = vector.z;
}

static void write_normal(const FrameState *state, const RayBlock *rays, const HitPoints *points,
                         int lane, float *normal) {
    Vec3 found = get_lane(points->normal, lane);
    /* Towards the ray's origin, whichever side of the facet the ray meets. */
    if (dot(found, get_lane(rays->direction, lane)) > 0.0f)
        found = scale(-1.0f, found);
    write_vector(normal, turn_to_mirror(state, rays->time[lane], found));
}

static void write_numbers(const Labels *labels, int number, size_t at) {
    if (labels->ids)
        labels->ids[at] = (uint16_t)number;
    if (labels->classes)
        labels->classes[at] = labels->class_table[number];
}

/* Rounding can put a plane that holds the viewpoint behind it. */
static float limit_range(float distance) { return distance > 0.0f ? distance : 0.0f; }

static void write_point(const Labels *labels, const RayBlock *rays, int lane, float distance,
                        size_t at) {
    for (int axis = 0; axis < 3; axis++)
        labels->point[3 * at + (size_t)axis] =
            (float)(labels->centre[axis] + (double)(rays->origin[axis][lane] +
                                                    distance * rays->direction[axis][lane]));
}

static void write_lane(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                       const HitPoints *points, int lane, size_t at) {
    const Labels *labels = state->frame->labels;
    write_numbers(labels, number_of(labels, hits->object[lane], hits->triangle[lane]), at);
    if (labels->range_m)
        labels->range_m[at] = limit_range(points->distance[lane]);
    if (labels->normal)
        write_normal(state, rays, points, lane, labels->normal + 3 * at);
    if (labels->point)
        write_point(labels, rays, lane, points->distance[lane], at);
}

static void label_rays(const FrameState *state, int tile, const TileContent *content,
                       RayBlock *rays) {
    HitBlock hits;
    HitPoints points;
    uint32_t met = 0;
    find_hits(state, rays, &hits, content);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        met |= (uint32_t)(hits.object[lane] != OBJECT_NONE) << lane;
    met &= rays->active;
    find_hit_points(state, rays, &hits, met, &points);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int64_t at = met >> lane & 1 ? find_place(state, tile, lane) : -1;
        if (at >= 0)
            write_lane(state, rays, &hits, &points, lane, (size_t)at);
    }
}

/* One plane that all rays meet: one number, one normal, no gathering of triangles. */
static void label_plane(const FrameState *state, int tile, int32_t triangle,
                        const RayBlock *rays) {
    const Labels *labels = state->frame->labels;
    FacetPlane plane = find_facet_plane(state, triangle);
    _Alignas(64) float distance[BLOCK_RAYS];
    int number = labels->triangle_numbers[triangle];
    int needs_distance = labels->range_m || labels->point;
    if (needs_distance)
        find_distances(&plane, rays, distance);
    Vec3 found = vec3(state->scene->mesh->arrays.normals + 3 * (size_t)triangle);
    /* Rays beside the mirror look anywhere; all others at the same side. */
    int any = rays->active ? __builtin_ctz(rays->active) : 0;
    if (dot(found, get_lane(rays->direction, any)) > 0.0f)
        found = scale(-1.0f, found);
    Vec3 normal = turn_to_mirror(state, rays->time[any], found);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int64_t at = rays->active >> lane & 1 ? find_place(state, tile, lane) : -1;
        if (at < 0)
            continue;
        write_numbers(labels, number, (size_t)at);
        if (labels->range_m)
            labels->range_m[at] = limit_range(distance[lane]);
        if (labels->normal)
            write_vector(labels->normal + 3 * at, normal);
        if (labels->point)
            write_point(labels, rays, lane, distance[lane], (size_t)at);
    }
}

void label_tile(const FrameState *state, int tile, const TileContent *content) {
    RayBlock rays;
    int is_known = content->triangle != SURFACE_UNKNOWN && content->object == OBJECT_NONE;
    if (is_known && content->triangle == SURFACE_BACKGROUND)
        return;
    load_block(state, (size_t)tile, &rays);
    if (is_known && state->has_one_pose)
        label_plane(state, tile, content->triangle, &rays);
    else
        label_rays(state, tile, content, &rays);
}

/* Add the rays of a block that meet what their pixels' centres meet. */
static void add_agreeing(const FrameState *state, int block, uint32_t active, const HitBlock *hits,
                         const int expected[TILE_PX * TILE_PX], int counts[TILE_PX * TILE_PX]) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int pixel = pixel_of_lane(state, block, lane);
        if (active >> lane & 1)
            counts[pixel] += expected[pixel] == number_of(state->frame->labels, hits->object[lane],
                                                          hits->triangle[lane]);
    }
}

static void write_agreement(const Labels *labels, const int64_t places[TILE_PX * TILE_PX],
                            const int counts[TILE_PX * TILE_PX], int blocks) {
    for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
        if (places[pixel] >= 0)
            labels->agreement[places[pixel]] =
                (uint8_t)((510 * counts[pixel] + blocks) / (2 * blocks));
}

void count_agreement(const FrameState *state, int tile, const TileContent *content) {
    const Labels *labels = state->frame->labels;
    int blocks = state->rays->samples * state->rays->samples;
    int expected[TILE_PX * TILE_PX], counts[TILE_PX * TILE_PX] = {0};
    int64_t places[TILE_PX * TILE_PX];
    for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++) {
        places[pixel] = find_place(state, tile, pixel);
        expected[pixel] = places[pixel] < 0 ? 0 : labels->expected[places[pixel]];
    }
    int is_known = content->triangle != SURFACE_UNKNOWN && content->object == OBJECT_NONE;
    int known = is_known && content->triangle >= 0 ? labels->triangle_numbers[content->triangle] : 0;
    if (is_known && is_wholly_valid(state, tile)) {
        for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
            counts[pixel] = expected[pixel] == known ? blocks : 0;
        write_agreement(labels, places, counts, blocks);
        return;
    }
    for (int block = 0; block < blocks; block++) {
        RayBlock rays;
        HitBlock hits;
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        find_hits(state, &rays, &hits, content);
        add_agreeing(state, block, rays.active, &hits, expected, counts);
    }
    write_agreement(labels, places, counts, blocks);
}
