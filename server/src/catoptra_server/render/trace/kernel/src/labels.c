/* Provides labels.h: what the pixels' centres meet, and the agreement of samples.
 * Float64 twin: reference/pixels.py:label_pixels, count_agreement. Owns nothing: channels are
 * Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "labels.h"

#include "camera_rays.h"
#include "facet_plane.h"
#include "hit_points.h"
#include "label_block.h"
#include "pixels.h"

#include <math.h>
#include <string.h>

static int number_of(const Labels *labels, int32_t object, int32_t triangle) {
    if (object == OBJECT_NONE)
        return 0;
    return object == OBJECT_STATIC ? labels->triangle_numbers[triangle]
                                   : labels->object_numbers[object - 1];
}

/* Normal towards a ray's origin, whichever side of the facet the ray meets; mirror frame. */
static Vec3 find_normal(const Pose *camera, Vec3 normal, Vec3 direction) {
    float sign = dot(normal, direction) > 0.0f ? -1.0f : 1.0f;
    return rotate_back(camera->rotation, scale(sign, normal));
}

static Pose pose_of_ray(const FrameState *state, const RayBlock *rays, int lane) {
    Pose pose;
    rigid_pose_at(state->frame->camera, state->frame->num_poses, 1, rays->time[lane], &pose);
    return pose;
}

/* Normals of hits; zero for the rays beside the mask. */
static void turn_normals(const FrameState *state, const RayBlock *rays, uint32_t met,
                         const HitPoints *points, LabelBlock *block) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        Pose camera = state->has_one_pose ? state->camera : pose_of_ray(state, rays, lane);
        Vec3 normal = find_normal(&camera, get_lane(points->normal, lane),
                                  get_lane(rays->direction, lane));
        int is_met = met >> lane & 1;
        block->normal[0][lane] = is_met ? normal.x : 0.0f;
        block->normal[1][lane] = is_met ? normal.y : 0.0f;
        block->normal[2][lane] = is_met ? normal.z : 0.0f;
    }
}

/* Ranges and points of the rays of a mask by their distances; the others meet nothing. */
static void place_hits(const Labels *labels, const RayBlock *rays, uint32_t met,
                       const float distance[BLOCK_RAYS], LabelBlock *block) {
    /* Rounding can put a plane that holds the viewpoint behind it. */
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        float range = distance[lane] > 0.0f ? distance[lane] : 0.0f;
        block->range_m[lane] = met >> lane & 1 ? range : INFINITY;
    }
    for (int axis = 0; labels->point && axis < 3; axis++) {
        double centre = labels->centre[axis];
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            float here = rays->origin[axis][lane] + distance[lane] * rays->direction[axis][lane];
            float there = (float)(centre + (double)here);
            block->point[axis][lane] = met >> lane & 1 ? there : NAN;
        }
    }
}

static void label_hits(const FrameState *state, const TileContent *content, RayBlock *rays,
                       LabelBlock *block) {
    const Labels *labels = state->frame->labels;
    HitBlock hits;
    HitPoints points;
    uint32_t met = 0;
    intersect_content(state, rays, &hits, content);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        met |= (uint32_t)(hits.object[lane] != OBJECT_NONE) << lane;
    met &= rays->active;
    clear_block(block);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        if (met >> lane & 1)
            block->number[lane] =
                (uint16_t)number_of(labels, hits.object[lane], hits.triangle[lane]);
    if (!labels->range_m && !labels->point && !labels->normal)
        return;
    find_hit_points(state, rays, &hits, met, &points);
    place_hits(labels, rays, met, points.distance, block);
    if (labels->normal)
        turn_normals(state, rays, met, &points, block);
}

/* One plane that all rays meet: one number, one normal, no gathering of triangles. */
static void label_plane(const FrameState *state, int32_t triangle, const RayBlock *rays,
                        LabelBlock *block) {
    const Labels *labels = state->frame->labels;
    uint16_t number = labels->triangle_numbers[triangle];
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        block->number[lane] = rays->active >> lane & 1 ? number : 0;
    if (labels->range_m || labels->point) {
        FacetPlane plane = find_facet_plane(state, triangle);
        _Alignas(64) float distance[BLOCK_RAYS];
        find_distances(&plane, rays, distance);
        place_hits(labels, rays, rays->active, distance, block);
    }
    if (!labels->normal)
        return;
    /* Rays beside the mirror look anywhere; all others at the same side. */
    int any = rays->active ? __builtin_ctz(rays->active) : 0;
    Vec3 found = vec3(state->scene->mesh->arrays.normals + 3 * (size_t)triangle);
    Vec3 normal = find_normal(&state->camera, found, get_lane(rays->direction, any));
    float axes[3] = {normal.x, normal.y, normal.z};
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            block->normal[axis][lane] = rays->active >> lane & 1 ? axes[axis] : 0.0f;
}

