/* Provides blur_gather.h: kernels of a path, and the samples around a tile.
 * Float64 twin: reference/reference_engine.py, the mean of sharp frames. Owns nothing: samples are
 * the plan's.
 * Threads: any thread of the pool. */
#include "blur_gather.h"

#include <math.h>
#include <string.h>

/* Samples around a tile along a side, from two pixels before it on; the pixels' own places are
 * between two samples. Steps from a pixel's place whose light counts: a cubic needs one more. */
enum { SAMPLES = 16, PLACES = SAMPLES - 1, REACH = 4, TAPS = 2 * REACH + 1, COLOURS = 4 };

/* Mean of the 2 x 2 samples about each place, by row, odd column, column and channel: a kernel's
 * column for four pixels is one vector. */
typedef float Places[PLACES][GATHERED_SIDE][SAMPLES / 2][COLOURS];

/* Weights of the places about a pixel's: of cubics, and what straight lines would add to them. */
typedef float Kernel[2][TAPS][TAPS];

static Floats4 load_samples(const TileSamples *samples, const float *means, int is_sampled,
                            int tile, int block, int channel, int row) {
    if (is_sampled)
        return load4(samples->radiance +
                     (((size_t)tile * 4 + (size_t)block) * 3 + (size_t)channel) * BLOCK_RAYS +
                     4 * row);
    const float *two = means + ((size_t)tile * 3 + (size_t)channel) * BLOCK_RAYS +
                       (block / 2 * 2 + row / 2) * TILE_PX + block % 2 * 2;
    return (Floats4){two[0], two[0], two[1], two[1]};
}

/* Samples around a tile, from 4 x 4 blocks of which it has the inner ones. */
static void collect_samples(const FrameState *state, int32_t number, const TileSamples *samples,
                            const float *means, Floats4 light[SAMPLES][SAMPLES]) {
    for (int i = 0; i < 16; i++) {
        int down = i / 4 + 1, right = i % 4 + 1;
        int tile = state->view->tile_at[number + (down / 2 - 1) * state->rays->tile_columns +
                                        right / 2 - 1];
        tile = tile < 0 ? state->view->tile_at[number] : tile;
        int block = down % 2 * 2 + right % 2, is_sampled = samples->is_sampled[tile];
        for (int row = 0; row < 4; row++) {
            Floats4 red = load_samples(samples, means, is_sampled, tile, block, 0, row);
            Floats4 green = load_samples(samples, means, is_sampled, tile, block, 1, row);
            Floats4 blue = load_samples(samples, means, is_sampled, tile, block, 2, row);
            Floats4 left = __builtin_shufflevector(red, green, 0, 4, 1, 5);
            Floats4 rest = __builtin_shufflevector(red, green, 2, 6, 3, 7);
            Floats4 *to = &light[4 * (down - 1) + row][4 * (right - 1)];
            to[0] = __builtin_shufflevector(left, blue, 0, 1, 4, 4);
            to[1] = __builtin_shufflevector(left, blue, 2, 3, 5, 5);
            to[2] = __builtin_shufflevector(rest, blue, 0, 1, 6, 6);
            to[3] = __builtin_shufflevector(rest, blue, 2, 3, 7, 7);
        }
    }
}

static void find_places(Floats4 light[SAMPLES][SAMPLES], int down, Places places) {
    for (int y = REACH - down; y < PLACES - REACH + down; y++) {
        Floats4 before = light[y][0] + light[y + 1][0];
        for (int x = 0; x < PLACES; x++) {
            Floats4 after = light[y][x + 1] + light[y + 1][x + 1];
            store4(0.25f * (before + after), places[y][x % 2][x / 2]);
            before = after;
        }
    }
}

