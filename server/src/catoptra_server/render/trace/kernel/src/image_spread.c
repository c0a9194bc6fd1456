/* Provides the other stages of image_spread.h: warp, lateral colour, overflow, mosaic and ghost,
 * which read a few other pixels.
 * Float64 twins: effects/kernels/warp.py, and `apply` of the effects. Owns nothing: planes are the
 * job's, maps Python's.
 * Threads: any thread of the pool, each for cells of its own. */
#include "image_spread.h"

#include "image_change.h"

#include <math.h>

static Floats16 mix(Floats16 one, Floats16 other, Floats16 weight) {
    return one + weight * (other - one);
}

/* Sixteen values of a row from any column on, at most one vector beyond the image: its edge
 * repeats. */
static Floats16 load_beside(const Planes *planes, const float *row, int column) {
    int first = column < -CELL_COLUMNS ? -CELL_COLUMNS : column;
    return load16(row + (first < planes->width ? first : planes->width));
}

/* Offsets of 16 pixels in whole and parts of pixels. */
typedef struct {
    Ints16 whole_x, whole_y;
    Floats16 part_x, part_y;
} Offsets;

static Offsets split_offsets(Floats16 x, Floats16 y) {
    Floats16 whole_x = floor16(x), whole_y = floor16(y);
    return (Offsets){__builtin_convertvector(whole_x, Ints16),
                     __builtin_convertvector(whole_y, Ints16), x - whole_x, y - whole_y};
}

/* Pixels read at offsets, bilinear. Neighbours mostly have one whole offset: a round each. */
static Floats16 read_at_offsets(const Planes *planes, int channel, int y, int left,
                                const Offsets *offsets) {
    Floats16 read = {0};
    for (uint32_t rest = 0xffffu; rest;) {
        int lane = __builtin_ctz(rest), dx = offsets->whole_x[lane], dy = offsets->whole_y[lane];
        Ints16 same = (offsets->whole_x == dx) & (offsets->whole_y == dy);
        const float *above = clamped_row(planes, channel, y + dy);
        const float *below = clamped_row(planes, channel, y + dy + 1);
        FETCH_AHEAD(below + left, 0);
        Floats16 upper = mix(load_beside(planes, above, left + dx),
                             load_beside(planes, above, left + dx + 1), offsets->part_x);
        Floats16 lower = mix(load_beside(planes, below, left + dx),
                             load_beside(planes, below, left + dx + 1), offsets->part_x);
        read = select16(same, mix(upper, lower, offsets->part_y), read);
        rest &= ~bits16(same);
    }
    return read;
}

static float largest_offset(Floats16 x, Floats16 y) {
    return most_of16(most16(absolute16(x), absolute16(y)));
}

/* Light that a bilinear shift by up to (d, d) takes from other pixels. */
static float exchange_of_shift(float d) { return d < 1.0f ? 1.0f - (1.0f - d) * (1.0f - d) : 1.0f; }

static int is_shift_plain(const Pass *pass, const Cell *cell, float reach, float *bound) {
    CellRange range = find_range_around(pass, cell, (int)reach + 1);
    return is_plain(pass, cell, range, exchange_of_shift(reach), bound);
}

void warp(const Pass *pass, const Cell *cell, CellValues *to) {
    const void *const *maps = pass->stage->maps;
    Floats16 kept[CELL_ROWS], x[CELL_ROWS], y[CELL_ROWS];
    float reach = 0.0f, bound = INFINITY;
    Ints16 is_darker = {0};
    for (int row = 0; row < cell->rows; row++) {
        size_t first = place_in_map(pass, cell, row);
        x[row] = load_map(maps[0], first, cell->columns);
        y[row] = load_map(maps[1], first, cell->columns);
        kept[row] = load_map(maps[2], first, cell->columns);
        reach = fmaxf(reach, largest_offset(x[row], y[row]));
        is_darker |= kept[row] != 1.0f;
    }
    CellRange own = pass->ranges[cell->row * pass->cell_columns + cell->column];
    int is_black = own.low == 0.0f && own.high == 0.0f;
    if ((is_black || !bits16(is_darker)) && is_shift_plain(pass, cell, reach, &bound)) {
        load_cell(pass, cell, to);
        return;
    }
    for (int row = 0; row < cell->rows; row++) {
        Offsets offsets = split_offsets(x[row], y[row]);
        for (int channel = 0; channel < 3; channel++) {
            Floats16 light =
                read_at_offsets(&pass->from, channel, cell->top + row, cell->left, &offsets);
            light = select16(kept[row] != 0.0f, light, splat16(0.0f));
            store16(kept[row] * light, to->values[channel][row]);
        }
    }
    measure_cell(pass, cell, bound, to);
}

