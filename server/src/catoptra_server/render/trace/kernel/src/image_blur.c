/* Provides blur of image_spread.h, by symmetric kernels: one for each colour, or one for each
 * pixel from a table of discs.
 * Float64 twin: effects/kernels/convolution.py. Owns nothing: planes are the job's scratch memory.
 * Threads: any thread of the pool, each for cells of its own.
 *
 * A kernel has one weight for each pair (i, j), 0 <= j <= i, of offsets: the (up to eight) pixels
 * that are i and j away along the axes share it. maps[0] has the weights: (3, pairs) where num_rows
 * is 0, else (num_rows, pairs), of which each pixel takes the linear mixture of two rows.
 * maps[1] is the row of each pixel, (h, w); or, with ranges in maps[3], the circle of confusion
 * (h, w, 4) from which the row follows (circle_of_confusion). maps[2] is the mask, (h, w) uint8, of
 * pixels that take part: weights of others go to the central pixel; NULL: all take part.
 */
#include "image_spread.h"

#include "image_change.h"

#include <math.h>

#define ROWS_PER_PX2 64.0f
#define MIN_DENOMINATOR 1e-6f

typedef struct {
    _Alignas(64) float row[CELL_ROWS][CELL_COLUMNS];     /* of the table, by pixel */
    _Alignas(64) float far_row[CELL_ROWS][CELL_COLUMNS]; /* of the disc of infinity */
    int reach, far_reach; /* half widths of the widest kernels of the cell */
    float exchange;       /* most light that a pixel takes from others by any of them */
} CellKernels;

static int pair_count(int half_width) { return (half_width + 1) * (half_width + 2) / 2; }

static float row_of_diameter(float diameter) { return ROWS_PER_PX2 / 16.0f * diameter * diameter; }

/* Rows of the table for the pixels of a cell. */
static void find_rows(const Pass *pass, const Cell *cell, CellKernels *kernels) {
    const ImageStage *stage = pass->stage;
    const float *ranges = stage->maps[3];
    for (int row = 0; row < CELL_ROWS; row++)
        for (int x = 0; x < CELL_COLUMNS; x++) {
            /* Rows and columns beyond the image repeat the last ones. */
            int y = row < cell->rows ? row : cell->rows - 1;
            int column = x < cell->columns ? x : cell->columns - 1;
            size_t at = (size_t)(cell->top + y) * (size_t)pass->job->width +
                        (size_t)(cell->left + column);
            if (!ranges) {
                kernels->row[row][x] = ((const float *)stage->maps[1])[at];
                continue;
            }
            const float *circle = (const float *)stage->maps[1] + 4 * at;
            float denominator = circle[2] * ranges[at] + circle[3];
            denominator = denominator > MIN_DENOMINATOR ? denominator : MIN_DENOMINATOR;
            kernels->row[row][x] = row_of_diameter(circle[0] + circle[1] / denominator);
            kernels->far_row[row][x] = row_of_diameter(circle[0]);
        }
}

static float largest_row(float rows[CELL_ROWS][CELL_COLUMNS]) {
    float largest = 0.0f;
    for (int row = 0; row < CELL_ROWS; row++)
        for (int x = 0; x < CELL_COLUMNS; x++)
            largest = rows[row][x] > largest ? rows[row][x] : largest;
    return largest;
}

/* Half width of the kernels up to a row, and light from others; wider discs have all that narrower
 * ones have. */
static int find_reach(const ImageStage *stage, float row, CellKernels *kernels) {
    const float *table = stage->maps[0];
    int pairs = pair_count(stage->size), last = (int)ceilf(row);
    last = last < stage->num_rows ? last : stage->num_rows - 1;
    int reach = stage->size;
    while (reach > 0) {
        const float *outermost = table + (size_t)last * (size_t)pairs + pair_count(reach - 1);
        int is_used = 0;
        for (int j = 0; j <= reach; j++)
            is_used |= outermost[j] > 0.0f;
        if (is_used)
            break;
        reach--;
    }
    kernels->exchange = fmaxf(kernels->exchange, 1.0f - table[(size_t)last * (size_t)pairs]);
    return reach;
}

static void find_colour_reach(const ImageStage *stage, CellKernels *kernels) {
    int pairs = pair_count(stage->size);
    const float *weights = stage->maps[0];
    kernels->reach = stage->size;
    for (int channel = 0; channel < 3; channel++) {
        float others = 1.0f - weights[(size_t)channel * (size_t)pairs];
        kernels->exchange = others > kernels->exchange ? others : kernels->exchange;
    }
}

