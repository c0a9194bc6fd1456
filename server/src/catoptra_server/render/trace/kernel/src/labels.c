#include "labels.h"

#include "beam_origins.h"
#include "camera_rays.h"
#include "facet_plane.h"
#include "hit_points.h"
#include "pixels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TILE_PIXELS = TILE_PX * TILE_PX };
_Static_assert(TILE_PIXELS == BLOCK_RAYS, "one sample a pixel makes a tile a block");

/* Values of a tile's pixels, by component for vector code. */
typedef struct {
    _Alignas(64) float range_m[TILE_PIXELS];
    float normal[3][TILE_PIXELS];
    float point[3][TILE_PIXELS];
    uint16_t number[TILE_PIXELS];
} LabelBlock;

/* The pixels of a tile: the first one's position in the channels, and how many are in the image. */
typedef struct {
    size_t first, width_px;
    int rows, columns;
} LabelPlace;

static LabelPlace find_place(const RayTable *table, int32_t number) {
    int top = number / table->tile_columns * TILE_PX, left = number % table->tile_columns * TILE_PX;
    int rows = table->height_px - top, columns = table->width_px - left;
    return (LabelPlace){
        .first = (size_t)top * (size_t)table->width_px + (size_t)left,
        .width_px = (size_t)table->width_px,
        .rows = rows < TILE_PX ? rows : TILE_PX,
        .columns = columns < TILE_PX ? columns : TILE_PX,
    };
}

typedef float Row __attribute__((vector_size(4 * TILE_PX)));
typedef float Rows __attribute__((vector_size(8 * TILE_PX)));

/* Vectors of four pixels by pixel: in three stores instead of twelve, which would wait for one
 * another. */
static inline void store_vectors(const float values[3][TILE_PIXELS], int first, float *pixels) {
    Row x, y, z, right;
    memcpy(&x, values[0] + first, sizeof x);
    memcpy(&y, values[1] + first, sizeof y);
    memcpy(&z, values[2] + first, sizeof z);
    Rows xy = __builtin_shufflevector(x, y, 0, 4, 1, 5, 2, 6, 3, 7);
    Rows zz = __builtin_shufflevector(z, z, 0, 1, 2, 3, 4, 5, 6, 7);
    Rows left = __builtin_shufflevector(xy, zz, 0, 1, 8, 2, 3, 9, 4, 5);
    right = __builtin_shufflevector(xy, zz, 10, 6, 7, 11);
    memcpy(pixels, &left, sizeof left);
    memcpy(pixels + 2 * TILE_PX, &right, sizeof right);
}

/* Values of a tile by component into a channel of `depth` values a pixel. */
static inline __attribute__((always_inline)) void
store_floats(const LabelPlace *place, int depth, const float values[][TILE_PIXELS], int rows,
             int columns, float *channel) {
    for (int row = 0; row < rows; row++) {
        size_t at = place->first + (size_t)row * place->width_px;
        float *pixels = channel + (size_t)depth * at;
        if (depth == 3 && columns == TILE_PX)
            store_vectors(values, row * TILE_PX, pixels);
        else
            for (int column = 0; column < columns; column++)
                for (int axis = 0; axis < depth; axis++)
                    pixels[depth * column + axis] = values[axis][row * TILE_PX + column];
    }
}

static inline __attribute__((always_inline)) void
store_numbers(const LabelPlace *place, const uint16_t numbers[TILE_PIXELS], int rows, int columns,
              uint16_t *channel) {
    for (int row = 0; row < rows; row++)
        for (int column = 0; column < columns; column++)
            channel[place->first + (size_t)row * place->width_px + (size_t)column] =
                numbers[row * TILE_PX + column];
}

static inline __attribute__((always_inline)) void
store_pixels(const Labels *labels, const LabelPlace *place, const LabelBlock *block, int rows,
             int columns) {
    if (labels->ids)
        store_numbers(place, block->number, rows, columns, labels->ids);
    if (labels->classes) {
        uint16_t classes[TILE_PIXELS];
        for (int lane = 0; lane < TILE_PIXELS; lane++)
            classes[lane] = labels->class_table[block->number[lane]];
        store_numbers(place, classes, rows, columns, labels->classes);
    }
    if (labels->range_m)
        store_floats(place, 1, &block->range_m, rows, columns, labels->range_m);
    if (labels->normal)
        store_floats(place, 3, block->normal, rows, columns, labels->normal);
    if (labels->point)
        store_floats(place, 3, block->point, rows, columns, labels->point);
}

static void store_block(const Labels *labels, const LabelPlace *place, const LabelBlock *block) {
    /* With sides known to the compiler where the tile lies within the image. */
    if (place->rows == TILE_PX && place->columns == TILE_PX)
        store_pixels(labels, place, block, TILE_PX, TILE_PX);
    else
        store_pixels(labels, place, block, place->rows, place->columns);
}

