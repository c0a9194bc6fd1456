/* Provides blur_plan.h: which tiles a frame's motion changes, and at how many instants these are
 * drawn.
 * No twin: conservative bounds. The plan owns its arrays, from create_plan to release_plan.
 * Threads: notes: any thread, each for tiles of its own. Creation and choice: the calling thread,
 * between the passes. */
#include "blur_plan.h"

#include "encoding.h"
#include "facet_plane.h"
#include "lanes.h"
#include "measures.h"
#include "pixels.h"
#include "tiles.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Below, nothing moves: float32 directions are known to about a thousandth of a pixel. */
#define MIN_DISPLACEMENT_PX 2e-3f
/* Displacement between two instants. */
#define MAX_STEP_PX 2.0f
/* Levels of dilation: by 1, 2, 4 ... cells or tiles. */
enum { REACH_LEVELS = 6, CHANNELS = 3, CELLS = 2, CELL_PIXELS = 4 };
/* A mask's bits beyond its cells: pixels, up to MAX_NEAR, of which no sample leaves the middle of
 * the farthest, so that these bound its change with half a pixel of reserve; 0: it goes farther. */
enum { NEAR = 1 << CELLS * CELLS, MAX_NEAR = 2, AROUND = TILE_PX + 2 * MAX_NEAR };
/* Where light is gathered: contrast times what parts of it move apart by at most, levels times px;
 * and doubt, levels or half of what may be left out. With these at most 0.74 % of the pixels
 * of six worlds differ by more than 2 levels from 64 frames, and 0.08 % by more than 8
 * (tests/measurements/shutter_rows.py). */
#define MAX_APART 4.0f
#define MAX_DOUBT 2.25f

static size_t count_tiles(const View *view) {
    return (size_t)view->tile_rows * (size_t)view->rays.tile_columns;
}