/* Weights of one pair for a row of pixels. */
static void mix_weights(const ImageStage *stage, const float *rows, int pairs, int pair,
                        float weights[CELL_COLUMNS]) {
    const float *table = (const float *)stage->maps[0] + pair;
    for (int x = 0; x < CELL_COLUMNS; x++) {
        float row = rows[x] < (float)(stage->num_rows - 1) ? rows[x] : (float)(stage->num_rows - 1);
        int below = (int)row < stage->num_rows - 2 ? (int)row : stage->num_rows - 2;
        float lower = table[(size_t)below * (size_t)pairs];
        float upper = table[(size_t)(below + 1) * (size_t)pairs];
        weights[x] = lower + (row - (float)below) * (upper - lower);
    }
}

static void add_shifts(const float *row, size_t stride, int i, int j, float sums[CELL_COLUMNS]) {
    const float *above = row - (size_t)j * stride, *below = row + (size_t)j * stride;
    if (j == 0)
        for (int x = 0; x < CELL_COLUMNS; x++)
            sums[x] += row[x - i] + row[x + i];
    else
        for (int x = 0; x < CELL_COLUMNS; x++)
            sums[x] += (above[x - i] + above[x + i]) + (below[x - i] + below[x + i]);
}

static void add_vertical(const float *row, size_t stride, int i, float sums[CELL_COLUMNS]) {
    const float *above = row - (size_t)i * stride, *below = row + (size_t)i * stride;
    for (int x = 0; x < CELL_COLUMNS; x++)
        sums[x] += above[x] + below[x];
}

/* Sums of the pixels that share the weight of a pair. */
static void sum_pair(const float *row, size_t stride, int i, int j, float sums[CELL_COLUMNS]) {
    if (i == 0) {
        memcpy(sums, row, sizeof(float) * CELL_COLUMNS);
        return;
    }
    memset(sums, 0, sizeof(float) * CELL_COLUMNS);
    add_shifts(row, stride, i, j, sums);
    if (j == 0)
        add_vertical(row, stride, i, sums);
    else if (i != j)
        add_shifts(row, stride, j, i, sums);
}

static int is_masked(const Pass *pass, const Cell *cell, int reach) {
    const uint8_t *mask = pass->stage->maps[2];
    int width = pass->job->width, height = pass->job->height;
    if (!mask)
        return 0;
    for (int row = cell->top - reach; row < cell->top + cell->rows + reach; row++)
        for (int x = cell->left - reach; x < cell->left + cell->columns + reach; x++) {
            int y = row < 0 ? 0 : row < height ? row : height - 1;
            int column = x < 0 ? 0 : x < width ? x : width - 1;
            if (!mask[(size_t)y * (size_t)width + (size_t)column])
                return 1;
        }
    return 0;
}

/* A row of a cell of which all pixels take part. */
static void blur_row(const Pass *pass, const Cell *cell, int y, const float *rows, int reach) {
    const ImageStage *stage = pass->stage;
    int pairs = pair_count(stage->size), pair = 0;
    float weights[CELL_COLUMNS], sums[CELL_COLUMNS], totals[3][CELL_COLUMNS];
    memset(totals, 0, sizeof totals);
    for (int i = 0; i <= reach; i++)
        for (int j = 0; j <= i; j++, pair++) {
            if (stage->num_rows)
                mix_weights(stage, rows, pairs, pair, weights);
            for (int channel = 0; channel < 3; channel++) {
                if (!stage->num_rows)
                    for (int x = 0; x < CELL_COLUMNS; x++)
                        weights[x] = ((const float *)stage->maps[0])[channel * pairs + pair];
                sum_pair(row_at(&pass->from, channel, y) + cell->left, pass->from.stride, i, j,
                         sums);
                for (int x = 0; x < CELL_COLUMNS; x++)
                    totals[channel][x] += weights[x] * sums[x];
            }
        }
    for (int channel = 0; channel < 3; channel++)
        memcpy(row_at(&pass->to, channel, y) + cell->left, totals[channel], sizeof totals[channel]);
}

/* The pixels of a pair around one pixel that take part, one after the other. */
typedef struct {
    const Pass *pass;
    int x, y;
    float weight, sums[3], left_over;
} MaskedSum;

static void add_neighbour(MaskedSum *sum, int dx, int dy) {
    const Pass *pass = sum->pass;
    int x = sum->x + dx, y = sum->y + dy, width = pass->job->width, height = pass->job->height;
    int column = x < 0 ? 0 : x < width ? x : width - 1, row = y < 0 ? 0 : y < height ? y : height - 1;
    const uint8_t *mask = pass->stage->maps[2];
    if (!mask[(size_t)row * (size_t)width + (size_t)column]) {
        sum->left_over += sum->weight;
        return;
    }
    for (int channel = 0; channel < 3; channel++)
        sum->sums[channel] += sum->weight * row_at(&pass->from, channel, row)[column];
}