/* What the centres of a tile's pixels meet, where the tile has any. */
static void label_rays(const FrameState *state, size_t centres, const TileContent *content,
                       LabelBlock *block) {
    int is_filled = content->triangle != SURFACE_UNKNOWN && content->object == OBJECT_NONE;
    RayBlock rays;
    if (is_filled && content->triangle == SURFACE_BACKGROUND) {
        clear_block(block);
        return;
    }
    load_rays(state, &state->frame->labels->centres, centres, &rays);
    if (is_filled && state->has_one_pose)
        label_plane(state, content->triangle, &rays, block);
    else
        label_hits(state, content, &rays, block);
}

void label_centres(const FrameState *state, int tile, const TileContent *content,
                   TileLabels *found) {
    const Labels *labels = state->frame->labels;
    TilePlace place = place_tile(state->rays, state->rays->tiles[tile]);
    int32_t centres = labels->centre_tile[tile];
    LabelBlock block;
    prefetch_block(labels, &place);
    /* A proof is one about the samples' rays, which need not hold the centres at the rim. */
    if (centres < 0)
        clear_block(&block);
    else
        label_rays(state, (size_t)centres, labels->is_held[tile] ? content : &UNKNOWN_CONTENT,
                   &block);
    store_block(labels, &place, &block);
    memcpy(found->number, block.number, sizeof found->number);
    memset(found->count, 0, sizeof found->count);
}

void count_samples(const FrameState *state, int block, uint32_t active, const HitBlock *hits,
                   TileLabels *found) {
    const Labels *labels = state->frame->labels;
    if (!labels->agreement)
        return;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int pixel = pixel_of_lane(state, block, lane);
        if (active >> lane & 1 && found->number[pixel]) /* nothing is no object to share */
            found->count[pixel] += found->number[pixel] ==
                                   number_of(labels, hits->object[lane], hits->triangle[lane]);
    }
}

void write_agreement(const FrameState *state, int tile, const TileLabels *found) {
    const Labels *labels = state->frame->labels;
    if (!labels->agreement)
        return;
    TilePlace place = place_tile(state->rays, state->rays->tiles[tile]);
    int samples = state->rays->samples * state->rays->samples;
    for (int row = 0; row < place.rows; row++)
        for (int column = 0; column < place.columns; column++)
            labels->agreement[place.first + (size_t)row * place.width_px + (size_t)column] =
                (uint8_t)((510 * found->count[row * TILE_PX + column] + samples) / (2 * samples));
}

static int number_of_content(const Labels *labels, const TileContent *content) {
    return content->triangle >= 0 ? labels->triangle_numbers[content->triangle] : 0;
}

void label_filled_tile(const FrameState *state, int tile, const TileContent *content) {
    TileLabels found;
    int number = number_of_content(state->frame->labels, content);
    int whole = number ? state->rays->samples * state->rays->samples : 0;
    label_centres(state, tile, content, &found);
    for (int pixel = 0; pixel < TILE_PIXELS; pixel++)
        found.count[pixel] = found.number[pixel] == number ? whole : 0;
    write_agreement(state, tile, &found);
}

void label_tile(const FrameState *state, int tile, const TileContent *content) {
    int blocks = state->rays->samples * state->rays->samples;
    if (content->triangle != SURFACE_UNKNOWN && content->object == OBJECT_NONE &&
        is_wholly_valid(state, tile)) {
        label_filled_tile(state, tile, content);
        return;
    }
    TileLabels found;
    label_centres(state, tile, content, &found);
    for (int block = 0; state->frame->labels->agreement && block < blocks; block++) {
        RayBlock rays;
        HitBlock hits;
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        find_hits(state, &rays, &hits, content);
        count_samples(state, block, rays.active, &hits, &found);
    }
    write_agreement(state, tile, &found);
}

void label_beside_view(const Labels *labels, const View *view) {
    const Beam *beams = view->levels[0].beams;
    int tiles = view->tile_rows * view->rays.tile_columns;
    LabelBlock block;
    clear_block(&block);
    for (int number = 0; number < tiles; number++) {
        if (view->tile_at[number] >= 0 && !(beams && beams[number].kind == BEAM_EMPTY))
            continue;
        TilePlace place = place_tile(&view->rays, number);
        store_block(labels, &place, &block);
        for (int row = 0; labels->agreement && row < place.rows; row++)
            memset(labels->agreement + place.first + (size_t)row * place.width_px, 0,
                   (size_t)place.columns);
    }
}