/* Red and blue are read at offsets of columns and rows; green stays. */
void magnify(const Pass *pass, const Cell *cell, CellValues *to) {
    size_t width = (size_t)pass->job->width, height = (size_t)pass->job->height;
    const float *rows = pass->stage->maps[1];
    Floats16 columns[2];
    float reach = 0.0f, bound = INFINITY;
    load_cell(pass, cell, to);
    for (size_t i = 0; i < 2; i++) {
        columns[i] = load_map(pass->stage->maps[0], i * width + (size_t)cell->left, cell->columns);
        reach = fmaxf(reach, most_of16(absolute16(columns[i])));
        for (int row = cell->top; row < cell->top + cell->rows; row++)
            reach = fmaxf(reach, fabsf(rows[i * height + (size_t)row]));
    }
    if (is_shift_plain(pass, cell, reach, &bound))
        return;
    for (int row = 0; row < cell->rows; row++)
        for (size_t i = 0; i < 2; i++) {
            float dy = rows[i * height + (size_t)(cell->top + row)];
            Offsets offsets = split_offsets(columns[i], splat16(dy));
            store16(read_at_offsets(&pass->from, 2 * (int)i, cell->top + row, cell->left, &offsets),
                    to->values[2 * i][row]);
        }
    measure_cell(pass, cell, bound, to);
}

/* What pixels of a cell receive of a row of charge above the well: its own row none. */
static void spread_charge(const Pass *pass, const Cell *cell, int y, Floats16 charge,
                          Floats16 received[CELL_ROWS]) {
    int reach = pass->stage->size;
    if (!bits16(charge != 0.0f))
        return;
    Floats16 least = pass->stage->numbers[0] / ((float)reach * (float)(reach + 1)) * charge;
    for (int row = 0; row < cell->rows; row++) {
        int k = cell->top + row < y ? y - cell->top - row : cell->top + row - y;
        if (k > 0 && k <= reach)
            received[row] += (float)(reach + 1 - k) * least;
    }
}

/* What an earlier stage changes by the overflow of its light: in the pixels that receive some, over
 * the light that they have with the stage or without, the darker of both. */
static void measure_spill(const Pass *pass, const Cell *cell, int first, int last, Changes *changes,
                          const CellValues *light, const Floats16 overflow[3][CELL_ROWS]) {
    const ChangeMaps *maps = &changes->own.maps;
    Floats16 received[CELL_ROWS] = {{0}}, largest = {0};
    float known = read_largest(&changes->spilt);
    int pixels = 0;
    for (int other = first; other <= last; other++) {
        int index = other * maps->cell_columns + cell->column;
        const float *excess = maps->excess + index * CELL_ROWS * CELL_COLUMNS;
        for (int row = 0; maps->overflows[index] && row < CELL_ROWS; row++)
            spread_charge(pass, cell, other * CELL_ROWS + row,
                          load16(excess + row * CELL_COLUMNS), received);
    }
    for (int row = 0; row < cell->rows; row++) {
        /* With their own changes any of them may be visible. */
        Ints16 changed = columns_below(cell->columns) & (received[row] > 0.0f);
        for (int channel = 0; channel < 3 && bits16(changed); channel++) {
            Floats16 rest = overflow[channel][row] - received[row];
            Floats16 least = load16(light->values[channel][row]) + most16(rest, splat16(0.0f));
            Floats16 most = least + received[row];
            if (!bits16(changed & ~(bound_changes(pass->stage, least, most) <= known)))
                continue;
            Floats16 levels = level_changes(pass->stage, least, most);
            largest = most16(select16(changed, levels, splat16(0.0f)), largest);
        }
        pixels += __builtin_popcount(bits16(changed));
        mark_visible(&changes->own, cell, row, bits16(changed));
    }
    raise_largest(&changes->spilt, most_of16(largest));
    count_visible(&changes->own, pixels);
}

static void measure_spills(const Pass *pass, const Cell *cell, int first, int last,
                           const CellValues *light, const Floats16 overflow[3][CELL_ROWS]) {
    if (!pass->changes)
        return;
    float low = pass->ranges[cell->row * pass->cell_columns + cell->column].low;
    /* What the darkest pixel can change by before it is white, whatever it receives. */
    float most = 255.0f - grey_levels((Floats16){pass->stage->least_gain * low})[0];
    for (Changes *one = pass->changes; one < changes_of(pass, pass->stage); one++)
        if (one->own.maps.excess &&
            (most + 1e-2f > read_largest(&one->spilt) ||
             is_counted(&one->own, &pass->job->stages[one - pass->changes].limits)))
            measure_spill(pass, cell, first, last, one, light, overflow);
}