static void add_pair(MaskedSum *sum, int i, int j) {
    for (int swap = 0; swap < (i == j ? 1 : 2); swap++, (void)0) {
        int dx = swap ? j : i, dy = swap ? i : j;
        for (int sx = -1; sx <= (dx ? 1 : -1); sx += 2)
            for (int sy = -1; sy <= (dy ? 1 : -1); sy += 2)
                add_neighbour(sum, sx * dx, sy * dy);
    }
}

static void blur_masked_pixel(const Pass *pass, int x, int y, float row, int reach) {
    const ImageStage *stage = pass->stage;
    const uint8_t *mask = stage->maps[2];
    MaskedSum sum = {.pass = pass, .x = x, .y = y};
    int pairs = pair_count(stage->size), pair = 0;
    if (mask[(size_t)y * (size_t)pass->job->width + (size_t)x])
        for (int i = 0; i <= reach; i++)
            for (int j = 0; j <= i; j++, pair++) {
                float rows[CELL_COLUMNS] = {row}, weights[CELL_COLUMNS];
                mix_weights(stage, rows, pairs, pair, weights);
                sum.weight = weights[0];
                add_pair(&sum, i, j);
            }
    else
        sum.left_over = 1.0f;
    for (int channel = 0; channel < 3; channel++) {
        float own = row_at(&pass->from, channel, y)[x];
        row_at(&pass->to, channel, y)[x] = sum.sums[channel] + sum.left_over * own;
    }
}

static void blur_cell(const Pass *pass, const Cell *cell, float rows[CELL_ROWS][CELL_COLUMNS],
                      int reach, int masked) {
    for (int row = 0; row < cell->rows; row++) {
        if (!masked) {
            blur_row(pass, cell, cell->top + row, rows[row], reach);
            continue;
        }
        for (int x = 0; x < cell->columns; x++)
            blur_masked_pixel(pass, cell->left + x, cell->top + row, rows[row][x], reach);
    }
}

/* With ranges the change that counts is that against the disc of infinity, which another effect
 * stands for: `change`. The change against the image before is `other_change`. */
static void measure_against_infinity(Pass *pass, const Cell *cell, CellKernels *kernels,
                                     CellRange range, int masked) {
    float near_values[3][CELL_ROWS][CELL_COLUMNS];
    CellKernels far_kernels = *kernels;
    float high = largest_row(kernels->far_row);
    find_reach(pass->stage, high, &far_kernels);
    float exchange = kernels->exchange > far_kernels.exchange ? kernels->exchange
                                                              : far_kernels.exchange;
    LightChange light = {range.low, range.high, exchange * (range.high - range.low)};
    float bound = bound_change(pass->stage, light);
    if (bound <= read_largest(&pass->change) &&
        !(bound > VISIBLE_LEVELS && is_counted(&pass->change, &pass->stage->limits)))
        return;
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++)
            memcpy(near_values[channel][row],
                   row_at(&pass->to, channel, cell->top + row) + cell->left,
                   sizeof near_values[channel][row]);
    blur_cell(pass, cell, kernels->far_row, kernels->far_reach, masked);
    Versions versions[3];
    for (int channel = 0; channel < 3; channel++)
        versions[channel] = (Versions){row_at(&pass->to, channel, cell->top) + cell->left,
                                       near_values[channel][0], pass->to.stride, CELL_COLUMNS};
    measure_versions(pass->stage, &pass->change, versions, cell);
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++)
            memcpy(row_at(&pass->to, channel, cell->top + row) + cell->left,
                   near_values[channel][row], sizeof near_values[channel][row]);
}

static void measure_blur(Pass *pass, const Cell *cell, CellKernels *kernels, CellRange range,
                         int masked) {
    int is_by_range = pass->stage->maps[3] != NULL;
    measure_cell(pass, cell, is_by_range ? &pass->other_change : &pass->change);
    if (is_by_range && pass->stage->limits.max_change >= 0.0f)
        measure_against_infinity(pass, cell, kernels, range, masked);
}

void blur(Pass *pass, const Cell *cell) {
    CellKernels kernels;
    kernels.far_reach = 0;
    kernels.exchange = 0.0f;
    if (pass->stage->num_rows) {
        find_rows(pass, cell, &kernels);
        kernels.reach = find_reach(pass->stage, largest_row(kernels.row), &kernels);
        if (pass->stage->maps[3])
            kernels.far_reach = find_reach(pass->stage, largest_row(kernels.far_row), &kernels);
    } else {
        find_colour_reach(pass->stage, &kernels);
    }
    int reach = kernels.reach > kernels.far_reach ? kernels.reach : kernels.far_reach;
    CellRange range = find_range_around(pass, cell, reach);
    if (is_plain(pass, cell, range, kernels.exchange)) {
        copy_cell(pass, cell);
        return;
    }
    int masked = is_masked(pass, cell, reach);
    blur_cell(pass, cell, kernels.row, kernels.reach, masked);
    measure_blur(pass, cell, &kernels, range, masked);
}
