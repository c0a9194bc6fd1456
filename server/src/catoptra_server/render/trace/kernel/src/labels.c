#include "labels.h"

#include "camera_rays.h"
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

static void write_normal(const FrameState *state, const RayBlock *rays, const HitPoints *points,
                         int lane, float *normal) {
    Vec3 found = get_lane(points->normal, lane);
    Pose pose = state->camera;
    /* Towards the ray's origin, whichever side of the facet the ray meets. */
    if (dot(found, get_lane(rays->direction, lane)) > 0.0f)
        found = scale(-1.0f, found);
    if (!state->has_one_pose)
        rigid_pose_at(state->frame->camera, state->frame->num_poses, 1, rays->time[lane], &pose);
    Vec3 in_mirror = rotate_back(pose.rotation, found);
    normal[0] = in_mirror.x;
    normal[1] = in_mirror.y;
    normal[2] = in_mirror.z;
}

static void write_lane(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                       const HitPoints *points, int lane, size_t at) {
    const Labels *labels = state->frame->labels;
    int number = number_of(labels, hits->object[lane], hits->triangle[lane]);
    if (labels->range_m)
        /* Rounding can put a plane that holds the viewpoint behind it. */
        labels->range_m[at] = points->distance[lane] > 0.0f ? points->distance[lane] : 0.0f;
    if (labels->ids)
        labels->ids[at] = (uint16_t)number;
    if (labels->classes)
        labels->classes[at] = labels->class_table[number];
    if (labels->normal)
        write_normal(state, rays, points, lane, labels->normal + 3 * at);
    for (int axis = 0; labels->point && axis < 3; axis++)
        labels->point[3 * at + (size_t)axis] =
            (float)((double)points->position[axis][lane] + labels->centre[axis]);
}

void label_tile(const FrameState *state, int tile, const TileContent *content) {
    RayBlock rays;
    HitBlock hits;
    HitPoints points;
    if (content->triangle == SURFACE_BACKGROUND && content->object == OBJECT_NONE)
        return;
    load_block(state, (size_t)tile, &rays);
    find_hits(state, &rays, &hits, content);
    uint32_t met = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        met |= (uint32_t)(hits.object[lane] != OBJECT_NONE) << lane;
    met &= rays.active;
    find_hit_points(state, &rays, &hits, met, &points);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int64_t at = met >> lane & 1 ? find_place(state, tile, lane) : -1;
        if (at >= 0)
            write_lane(state, &rays, &hits, &points, lane, (size_t)at);
    }
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
    for (int block = 0; block < blocks; block++) {
        size_t index = (size_t)tile * (size_t)blocks + (size_t)block;
        RayBlock rays;
        HitBlock hits;
        if (is_known) {
            int32_t object = content->triangle < 0 ? OBJECT_NONE : OBJECT_STATIC;
            for (int lane = 0; lane < BLOCK_RAYS; lane++) {
                hits.object[lane] = object;
                hits.triangle[lane] = content->triangle;
            }
            add_agreeing(state, block, state->rays->valid[index], &hits, expected, counts);
            continue;
        }
        load_block(state, index, &rays);
        find_hits(state, &rays, &hits, content);
        add_agreeing(state, block, rays.active, &hits, expected, counts);
    }
    for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
        if (places[pixel] >= 0)
            labels->agreement[places[pixel]] = (uint8_t)((510 * counts[pixel] + blocks) /
                                                         (2 * blocks));
}