/* Weights of the four places about one, as of cubics and of straight lines; the first of them. */
static int weigh_places(float at, float cubic[4], float straight[4]) {
    int first = (int)(at + (float)(REACH - 1));
    first = first < TAPS - 4 ? first : TAPS - 4;
    float t = at + (float)(REACH - 1) - (float)first;
    cubic[0] = 0.5f * t * (t * (2.0f - t) - 1.0f);
    cubic[1] = 0.5f * (t * t * (3.0f * t - 5.0f) + 2.0f);
    cubic[2] = 0.5f * t * (t * (4.0f - 3.0f * t) + 1.0f);
    cubic[3] = 0.5f * t * t * (t - 1.0f);
    memcpy(straight, (float[4]){0.0f, 1.0f - t, t, 0.0f}, 4 * sizeof(float));
    return first;
}

static void add_to_row(float *row, Floats4 parts) { store4(load4(row) + parts, row); }

/* Add a part of the light at a place, and at the one opposite. */
static void add_place(const float at[2], float part, Kernel kernel) {
    float columns[2][4], rows[2][4];
    int left = weigh_places(at[0], columns[0], columns[1]);
    int top = weigh_places(at[1], rows[0], rows[1]);
    for (int y = 0; y < 4; y++) {
        Floats4 cubic = part * rows[0][y] * load4(columns[0]);
        Floats4 parts[2] = {cubic, part * rows[1][y] * load4(columns[1]) - cubic};
        for (int i = 0; i < 2; i++) {
            add_to_row(kernel[i][top + y] + left, parts[i]);
            add_to_row(kernel[i][TAPS - 1 - top - y] + TAPS - 4 - left,
                       __builtin_shufflevector(parts[i], parts[i], 3, 2, 1, 0));
        }
    }
}

/* The mean along a path by Simpson's rule, at most 3/4 of a step apart. */
static void find_kernel(const float path[2], Kernel kernel) {
    int half = fmaxf(fabsf(path[0]), fabsf(path[1])) > 1.0f ? 4 : 2;
    memset(kernel, 0, sizeof(Kernel));
    for (int i = 0; i <= half; i++) {
        float phase = 0.5f * (float)(GATHERED_SIDE * i) / (float)half;
        float weight = i == half ? 1.0f : i % 2 ? 4.0f : 2.0f;
        add_place((float[2]){phase * path[0], phase * path[1]},
                  weight * (i ? 1.0f : 0.5f) / (float)(6 * half), kernel);
    }
}

/* Steps from a pixel's place to the last that a path's kernel weighs. */
static int find_reach(float path) {
    int reach = (int)fabsf(path) + 2;
    return reach < REACH ? reach : REACH;
}

void gather_tile(const FrameState *state, int32_t number, const TileSamples *samples,
                 const float *means, const float path[2], int rows, float gathered[3][BLOCK_RAYS],
                 float doubts[3][BLOCK_RAYS]) {
    Floats4 light[SAMPLES][SAMPLES];
    Places places; /* not initialized: all that is read is found */
    Kernel kernel;
    int across = find_reach(path[0]), down = find_reach(path[1]);
    collect_samples(state, number, samples, means, light);
    find_places(light, down, places);
    find_kernel(path, kernel);
    for (int y = 0; y < TILE_PX; y++) {
        Floats16 sum = {0}, more = {0};
        if (!(rows >> y & 1))
            continue;
        for (int i = REACH - down; i <= REACH + down; i++)
            for (int k = REACH - across; k <= REACH + across; k++) {
                Floats16 here = load16(places[GATHERED_SIDE * y + i][k % 2][k / 2]);
                sum += kernel[0][i][k] * here;
                more += kernel[1][i][k] * here;
            }
        for (int lane = 0; lane < TILE_PX * COLOURS; lane++)
            if (lane % COLOURS < 3) {
                gathered[lane % COLOURS][TILE_PX * y + lane / COLOURS] = sum[lane];
                doubts[lane % COLOURS][TILE_PX * y + lane / COLOURS] = more[lane];
            }
    }
}
