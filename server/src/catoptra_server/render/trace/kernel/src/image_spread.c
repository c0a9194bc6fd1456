/* Provides the other stages of image_spread.h: warp, lateral colour, overflow and mosaic, which
 * read a few neighbours.
 * Float64 twins: effects/kernels/warp.py, and `apply` of the effects. Owns nothing: planes are the
 * job's, maps Python's.
 * Threads: any thread of the pool, each for cells of its own. */
#include "image_spread.h"

#include "image_change.h"

#include <math.h>

static int clamp(int value, int last) { return value < 0 ? 0 : value < last ? value : last; }

static float mix(float one, float other, float weight) { return one + weight * (other - one); }

/* A pixel read at an offset, bilinear; beyond the image its border repeats. */
static void warp_pixel(const Pass *pass, int x, int y, const float *offset, float light[3]) {
    float whole_x = floorf(offset[0]), whole_y = floorf(offset[1]);
    int width = pass->job->width, height = pass->job->height;
    int left = clamp(x + (int)whole_x, width - 1), right = clamp(x + (int)whole_x + 1, width - 1);
    int top = clamp(y + (int)whole_y, height - 1);
    int bottom = clamp(y + (int)whole_y + 1, height - 1);
    for (int channel = 0; channel < 3; channel++) {
        const float *above = row_at(&pass->from, channel, top);
        const float *below = row_at(&pass->from, channel, bottom);
        float upper = mix(above[left], above[right], offset[0] - whole_x);
        float lower = mix(below[left], below[right], offset[0] - whole_x);
        light[channel] = mix(upper, lower, offset[1] - whole_y);
    }
}

/* Largest offsets of a cell; 0 if one of its pixels turns darker. */
static int find_offsets(const Pass *pass, const Cell *cell, float *reach) {
    int is_whole = 1;
    *reach = 0.0f;
    for (int row = 0; row < cell->rows; row++)
        for (int x = 0; x < cell->columns; x++) {
            size_t at = (size_t)(cell->top + row) * (size_t)pass->job->width +
                        (size_t)(cell->left + x);
            const float *offset = (const float *)pass->stage->maps[0] + 3 * at;
            *reach = fmaxf(*reach, fmaxf(fabsf(offset[0]), fabsf(offset[1])));
            is_whole &= ((const float *)pass->stage->maps[1])[at] == 1.0f;
        }
    return is_whole;
}

/* Light that a bilinear shift by up to (d, d) takes from other pixels. */
static float exchange_of_shift(float d) { return d < 1.0f ? 1.0f - (1.0f - d) * (1.0f - d) : 1.0f; }

static int is_shift_plain(Pass *pass, const Cell *cell, float reach) {
    CellRange range = find_range_around(pass, cell, (int)reach + 1);
    return is_plain(pass, cell, range, exchange_of_shift(reach));
}

void warp(Pass *pass, const Cell *cell) {
    float reach;
    int is_whole = find_offsets(pass, cell, &reach);
    CellRange own = pass->ranges[cell->row * pass->cell_columns + cell->column];
    int is_black = own.low == 0.0f && own.high == 0.0f;
    if ((is_whole || is_black) && is_shift_plain(pass, cell, reach)) {
        copy_cell(pass, cell);
        return;
    }
    for (int row = 0; row < cell->rows; row++)
        for (int x = 0; x < cell->columns; x++) {
            size_t at = (size_t)(cell->top + row) * (size_t)pass->job->width +
                        (size_t)(cell->left + x);
            const float *offset = (const float *)pass->stage->maps[0] + 3 * at;
            float light[3] = {0.0f, 0.0f, 0.0f}, kept = ((const float *)pass->stage->maps[1])[at];
            if (kept != 0.0f)
                warp_pixel(pass, cell->left + x, cell->top + row, offset, light);
            for (int channel = 0; channel < 3; channel++)
                row_at(&pass->to, channel, cell->top + row)[cell->left + x] = kept * light[channel];
        }
    measure_cell(pass, cell, &pass->change);
}