static int allocate(BlurPlan *plan, const View *view, int num_objects) {
    size_t tiles = count_tiles(view), cells = tiles * CELLS * CELLS;
    plan->cell_rows = CELLS * view->tile_rows;
    plan->cell_columns = CELLS * view->rays.tile_columns;
    plan->objects = malloc(sizeof(Pose) * 3 * (size_t)(num_objects + 1));
    size_t means = sizeof(float) * CHANNELS * BLOCK_RAYS * (size_t)(view->rays.num_tiles + 1);
    /* Pages that nobody writes to cost nothing. */
    plan->means = malloc(means);
    plan->blurred = malloc(means);
    plan->samples.is_sampled = calloc((size_t)view->rays.num_tiles + 1, 1);
    plan->samples.radiance =
        plan->is_gathered ? malloc(GATHERED_SIDE * GATHERED_SIDE * means) : NULL;
    plan->motions = malloc(sizeof(TileMotion) * (tiles + 1));
    plan->instants = calloc(tiles, sizeof(uint16_t));
    plan->masks = calloc(tiles, 1);
    plan->gathered = calloc(tiles, 1);
    plan->thin = calloc(tiles, 1);
    plan->lights = calloc(tiles, sizeof(LightProof));
    plan->cells = malloc(2 * CHANNELS * cells);
    int is_whole = plan->objects && plan->means && plan->blurred && plan->samples.is_sampled &&
                   (plan->samples.radiance || !plan->is_gathered) && plan->motions &&
                   plan->instants && plan->masks && plan->gathered && plan->thin &&
                   plan->lights && plan->cells;
    for (int level = 0; level < BEAM_LEVELS; level++) {
        const BeamLevel *parts = &view->levels[level];
        plan->wanted[level] = calloc((size_t)parts->rows * (size_t)parts->columns, 1);
        is_whole = is_whole && plan->wanted[level];
    }
    if (!is_whole)
        return 0;
    /* What no pixel has: the neutral values of both. */
    for (size_t tile = 0; tile < tiles; tile++)
        plan->motions[tile] = (TileMotion){0.0f, {INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
    memset(plan->cells, 255, CHANNELS * cells);
    memset(plan->cells + CHANNELS * cells, 0, CHANNELS * cells);
    return 1;
}

/* The nearest power of two: at nearly the same gain the same light is gathered, so that an effect
 * that is left out changes no more than itself. */
static float round_gain(float gain) {
    uint32_t bits;
    memcpy(&bits, &gain, sizeof bits);
    bits = (bits + 0x4afb0d) & 0x7f800000; /* up from the root of two on */
    memcpy(&gain, &bits, sizeof gain);
    return gain;
}

/* Place of the camera's pose in that of another time. */
static Pose relate_pose(const Pose *other, const Pose *camera) {
    Vec3 moved = rotate_back(other->rotation, subtract(vec3(camera->translation),
                                                       vec3(other->translation)));
    Pose found = {.translation = {moved.x, moved.y, moved.z}};
    for (int column = 0; column < 3; column++) {
        const float *c = camera->rotation + column;
        Vec3 axis = rotate_back(other->rotation, (Vec3){c[0], c[3], c[6]});
        found.rotation[column] = axis.x;
        found.rotation[3 + column] = axis.y;
        found.rotation[6 + column] = axis.z;
    }
    return found;
}

BlurPlan *create_plan(const FrameState *state) {
    const Frame *frame = state->frame;
    BlurPlan *plan = calloc(1, sizeof *plan);
    if (!plan)
        return NULL;
    plan->is_blurred = frame->exposure > 0.0f;
    plan->is_gathered = plan->is_blurred && !state->is_rolling && !state->rays->origins &&
                        state->rays->samples == GATHERED_SIDE;
    if (!allocate(plan, state->view, frame->num_objects)) {
        release_plan(plan);
        return NULL;
    }
    plan->counted = *frame;
    plan->counted.largest_gain = round_gain(frame->largest_gain);
    plan->interval = 1.0f / (float)(frame->num_poses - 1);
    float times[3] = {0.5f, 0.5f - 0.5f * plan->interval, 0.5f + 0.5f * plan->interval};
    Pose *cameras[3] = {&plan->camera, &plan->begin, &plan->end};
    for (int i = 0; i < 3; i++) {
        FrameState moved = at_instant(state, times[i]);
        *cameras[i] = moved.camera;
        if (i)
            plan->related[i - 1] = relate_pose(&moved.camera, &plan->camera);
        for (int object = 0; object < frame->num_objects; object++)
            object_pose(&moved, object, plan->objects + 3 * object + i);
    }
    return plan;
}

void release_plan(BlurPlan *plan) {
    if (!plan)
        return;
    for (int level = 0; level < BEAM_LEVELS; level++)
        free(plan->wanted[level]);
    free(plan->objects);
    free(plan->means);
    free(plan->blurred);
    free(plan->samples.is_sampled);
    free(plan->samples.radiance);
    free(plan->gathered);
    free(plan->motions);
    free(plan->instants);
    free(plan->masks);
    free(plan->thin);
    free(plan->lights);
    free(plan->cells);
    free(plan);
}

static Vec3 unit(Vec3 a) { return scale(1.0f / sqrtf(dot(a, a)), a); }

static Vec3 place(const Pose *pose, Vec3 point) {
    return add(rotate(pose->rotation, point), vec3(pose->translation));
}

static Vec3 place_back(const Pose *pose, Vec3 point) {
    return rotate_back(pose->rotation, subtract(point, vec3(pose->translation)));
}

/* Direction, from another pose, to the static point that the camera sees in a direction at an
 * inverse range. */
static Vec3 look_back(const Pose *related, Vec3 direction, float inverse) {
    return unit(add(rotate(related->rotation, direction),
                    scale(inverse, vec3(related->translation))));
}

/* Rays with origins pass the viewpoint, from which speeds are measured: what is near moves by up to
 * this much more. */
static float parallax_factor(const FrameState *state, float inverse) {
    return 1.0f + state->view->max_origin_m * inverse;
}

/* Take down a change of the direction in which something of an inverse range is seen. */
static void note_motion(const FrameState *state, int tile, Vec3 change, float inverse) {
    const float *pixel_scale = state->view->pixel_scales + 6 * (size_t)tile;
    TileMotion *noted = state->plan->motions + state->rays->tiles[tile];
    float squared = 0.0f;
    for (int axis = 0; axis < 2; axis++) {
        float moved = dot(vec3(pixel_scale + 3 * axis), change) / state->plan->interval;
        squared += moved * moved;
        noted->least[axis] = fminf(noted->least[axis], moved);
        noted->most[axis] = fmaxf(noted->most[axis], moved);
    }
    noted->speed = fmaxf(noted->speed, sqrtf(squared) * parallax_factor(state, inverse));
}

static void note_static(const FrameState *state, int tile, Vec3 direction, float inverse) {
    const Pose *related = state->plan->related;
    note_motion(state, tile,
                subtract(look_back(related + 1, direction, inverse),
                         look_back(related, direction, inverse)),
                inverse);
}

static void note_object(const FrameState *state, int tile, int object, Vec3 direction,
                        float range) {
    const BlurPlan *plan = state->plan;
    const Pose *poses = plan->objects + 3 * (object - 1);
    Vec3 point = place(&plan->camera, scale(range, direction));
    Vec3 local = place_back(poses, point);
    Vec3 begin = unit(place_back(&plan->begin, place(poses + 1, local)));
    Vec3 end = unit(place_back(&plan->end, place(poses + 2, local)));
    note_motion(state, tile, subtract(end, begin), 1.0f / range);
}

/* The nearest and the farthest hits of a block, of the static scene and of objects. */
typedef struct {
    int nearest, farthest; /* lanes; -1: none */
} Extremes;

static Extremes find_extremes(const RayBlock *rays, const HitBlock *hits, int is_object) {
    Extremes found = {-1, -1};
    Floats16 ranges = load16(rays->limit);
    uint32_t objects = bits16(load_ints16(hits->object) > OBJECT_STATIC);
    uint32_t among = rays->active & (is_object ? objects : ~objects);
    if (!among)
        return found;
    float least = least_of16(select16(mask16(among), ranges, splat16(INFINITY)));
    float most = most_of16(select16(mask16(among), ranges, splat16(-INFINITY)));
    found.nearest = __builtin_ctz(bits16(ranges == least) & among);
    found.farthest = __builtin_ctz(bits16(ranges == most) & among);
    return found;
}

static Vec3 mirror_direction(const FrameState *state, const RayBlock *rays, int lane) {
    return rotate_back(state->camera.rotation,
                       get_lane((const float(*)[BLOCK_RAYS])rays->direction, lane));
}

void note_hits(const FrameState *state, int tile, const RayBlock *rays, const HitBlock *hits) {
    Extremes scene = find_extremes(rays, hits, 0), objects = find_extremes(rays, hits, 1);
    int scene_lanes[2] = {scene.nearest, scene.farthest};
    int object_lanes[2] = {objects.nearest, objects.farthest};
    for (int i = 0; i < 2; i++) {
        int lane = scene_lanes[i];
        if (lane >= 0)
            note_static(state, tile, mirror_direction(state, rays, lane),
                        1.0f / rays->limit[lane]);
        lane = object_lanes[i];
        if (lane >= 0)
            note_object(state, tile, hits->object[lane], mirror_direction(state, rays, lane),
                        rays->limit[lane]);
    }
    if (!state->scene->sky && !state->frame->has_gloss)
        return;
    /* Gloss moves otherwise. A sky's samples are too few for its sun and clouds; to look them up at
     * other instants takes no search. */
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int32_t triangle = hits->triangle[lane];
        int moves_apart = triangle < 0
                              ? state->scene->sky != NULL
                              : hits->object[lane] == OBJECT_STATIC && is_glossy(state, triangle);
        if (rays->active >> lane & 1 && moves_apart)
            note_apart(state, rays->index);
    }
}

void note_apart(const FrameState *state, size_t block) {
    size_t blocks = (size_t)state->rays->samples * (size_t)state->rays->samples;
    state->plan->motions[state->rays->tiles[block / blocks]].most[0] = INFINITY;
}

void note_lights(const FrameState *state, size_t tile, LightProof lights) {
    LightProof *noted = state->plan->lights + state->rays->tiles[tile];
    if (state->plan->are_lights_known)
        return;
    noted->seen |= lights.seen;
    noted->hidden |= lights.hidden;
}

void note_plane(const FrameState *state, int tile, int32_t triangle) {
    size_t blocks = (size_t)state->rays->samples * (size_t)state->rays->samples;
    const float *from = state->rays->directions + (size_t)tile * blocks * 3 * BLOCK_RAYS;
    Vec3 direction = {from[0], from[BLOCK_RAYS], from[2 * BLOCK_RAYS]};
    float inverse = 0.0f;
    if (triangle >= 0) {
        const MeshArrays *mesh = &state->scene->mesh->arrays;
        Vec3 normal = vec3(mesh->normals + 3 * (size_t)triangle);
        Vec3 first = plane_point(state, triangle);
        Vec3 seen = rotate(state->camera.rotation, direction);
        inverse = dot(normal, seen) /
                  dot(normal, subtract(first, vec3(state->camera.translation)));
    }
    note_static(state, tile, direction, inverse);
}

/* Bit mask of the pixels of a tile all of whose rays see the mirror: at its rim, the difference to
 * black does not move. */
static uint32_t find_whole_pixels(const FrameState *state, int tile) {
    const RayOrder *order = &state->view->by_row;
    int blocks = state->rays->samples * state->rays->samples;
    const uint16_t *valid = state->rays->valid + (size_t)tile * (size_t)blocks;
    uint32_t common = 0xffff, whole = 0xffff;
    for (int block = 0; block < blocks; block++)
        common &= valid[block];
    for (int i = 0; common != 0xffff && i < TILE_PX * order->blocks * BLOCK_RAYS; i++) {
        int source = order->source[i], row = i / (order->blocks * BLOCK_RAYS);
        if (source != NO_RAY && !(valid[source / BLOCK_RAYS] >> source % BLOCK_RAYS & 1))
            whole &= ~(1u << (row * TILE_PX + i % TILE_PX));
    }
    return whole;
}

/* First pixel in a tile of one of its cells. */
static int first_pixel(int cell) { return cell / CELLS * 2 * TILE_PX + cell % CELLS * 2; }

static int is_cell_whole(uint32_t whole, int cell) {
    return (whole >> first_pixel(cell) & 0x33) == 0x33;
}

static size_t find_cell(const FrameState *state, int tile, int cell) {
    int32_t number = state->rays->tiles[tile], columns = state->rays->tile_columns;
    return (size_t)(CELLS * (number / columns) + cell / CELLS) * (size_t)(CELLS * columns) +
           (size_t)(CELLS * (number % columns) + cell % CELLS);
}

void note_means(const FrameState *state, int tile, const float means[3][TILE_PX * TILE_PX]) {
    BlurPlan *plan = state->plan;
    size_t plane = (size_t)plan->cell_rows * (size_t)plan->cell_columns;
    memcpy(plan->means + (size_t)tile * CHANNELS * BLOCK_RAYS, means,
           sizeof(float) * CHANNELS * BLOCK_RAYS);
    uint32_t whole = find_whole_pixels(state, tile);
    float gain = state->frame->largest_gain;
    for (int cell = 0; cell < CELLS * CELLS; cell++) {
        uint8_t *at = plan->cells + find_cell(state, tile, cell);
        if (!is_cell_whole(whole, cell))
            continue;
        for (int channel = 0; channel < CHANNELS; channel++) {
            const float *m = means[channel] + first_pixel(cell);
            float low = fminf(fminf(m[0], m[1]), fminf(m[TILE_PX], m[TILE_PX + 1]));
            float high = fmaxf(fmaxf(m[0], m[1]), fmaxf(m[TILE_PX], m[TILE_PX + 1]));
            uint8_t code = code_of_light(gain * low);
            at[plane * (size_t)channel] = code;
            at[plane * (size_t)(CHANNELS + channel)] =
                high > low ? code_of_light(gain * high) : code;
        }
    }
}

void note_block(const FrameState *state, int tile, int block, float radiance[3][BLOCK_RAYS]) {
    TileSamples *samples = &state->plan->samples;
    if (!samples->radiance)
        return;
    samples->is_sampled[tile] = 1;
    memcpy(samples->radiance + ((size_t)tile * 4 + (size_t)block) * CHANNELS * BLOCK_RAYS,
           radiance, sizeof(float) * CHANNELS * BLOCK_RAYS);
}

void note_thin(const FrameState *state, int tile) {
    BlurPlan *plan = state->plan;
    size_t plane = (size_t)plan->cell_rows * (size_t)plan->cell_columns;
    plan->thin[state->rays->tiles[tile]] = 1;
    for (int cell = 0; cell < CELLS * CELLS; cell++)
        for (int i = 0; i < 2 * CHANNELS; i++)
            plan->cells[plane * (size_t)i + find_cell(state, tile, cell)] = i < CHANNELS ? 0 : 255;
}

static void greater(uint8_t *restrict to, const uint8_t *restrict from, size_t count) {
    for (size_t i = 0; i < count; i++)
        to[i] = from[i] > to[i] ? from[i] : to[i];
}

static void lesser(uint8_t *restrict to, const uint8_t *restrict from, size_t count) {
    for (size_t i = 0; i < count; i++)
        to[i] = from[i] < to[i] ? from[i] : to[i];
}

typedef void (*Merge)(uint8_t *restrict, const uint8_t *restrict, size_t);

/* Extremes within `step` to both sides, along rows and then columns. */
static void dilate(uint8_t *plane, uint8_t *scratch, int rows, int columns, int step, Merge merge) {
    size_t width = (size_t)columns, shift = (size_t)(step < columns ? step : columns);
    for (int row = 0; row < rows; row++) {
        const uint8_t *from = plane + (size_t)row * width;
        uint8_t *to = scratch + (size_t)row * width;
        memcpy(to, from, width);
        merge(to, from + shift, width - shift);
        merge(to + shift, from, width - shift);
    }
    memcpy(plane, scratch, width * (size_t)rows);
    for (int row = 0; row < rows; row++) {
        if (row >= step)
            merge(plane + (size_t)row * width, scratch + (size_t)(row - step) * width, width);
        if (row + step < rows)
            merge(plane + (size_t)row * width, scratch + (size_t)(row + step) * width, width);
    }
}

/* Number of the dilation that a reach takes, in units of its first step. */
static int reach_level(float reach) {
    int level = 0;
    while (level < REACH_LEVELS - 1 && reach > (float)(1 << level))
        level++;
    return level;
}

/* Of a pixel that shows what is up to some pixels away, by cells. */
static int cell_level(float distance) { return reach_level((distance + 0.5f) / 2.0f); }

static void dilate_speeds(float *to, const float *from, int rows, int columns, int step) {
    for (int row = 0; row < rows; row++)
        for (int column = 0; column < columns; column++) {
            float speed = from[row * columns + column];
            if (!(speed > 0.0f))
                continue;
            int top = row - step > 0 ? row - step : 0, left = column - step > 0 ? column - step : 0;
            int bottom = row + step < rows - 1 ? row + step : rows - 1;
            int right = column + step < columns - 1 ? column + step : columns - 1;
            for (int i = top; i <= bottom; i++)
                for (int k = left; k <= right; k++)
                    to[i * columns + k] = fmaxf(to[i * columns + k], speed);
        }
}

/* Displacement during `time` of all that may reach into a tile, px. Fast surfaces reach far. */
static float *spread_speeds(const FrameState *state, float time) {
    const View *view = state->view;
    size_t tiles = count_tiles(view);
    int rows = view->tile_rows, columns = view->rays.tile_columns;
    float *spread = calloc(2 * tiles, sizeof(float));
    if (!spread)
        return NULL;
    float *layer = spread + tiles;
    for (int level = 0; level < REACH_LEVELS; level++) {
        int count = 0;
        for (size_t tile = 0; tile < tiles; tile++) {
            float displacement = time * state->plan->motions[tile].speed;
            int is_here = displacement > MIN_DISPLACEMENT_PX &&
                          reach_level((0.5f * displacement + 1.0f) / TILE_PX) == level;
            layer[tile] = is_here ? displacement : 0.0f;
            count += is_here;
        }
        if (count)
            dilate_speeds(spread, layer, rows, columns, 1 << level);
    }
    return spread;
}

/* Greatest contrast within reach of a cell of a tile, grey levels. */
static float find_contrast(const FrameState *state, const uint8_t *cells, int row, int column,
                           int cell) {
    const BlurPlan *plan = state->plan;
    float to_light = 1.0f / state->frame->largest_gain;
    size_t plane = (size_t)plan->cell_rows * (size_t)plan->cell_columns;
    const uint8_t *at = cells + (size_t)(CELLS * row + cell / CELLS) * (size_t)plan->cell_columns +
                        CELLS * column + cell % CELLS;
    float contrast = 0.0f;
    for (int channel = 0; channel < CHANNELS; channel++) {
        uint8_t low = at[plane * (size_t)channel], high = at[plane * (size_t)(CHANNELS + channel)];
        float light = to_light * light_of_code(high), dark = to_light * light_of_code(low);
        float difference = level_of_code(high) - level_of_code(low);
        if (light > dark)
            difference += spilt_levels(state->frame, light, light - dark);
        contrast = difference > contrast ? difference : contrast;
    }
    return fminf(255.0f, contrast);
}

/* Whether motion changes a cell by more than what may be left out, which counts all the same:
 * however little is displaced, an edge may pass all samples of a pixel. */
static int is_visible(const FrameState *state, float contrast, float displacement) {
    if (displacement < MIN_DISPLACEMENT_PX)
        return 0;
    if (contrast > state->frame->blur_threshold)
        return 1;
    raise_largest(&state->measures->blur, contrast);
    count_visible(&state->measures->blur, contrast > VISIBLE_LEVELS ? CELL_PIXELS : 0);
    return 0;
}

/* Least number of instants: nothing may pass a pixel unseen between two of them. */
static int count_instants(const Frame *frame, float displacement) {
    int count = 2;
    while ((float)count * MAX_STEP_PX < displacement && 2 * count <= frame->max_instants)
        count *= 2;
    return count;
}

/* A pixel's outermost samples are half of its side but for half a sample off its middle. */
static int count_near(const FrameState *state, float displacement) {
    float samples = (float)state->rays->samples;
    float reach = 0.5f * displacement + 0.5f * (samples - 1.0f) / samples;
    return reach <= 1.0f ? 1 : reach <= (float)MAX_NEAR ? MAX_NEAR : 0;
}

static void want_cell(const FrameState *state, int at, int cell, float displacement) {
    BlurPlan *plan = state->plan;
    plan->masks[at] |= (uint8_t)(1 << cell | NEAR * count_near(state, displacement));
    plan->instants[at] = (uint16_t)count_instants(state->frame, displacement);
}

/* A row that is exposed later or earlier than the pose shows the scene displaced. */
static void note_rolling(const FrameState *state, float contrast, float displacement) {
    float change = displacement >= MIN_DISPLACEMENT_PX ? contrast : 0.0f;
    raise_largest(&state->plan->rolling, change);
    count_visible(&state->plan->rolling, change > VISIBLE_LEVELS ? CELL_PIXELS : 0);
}

/* One decision for all tiles whose motion reaches as far as one level of dilation. */
static void choose_level(const FrameState *state, const uint8_t *cells, int level,
                         const float *displacements, const float *rolled) {
    const View *view = state->view;
    int columns = view->rays.tile_columns;
    for (int row = 0; row < view->tile_rows; row++)
        for (int column = 0; column < columns; column++) {
            int at = row * columns + column;
            if (view->tile_at[at] < 0)
                continue;
            int is_blurred = displacements && cell_level(0.5f * displacements[at]) == level;
            int is_rolled = rolled && cell_level(rolled[at]) == level;
            if (!is_blurred && !is_rolled)
                continue;
            float offset = fabsf(row_time(state, TILE_PX * ((float)row + 0.5f)) - 0.5f);
            for (int cell = 0; cell < CELLS * CELLS; cell++) {
                float contrast = find_contrast(state, cells, row, column, cell);
                if (is_blurred && is_visible(state, contrast, displacements[at]))
                    want_cell(state, at, cell, displacements[at]);
                if (is_rolled)
                    note_rolling(state, contrast,
                                 rolled[at] * 2.0f * offset / state->frame->readout);
            }
        }
}

/* Levels of dilation of pixels that show what is up to a part of the tiles' displacements away. */
static int count_levels(const FrameState *state, const float *displacements, float part) {
    float largest = 0.0f;
    for (size_t tile = 0; displacements && tile < count_tiles(state->view); tile++)
        largest = fmaxf(largest, displacements[tile]);
    return displacements ? cell_level(part * largest) + 1 : 0;
}

static uint8_t extreme_of(const uint8_t *codes, size_t count, int is_greatest) {
    uint8_t extreme = is_greatest ? 0 : 255;
    for (size_t i = 0; i < count; i++)
        extreme = (codes[i] > extreme) == is_greatest ? codes[i] : extreme;
    return extreme;
}

/* What comes in beyond the rim is in no sharp frame: cells at the rim count as if all of the
 * picture's light met there. */
static void fill_rim(const FrameState *state) {
    BlurPlan *plan = state->plan;
    size_t columns = (size_t)plan->cell_columns, plane = (size_t)plan->cell_rows * columns;
    uint8_t extremes[2 * CHANNELS];
    for (int i = 0; i < 2 * CHANNELS; i++)
        extremes[i] = extreme_of(plan->cells + plane * (size_t)i, plane, i >= CHANNELS);
    for (int tile = 0; tile < state->rays->num_tiles; tile++) {
        uint32_t whole = find_whole_pixels(state, tile);
        for (int cell = 0; whole != 0xffff && cell < CELLS * CELLS; cell++)
            for (int i = 0; !is_cell_whole(whole, cell) && i < 2 * CHANNELS; i++)
                plan->cells[plane * (size_t)i + find_cell(state, tile, cell)] = extremes[i];
    }
}

/* Tiles of 3 x 3. */
enum { TILES_AROUND = 9, MIDDLE = 4 };

/* Numbers of a tile and of those around, -1 beside the mirror; 0 if it lies at the picture's
 * edge. */
static int find_around(const FrameState *state, int32_t number, int32_t tiles[TILES_AROUND]) {
    const View *view = state->view;
    int columns = view->rays.tile_columns, row = number / columns, column = number % columns;
    if (row < 1 || column < 1 || row + 1 >= view->tile_rows || column + 1 >= columns)
        return 0;
    for (int i = 0; i < TILES_AROUND; i++)
        tiles[i] = view->tile_at[number + (i / 3 - 1) * columns + i % 3 - 1];
    return 1;
}

/* Cells of the middle tile about which the sharp frame shows all that is near: no rim, and nothing
 * that may pass between the samples. A cell reaches into tiles of its own corner alone. */
static int find_known_cells(const FrameState *state, const int32_t tiles[TILES_AROUND]) {
    int known = 0, cells = 0;
    for (int i = 0; i < TILES_AROUND; i++)
        if (tiles[i] >= 0 && is_wholly_valid(state, tiles[i]) &&
            !state->plan->thin[state->rays->tiles[tiles[i]]])
            known |= 1 << i;
    for (int cell = 0; cell < CELLS * CELLS; cell++) {
        int down = cell / CELLS ? 3 : -3, right = cell % CELLS ? 1 : -1;
        int corner = 1 << MIDDLE | 1 << (MIDDLE + down) | 1 << (MIDDLE + right) |
                     1 << (MIDDLE + down + right);
        cells |= ((known & corner) == corner) << cell;
    }
    return cells;
}

/* Light of a tile's pixels and of those around, its own beside the picture. */
static void collect_pixels(const FrameState *state, const int32_t tiles[TILES_AROUND],
                           float light[CHANNELS][AROUND][AROUND]) {
    for (int y = 0; y < AROUND; y++) {
        int row = (y + TILE_PX - MAX_NEAR) / TILE_PX, line = (y + TILE_PX - MAX_NEAR) % TILE_PX;
        for (int channel = 0; channel < CHANNELS; channel++) {
            Floats4 of[3];
            for (int i = 0; i < 3; i++) {
                int32_t tile = tiles[3 * row + i] < 0 ? tiles[MIDDLE] : tiles[3 * row + i];
                of[i] = load4(state->plan->means +
                              ((size_t)tile * CHANNELS + (size_t)channel) * BLOCK_RAYS +
                              TILE_PX * line);
            }
            Floats4 left = __builtin_shufflevector(of[0], of[1], 2, 3, 4, 5);
            store4(left, light[channel][y]);
            store4(__builtin_shufflevector(of[1], of[2], 2, 3, 4, 5), light[channel][y] + TILE_PX);
        }
    }
}

/* Largest second difference of a row of pixels, along the axes and both diagonals. */
static Floats8 find_bends(const Floats8 rows[3]) {
    Floats8 left[3], right[3], twice = rows[1] + rows[1], bends = {0};
    for (int i = 0; i < 3; i++) {
        left[i] = __builtin_shufflevector(rows[i], rows[i], 0, 0, 1, 2, 3, 4, 5, 6);
        right[i] = __builtin_shufflevector(rows[i], rows[i], 1, 2, 3, 4, 5, 6, 7, 7);
    }
    for (int i = 0; i < 3; i++)
        bends = most8(absolute8(left[i] + right[2 - i] - twice), bends);
    return most8(absolute8(rows[0] + rows[2] - twice), bends);
}

/* Largest of two, four or six values, from each place on. */
static Floats8 most_of_width(Floats8 values, int width) {
    Floats8 two = most8(__builtin_shufflevector(values, values, 1, 2, 3, 4, 5, 6, 7, 7), values);
    if (width == 2)
        return two;
    Floats8 four = most8(__builtin_shufflevector(two, two, 2, 3, 4, 5, 6, 7, 7, 7), two);
    return width == 4
               ? four
               : most8(__builtin_shufflevector(two, two, 4, 5, 6, 7, 7, 7, 7, 7), four);
}

/* Values of a tile's cells, by channel. */
typedef float CellValues[BLOCK_RAYS];
enum { CELL_VALUES = CHANNELS * CELLS * CELLS };

/* Extremes of light within `reach` of a tile's cells, and how much it bends there. */
static void find_cell_extremes(const float light[CHANNELS][AROUND][AROUND], int reach,
                               CellValues lows, CellValues highs, CellValues bends) {
    int width = 2 + 2 * reach;
    for (int channel = 0; channel < CHANNELS; channel++) {
        Floats8 rows[AROUND], bent[AROUND];
        memcpy(rows, light[channel], sizeof rows);
        for (int y = 1; bends && y < AROUND - 1; y++)
            bent[y] = find_bends(rows + y - 1);
        for (int row = 0; row < CELLS; row++) {
            int top = MAX_NEAR - reach + 2 * row, bottom = top + width;
            int at = channel * CELLS * CELLS + row * CELLS;
            Floats8 least = rows[top], most = rows[top], bend = {0};
            for (int y = top + 1; y < bottom; y++) {
                least = least8(rows[y], least);
                most = most8(rows[y], most);
            }
            for (int y = top + 1; bends && y < bottom - 1; y++)
                bend = most8(bent[y], bend);
            least = most_of_width(-least, width);
            most = most_of_width(most, width);
            bend = most_of_width(bend, width - 2);
            for (int column = 0; column < CELLS; column++) {
                int left = MAX_NEAR - reach + 2 * column;
                lows[at + column] = -least[left];
                highs[at + column] = most[left];
                if (bends)
                    bends[at + column] = bend[left + 1];
            }
        }
    }
}

/* Bounds of the changes of a tile's cells by what moves so many pixels at most: by the contrast
 * there, or by how little light bends. As much comes from before as from behind, so that even
 * slopes stay as they are: edges, corners, ramps and lines of 0.3 to 3 px change a cell by at most
 * 0.44 of the largest second difference (tests/measurements/even_slopes.py). */
#define MAX_OF_BEND 0.5f
static void bound_near_changes(const Frame *frame, const float light[CHANNELS][AROUND][AROUND],
                               int reach, float bounds[CELLS * CELLS]) {
    CellValues lows = {0}, highs = {0}, bends = {0}, levels;
    find_cell_extremes(light, reach, lows, highs, bends);
    Floats16 low = load16(lows);
    Floats16 change = least16(load16(highs) - low, MAX_OF_BEND * load16(bends));
    store16(low + change, bends);
    find_level_changes(frame, lows, bends, levels);
    for (int i = 0; i < CELL_VALUES; i++) {
        float *bound = bounds + i % (CELLS * CELLS);
        *bound = fmaxf(*bound, levels[i] + spilt_levels(frame, highs[i], change[i]));
    }
}

/* Largest differences of light within each cell and around it, grey levels. */
static void measure_contrasts(const Frame *frame, const float light[CHANNELS][AROUND][AROUND],
                              float contrasts[CELLS * CELLS]) {
    CellValues lows = {0}, highs = {0}, levels;
    find_cell_extremes(light, MAX_NEAR, lows, highs, NULL);
    find_level_changes(frame, lows, highs, levels);
    for (int i = 0; i < CELL_VALUES; i++) {
        float *contrast = contrasts + i % (CELLS * CELLS);
        *contrast = fmaxf(*contrast, levels[i]);
    }
}

/* Path of what a tile shows during the exposure, by column and row, and by how much parts of it and
 * around it move apart, px: a speed that changes evenly from tile to tile is none of that. */
static float find_path(const FrameState *state, int32_t number, float path[2]) {
    const TileMotion *motions = state->plan->motions + number;
    float apart = 0.0f, exposure = state->frame->exposure;
    for (int axis = 0; axis < 2; axis++) {
        float middles[9];
        for (int i = 0; i < 9; i++) {
            const TileMotion *other =
                motions + (i / 3 - 1) * state->rays->tile_columns + i % 3 - 1;
            middles[i] = 0.5f * (other->least[axis] + other->most[axis]);
            apart = fmaxf(apart, other->most[axis] - other->least[axis]);
        }
        for (int i = 0; i < 4; i++)
            apart = fmaxf(apart, fabsf(middles[i] + middles[8 - i] - 2.0f * middles[4]));
        path[axis] = exposure * middles[4];
    }
    return exposure * apart;
}

/* Draw those cells of a mask that the sharp frame's samples tell, if all of a tile and around it
 * moves as one; returns these. */
static int gather_cells(const FrameState *state, int tile, int cells,
                        const float light[CHANNELS][AROUND][AROUND]) {
    BlurPlan *plan = state->plan;
    int32_t number = state->rays->tiles[tile];
    const float *sharp = plan->means + (size_t)tile * CHANNELS * BLOCK_RAYS;
    float *blurred = plan->blurred + (size_t)tile * CHANNELS * BLOCK_RAYS;
    float path[2], apart = find_path(state, number, path), contrasts[CELLS * CELLS] = {0};
    float means[CHANNELS][BLOCK_RAYS], doubts[CHANNELS][BLOCK_RAYS], befores[CHANNELS][BLOCK_RAYS];
    float tolerance = fmaxf(MAX_DOUBT, 0.5f * state->frame->blur_threshold);
    if (!(fmaxf(fabsf(path[0]), fabsf(path[1])) <= MAX_PATH_PX))
        return 0;
    measure_contrasts(&plan->counted, light, contrasts);
    for (int cell = 0; cell < CELLS * CELLS; cell++)
        if (!(apart * contrasts[cell] <= MAX_APART))
            cells &= ~(1 << cell);
    if (!cells)
        return 0;
    int rows = (cells & 3 ? 3 : 0) | (cells & 12 ? 12 : 0);
    gather_tile(state, number, &plan->samples, plan->means, path, rows, means, doubts);
    Ints16 is_sure = mask16(0xffff);
    for (int channel = 0; channel < CHANNELS; channel++) {
        float changes[BLOCK_RAYS];
        store16(load16(means[channel]) + load16(doubts[channel]), doubts[channel]);
        find_level_changes(&plan->counted, means[channel], doubts[channel], changes);
        /* What is not a number is not sure, either. */
        is_sure &= load16(changes) <= tolerance;
        is_sure &= load16(doubts[channel]) == load16(doubts[channel]);
    }
    uint32_t doubtful = bits16(~is_sure), gathered = 0;
    for (int cell = 0; cell < CELLS * CELLS; cell++) {
        uint32_t pixels = 0x33u << first_pixel(cell);
        cells &= ~(((doubtful & pixels) != 0) << cell);
        gathered |= cells >> cell & 1 ? pixels : 0;
    }
    if (!cells)
        return 0;
    plan->gathered[number] = (uint8_t)cells;
    for (int channel = 0; channel < CHANNELS; channel++) {
        float *to = blurred + channel * BLOCK_RAYS;
        store16(load16(sharp + channel * BLOCK_RAYS), befores[channel]);
        store16(select16(mask16(gathered), load16(means[channel]), load16(befores[channel])), to);
    }
    note_samples(state, &state->measures->gathered, gathered, means, befores);
    write_radiance(state, tile, (const float(*)[BLOCK_RAYS])blurred);
    return cells;
}

/* Memory is slow to deliver samples: of the tiles below the next ones, which no tile before read. */
static void fetch_samples(const FrameState *state, int tile) {
    enum { TILES_AHEAD = 2, LINE = 16 };
    const BlurPlan *plan = state->plan;
    int columns = state->rays->tile_columns;
    if (!plan->samples.radiance || tile + TILES_AHEAD >= state->rays->num_tiles)
        return;
    int32_t number = state->rays->tiles[tile + TILES_AHEAD] + columns + 1;
    int32_t below = number < state->view->tile_rows * columns ? state->view->tile_at[number] : -1;
    for (int i = 0; below >= 0 && i < CHANNELS; i++) {
        size_t first = (size_t)below * CHANNELS + (size_t)i;
        __builtin_prefetch(plan->means + first * BLOCK_RAYS);
        for (int line = 0; line < 4; line++)
            __builtin_prefetch(plan->samples.radiance + (4 * first + (size_t)line) * LINE);
    }
}

void choose_cells(const FrameState *state, int tile) {
    uint8_t *mask = state->plan->masks + state->rays->tiles[tile];
    int reach = *mask / NEAR;
    _Alignas(32) float light[CHANNELS][AROUND][AROUND];
    float bounds[CELLS * CELLS] = {0};
    int32_t tiles[TILES_AROUND];
    *mask %= NEAR;
    fetch_samples(state, tile);
    /* A single sample misses what is thinner than a pixel: all that is farther counts, too. */
    if (!*mask || !reach || state->rays->samples < 2 ||
        !find_around(state, state->rays->tiles[tile], tiles))
        return;
    int known = *mask & find_known_cells(state, tiles);
    if (!known)
        return;
    collect_pixels(state, tiles, light);
    bound_near_changes(state->frame, light, reach, bounds);
    for (int cell = 0; cell < CELLS * CELLS; cell++)
        if (known >> cell & 1 && !is_visible(state, bounds[cell], INFINITY))
            *mask &= (uint8_t)~(1 << cell);
    known &= *mask;
    /* Rays measure what shadows take where the sharp frame shows none. */
    if (known && state->plan->is_gathered && !state->measures->blurs_unseen_shadows)
        *mask &=
            (uint8_t)~gather_cells(state, tile, known, (const float(*)[AROUND][AROUND])light);
}

/* Instants that show what was in a tile around, half a displacement away. */
enum { MAX_AROUND_INSTANTS = 4 };

LightProof find_known_lights(const FrameState *state, int tile) {
    int32_t number = state->rays->tiles[tile], tiles[TILES_AROUND];
    LightProof met = {0, 0};
    if (!state->frame->has_shadows || state->measures->blurs_unseen_shadows ||
        state->plan->instants[number] > MAX_AROUND_INSTANTS || !find_around(state, number, tiles))
        return met;
    for (int i = 0; i < TILES_AROUND; i++) {
        int32_t other = tiles[i] < 0 ? number : state->rays->tiles[tiles[i]];
        /* Shadows of what moves are elsewhere at other instants. */
        if (state->plan->motions[other].most[0] == INFINITY)
            return (LightProof){0, 0};
        met.seen |= state->plan->lights[other].seen;
        met.hidden |= state->plan->lights[other].hidden;
    }
    return (LightProof){met.seen & ~met.hidden, met.hidden & ~met.seen};
}

void want_tiles(const FrameState *state) {
    BlurPlan *plan = state->plan;
    plan->are_lights_known = 1;
    int columns = state->rays->tile_columns;
    for (int tile = 0; tile < state->rays->num_tiles; tile++) {
        int number = state->rays->tiles[tile], count = plan->instants[number];
        if (!plan->masks[number])
            continue;
        plan->num_tiles++;
        plan->max_instants = count > plan->max_instants ? count : plan->max_instants;
        for (int level = 0; level < BEAM_LEVELS; level++)
            plan->wanted[level][(number / columns >> level) * state->view->levels[level].columns +
                                (number % columns >> level)] = 1;
    }
}

int reopen_gathered(const FrameState *state) {
    BlurPlan *plan = state->plan;
    struct Measures *measures = state->measures;
    if (!is_counted(&measures->blur, &state->frame->limits) ||
        !is_counted(&measures->gathered, &state->frame->limits)) {
        add_measure(&measures->blur, &measures->gathered);
        return 0;
    }
    memcpy(plan->masks, plan->gathered, count_tiles(state->view));
    int closed = plan->num_tiles;
    want_tiles(state);
    return plan->num_tiles > closed;
}

int choose_instants(const FrameState *state) {
    BlurPlan *plan = state->plan;
    const Frame *frame = state->frame;
    int rows = plan->cell_rows, columns = plan->cell_columns;
    size_t plane = (size_t)rows * (size_t)columns;
    fill_rim(state);
    float *displacements = frame->exposure > 0.0f ? spread_speeds(state, frame->exposure) : NULL;
    float *rolled = frame->readout > 0.0f ? spread_speeds(state, 0.5f * frame->readout) : NULL;
    uint8_t *scratch = malloc(plane);
    int is_whole = scratch && (displacements || !(frame->exposure > 0.0f)) &&
                   (rolled || !(frame->readout > 0.0f));
    int blur_levels = count_levels(state, displacements, 0.5f);
    int row_levels = count_levels(state, rolled, 1.0f);
    for (int level = 0; is_whole && (level < blur_levels || level < row_levels); level++) {
        /* From a reach of r cells to one of 2 r. */
        int step = level < 2 ? 1 : 1 << (level - 1);
        for (int channel = 0; channel < 2 * CHANNELS; channel++)
            dilate(plan->cells + plane * (size_t)channel, scratch, rows, columns, step,
                   channel < CHANNELS ? lesser : greater);
        choose_level(state, plan->cells, level, displacements, rolled);
    }
    free(displacements);
    free(rolled);
    free(scratch);
    return is_whole;
}