/* Pixels whose rays meet nothing. */
static void clear_block(LabelBlock *block) {
    for (int lane = 0; lane < TILE_PIXELS; lane++) {
        block->number[lane] = 0;
        block->range_m[lane] = INFINITY;
    }
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < TILE_PIXELS; lane++) {
            block->normal[axis][lane] = 0.0f;
            block->point[axis][lane] = NAN;
        }
}

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

/* Ask for the memory that a tile's values will be stored in: tiles lie in it far apart, and each
 * store would wait for its line. */
static void prefetch_pixels(const Labels *labels, const LabelPlace *place) {
    for (int row = 0; row < place->rows; row++) {
        size_t at = place->first + (size_t)row * place->width_px;
        if (labels->ids)
            __builtin_prefetch(labels->ids + at, 1);
        if (labels->classes)
            __builtin_prefetch(labels->classes + at, 1);
        if (labels->range_m)
            __builtin_prefetch(labels->range_m + at, 1);
        if (labels->normal) {
            __builtin_prefetch(labels->normal + 3 * at, 1);
            __builtin_prefetch(labels->normal + 3 * at + 11, 1);
        }
        if (labels->point) {
            __builtin_prefetch(labels->point + 3 * at, 1);
            __builtin_prefetch(labels->point + 3 * at + 11, 1);
        }
    }
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
    LabelPlace place = find_place(state->rays, state->rays->tiles[tile]);
    int32_t centres = labels->centre_tile[tile];
    LabelBlock block;
    prefetch_pixels(labels, &place);
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
        if (active >> lane & 1)
            found->count[pixel] += found->number[pixel] ==
                                   number_of(labels, hits->object[lane], hits->triangle[lane]);
    }
}

void write_agreement(const FrameState *state, int tile, const TileLabels *found) {
    const Labels *labels = state->frame->labels;
    if (!labels->agreement)
        return;
    LabelPlace place = find_place(state->rays, state->rays->tiles[tile]);
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
    label_centres(state, tile, content, &found);
    for (int pixel = 0; pixel < TILE_PIXELS; pixel++)
        found.count[pixel] =
            found.number[pixel] == number ? state->rays->samples * state->rays->samples : 0;
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
        LabelPlace place = find_place(&view->rays, number);
        store_block(labels, &place, &block);
        for (int row = 0; labels->agreement && row < place.rows; row++)
            memset(labels->agreement + place.first + (size_t)row * place.width_px, 0,
                   (size_t)place.columns);
    }
}

static int is_ray_inside(const BeamLevel *tiles, int number, Vec3 origin, Vec3 direction) {
    const Beam *beam = tiles->beams + number;
    return beam->kind == BEAM_NARROW && is_direction_inside(beam, direction) &&
           (!tiles->origins || is_origin_inside(beam, tiles->origins + number, origin));
}

/* Whether the beam of a tile holds the rays of its pixels' centres, too. */
static int holds_centres(const View *view, int tile, const RayTable *centres, int32_t at) {
    const BeamLevel *tiles = view->levels;
    const float(*directions)[BLOCK_RAYS] =
        (const float(*)[BLOCK_RAYS])(centres->directions + (size_t)at * 3 * BLOCK_RAYS);
    const float(*origins)[BLOCK_RAYS] = NULL;
    if (centres->origins)
        origins = (const float(*)[BLOCK_RAYS])(centres->origins + (size_t)at * 3 * BLOCK_RAYS);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        Vec3 origin = origins ? get_lane(origins, lane) : (Vec3){0, 0, 0};
        if (centres->valid[at] >> lane & 1 &&
            !is_ray_inside(tiles, view->rays.tiles[tile], origin, get_lane(directions, lane)))
            return 0;
    }
    return 1;
}

int32_t catoptra_match_centres(const View *view, const RayTable *centres, int32_t *centre_tile,
                               uint8_t *is_held) {
    size_t numbers = (size_t)view->tile_rows * (size_t)view->rays.tile_columns;
    const Beam *beams = view->levels[0].beams;
    int32_t *at = malloc(sizeof *at * numbers), unmatched = 0;
    if (!at)
        return -1;
    memset(at, 0xff, sizeof *at * numbers);
    for (int32_t i = 0; i < centres->num_tiles; i++) {
        int32_t number = centres->tiles[i];
        at[number] = i;
        unmatched += centres->valid[i] && (view->tile_at[number] < 0 ||
                                           (beams && beams[number].kind == BEAM_EMPTY));
    }
    for (int32_t tile = 0; tile < view->rays.num_tiles; tile++) {
        centre_tile[tile] = at[view->rays.tiles[tile]];
        is_held[tile] = beams && centre_tile[tile] >= 0 &&
                        holds_centres(view, tile, centres, centre_tile[tile]);
    }
    free(at);
    return unmatched;
}