/* Charge above the full well flows into the pixels above and below. */
void bloom(const Pass *pass, const Cell *cell, CellValues *to) {
    int reach = pass->stage->size, height = pass->job->height, overflows = 0;
    Floats16 overflow[3][CELL_ROWS] = {{{0}}};
    load_cell(pass, cell, to);
    int first = clamp(cell->top - reach, height - 1) / CELL_ROWS;
    int last = clamp(cell->top + cell->rows - 1 + reach, height - 1) / CELL_ROWS;
    for (int y = first * CELL_ROWS; y < (last + 1) * CELL_ROWS && y < height; y++) {
        int is_full = pass->ranges[y / CELL_ROWS * pass->cell_columns + cell->column].high > 1.0f;
        overflows |= is_full;
        for (int channel = 0; channel < 3 && is_full; channel++) {
            Floats16 light = load16(row_at(&pass->from, channel, y) + cell->left);
            spread_charge(pass, cell, y, select16(light > 1.0f, light - 1.0f, splat16(0.0f)),
                          overflow[channel]);
        }
    }
    measure_spills(pass, cell, first, last, to, overflow);
    if (!overflows)
        return;
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++)
            store16(load16(to->values[channel][row]) + overflow[channel][row],
                    to->values[channel][row]);
    measure_cell(pass, cell, INFINITY, to);
}

static const float *mirrored_row(const Planes *mosaic, int row) {
    int last = mosaic->height - 1;
    row = row < 0 ? -row : row > last ? 2 * last - row : row;
    return row_at(mosaic, 0, clamp(row, last));
}

/* Bilinear: the mean of the nearest pixels of a colour. */
void demosaic(const Pass *pass, const Cell *cell, CellValues *to) {
    for (int row = 0; row < cell->rows; row++) {
        int y = cell->top + row;
        const float *above = mirrored_row(&pass->mosaic, y - 1) + cell->left;
        const float *at = row_at(&pass->mosaic, 0, y) + cell->left;
        const float *below = mirrored_row(&pass->mosaic, y + 1) + cell->left;
        FETCH_AHEAD(below, 0);
        Floats16 own = load16(at), horizontal = 0.5f * (load16(at - 1) + load16(at + 1));
        Floats16 vertical = 0.5f * (load16(above) + load16(below));
        Floats16 diagonal =
            0.25f * (((load16(above - 1) + load16(above + 1)) + load16(below - 1)) +
                     load16(below + 1));
        Floats16 cross = 0.5f * (horizontal + vertical);
        /* Red and green in even rows, green and blue in odd ones. */
        Floats16 red = alternate16(own, horizontal), blue = alternate16(diagonal, vertical);
        if (row & 1) {
            blue = alternate16(horizontal, own);
            red = alternate16(vertical, diagonal);
        }
        store16(red, to->values[0][row]);
        store16(row & 1 ? alternate16(own, cross) : alternate16(cross, own), to->values[1][row]);
        store16(blue, to->values[2][row]);
    }
}

/* Light of the opposite pixel, reflected at the wall of a tube. */
void add_ghost(const Pass *pass, const Cell *cell, CellValues *to) {
    const ImageStage *stage = pass->stage;
    int column_sum = (int)stage->numbers[0], row_sum = (int)stage->numbers[1];
    load_cell(pass, cell, to);
    for (int row = 0; row < cell->rows; row++) {
        size_t first = place_in_map(pass, cell, row);
        Floats16 kept = load_map(stage->maps[0], first, cell->columns);
        Floats16 ghost = load_map(stage->maps[1], first, cell->columns);
        for (int channel = 0; channel < 3; channel++) {
            const float *line = clamped_row(&pass->from, channel, row_sum - cell->top - row);
            Floats16 opposite =
                load_beside(&pass->from, line, column_sum - cell->left - (CELL_COLUMNS - 1));
            opposite = __builtin_shufflevector(opposite, opposite, 15, 14, 13, 12, 11, 10, 9, 8, 7,
                                               6, 5, 4, 3, 2, 1, 0);
            store16(load16(to->values[channel][row]) * kept + opposite * ghost,
                    to->values[channel][row]);
        }
    }
    measure_cell(pass, cell, INFINITY, to);
}