static float magnify_pixel(const Pass *pass, int channel, int x, int y, float dx, float dy) {
    float whole_x = floorf(dx), whole_y = floorf(dy);
    int width = pass->job->width, height = pass->job->height;
    int left = clamp(x + (int)whole_x, width - 1), right = clamp(x + (int)whole_x + 1, width - 1);
    const float *above = row_at(&pass->from, channel, clamp(y + (int)whole_y, height - 1));
    const float *below = row_at(&pass->from, channel, clamp(y + (int)whole_y + 1, height - 1));
    float upper = mix(above[left], above[right], dx - whole_x);
    return mix(upper, mix(below[left], below[right], dx - whole_x), dy - whole_y);
}

/* Red and blue are read at offsets of columns and rows; green stays. */
void magnify(Pass *pass, const Cell *cell) {
    const float *columns = pass->stage->maps[0], *rows = pass->stage->maps[1];
    float reach = 0.0f;
    for (int i = 0; i < 2; i++) {
        for (int x = 0; x < cell->columns; x++)
            reach = fmaxf(reach, fabsf(columns[2 * (cell->left + x) + i]));
        for (int row = 0; row < cell->rows; row++)
            reach = fmaxf(reach, fabsf(rows[2 * (cell->top + row) + i]));
    }
    copy_cell(pass, cell);
    if (is_shift_plain(pass, cell, reach))
        return;
    for (int row = 0; row < cell->rows; row++)
        for (int i = 0; i < 2; i++) {
            float *result = row_at(&pass->to, 2 * i, cell->top + row);
            for (int x = cell->left; x < cell->left + cell->columns; x++)
                result[x] = magnify_pixel(pass, 2 * i, x, cell->top + row, columns[2 * x + i],
                                          rows[2 * (cell->top + row) + i]);
        }
    measure_cell(pass, cell, &pass->change);
}

/* Charge above the full well flows into the pixels above and below. */
void bloom(Pass *pass, const Cell *cell) {
    const ImageStage *stage = pass->stage;
    int reach = stage->size, height = pass->job->height;
    copy_cell(pass, cell);
    int first = clamp(cell->top - reach, height - 1) / CELL_ROWS;
    int last = clamp(cell->top + cell->rows - 1 + reach, height - 1) / CELL_ROWS;
    float high = 0.0f;
    for (int row = first; row <= last; row++)
        high = fmaxf(high, pass->ranges[row * pass->cell_columns + cell->column].high);
    if (!(high > 1.0f))
        return;
    for (int channel = 0; channel < 3; channel++)
        for (int y = cell->top; y < cell->top + cell->rows; y++) {
            float overflow[CELL_COLUMNS] = {0};
            for (int k = 1; k <= reach; k++) {
                float weight = (float)(reach + 1 - k) / ((float)reach * (float)(reach + 1));
                for (int side = -1; side <= 1; side += 2) {
                    int row = y + side * k;
                    if (row < 0 || row >= height)
                        continue;
                    const float *light = row_at(&pass->from, channel, row) + cell->left;
                    for (int x = 0; x < CELL_COLUMNS; x++) {
                        float excess = light[x] > 1.0f ? light[x] - 1.0f : 0.0f;
                        overflow[x] += weight * (stage->numbers[0] * excess);
                    }
                }
            }
            float *result = row_at(&pass->to, channel, y) + cell->left;
            for (int x = 0; x < CELL_COLUMNS; x++)
                result[x] += overflow[x];
        }
    measure_cell(pass, cell, &pass->change);
}

static int reflect(int value, int last) {
    return last == 0 ? 0 : value < 0 ? -value : value > last ? 2 * last - value : value;
}

/* Radiance that a pixel measures through its filter, at most a full well: RGGB. */
static float measure_raw(const Pass *pass, int x, int y) {
    int column = reflect(x, pass->job->width - 1), row = reflect(y, pass->job->height - 1);
    int channel = (column & 1) == (row & 1) ? (row & 1 ? 2 : 0) : 1;
    float light = row_at(&pass->from, channel, row)[column];
    return light < 1.0f ? light : 1.0f;
}

static void demosaic_pixel(const Pass *pass, int x, int y) {
    float own = measure_raw(pass, x, y);
    float left = measure_raw(pass, x - 1, y), right = measure_raw(pass, x + 1, y);
    float above = measure_raw(pass, x, y - 1), below = measure_raw(pass, x, y + 1);
    float horizontal = 0.5f * (left + right), vertical = 0.5f * (above + below);
    float diagonal = 0.25f * (((measure_raw(pass, x - 1, y - 1) + measure_raw(pass, x + 1, y - 1)) +
                               measure_raw(pass, x - 1, y + 1)) +
                              measure_raw(pass, x + 1, y + 1));
    float cross = 0.5f * (horizontal + vertical);
    float light[3] = {own, cross, diagonal};
    if ((x & 1) && (y & 1))
        light[0] = diagonal, light[2] = own;
    else if (x & 1)
        light[0] = horizontal, light[1] = own, light[2] = vertical;
    else if (y & 1)
        light[0] = vertical, light[1] = own, light[2] = horizontal;
    for (int channel = 0; channel < 3; channel++)
        row_at(&pass->to, channel, y)[x] = light[channel];
}

/* Rows of a cell within the image: the raw values of three rows, then all pixels of one parity. */
static void demosaic_row(const Pass *pass, const Cell *cell, int y) {
    float raw[3][CELL_COLUMNS + 2];
    for (int row = 0; row < 3; row++) {
        int green = 1, other = (y + row - 1) & 1 ? 2 : 0, parity = (y + row - 1) & 1;
        const float *greens = row_at(&pass->from, green, y + row - 1) + cell->left - 1;
        const float *others = row_at(&pass->from, other, y + row - 1) + cell->left - 1;
        /* Cells begin at even columns: the first value is an odd column's. */
        for (int x = 0; x < CELL_COLUMNS + 2; x++) {
            float light = ((x + 1) & 1) == parity ? others[x] : greens[x];
            raw[row][x] = light < 1.0f ? light : 1.0f;
        }
    }
    float *red = row_at(&pass->to, 0, y) + cell->left, *green = row_at(&pass->to, 1, y) + cell->left;
    float *blue = row_at(&pass->to, 2, y) + cell->left;
    for (int x = 0; x < CELL_COLUMNS; x++) {
        float own = raw[1][x + 1];
        float horizontal = 0.5f * (raw[1][x] + raw[1][x + 2]);
        float vertical = 0.5f * (raw[0][x + 1] + raw[2][x + 1]);
        float diagonal = 0.25f * (((raw[0][x] + raw[0][x + 2]) + raw[2][x]) + raw[2][x + 2]);
        float cross = 0.5f * (horizontal + vertical);
        int is_odd = x & 1;
        if (y & 1) {
            red[x] = is_odd ? diagonal : vertical;
            green[x] = is_odd ? cross : own;
            blue[x] = is_odd ? own : horizontal;
        } else {
            red[x] = is_odd ? horizontal : own;
            green[x] = is_odd ? own : cross;
            blue[x] = is_odd ? vertical : diagonal;
        }
    }
}

void demosaic(Pass *pass, const Cell *cell) {
    int is_inside = cell->left > 0 && cell->left + CELL_COLUMNS < pass->job->width;
    for (int y = cell->top; y < cell->top + cell->rows; y++) {
        if (is_inside && y > 0 && y < pass->job->height - 1) {
            demosaic_row(pass, cell, y);
            continue;
        }
        for (int x = cell->left; x < cell->left + cell->columns; x++)
            demosaic_pixel(pass, x, y);
    }
    measure_cell(pass, cell, &pass->change);
}

/* Light of the opposite pixel, reflected at the wall of a tube. */
void add_ghost(Pass *pass, const Cell *cell) {
    const ImageStage *stage = pass->stage;
    int column_sum = (int)stage->numbers[0], row_sum = (int)stage->numbers[1];
    copy_cell(pass, cell);
    for (int row = cell->top; row < cell->top + cell->rows; row++) {
        size_t first = (size_t)row * (size_t)pass->job->width;
        const float *kept = (const float *)stage->maps[0] + first;
        const float *ghost = (const float *)stage->maps[1] + first;
        for (int channel = 0; channel < 3; channel++) {
            const float *from = row_at(&pass->from, channel, row);
            const float *opposite =
                row_at(&pass->from, channel, clamp(row_sum - row, pass->job->height - 1));
            float *to = row_at(&pass->to, channel, row);
            for (int x = cell->left; x < cell->left + cell->columns; x++)
                to[x] = from[x] * kept[x] +
                        opposite[clamp(column_sum - x, pass->job->width - 1)] * ghost[x];
        }
    }
    measure_cell(pass, cell, &pass->change);
}
