/* Provides image_planes.h: cells of an image, their extremes and where they are kept.
 * No twin. Owns nothing: planes are the job's scratch memory.
 * Threads: any thread of the pool, each for cells of its own. */
#include "image_planes.h"

#include "image_vectors.h"

#include <string.h>

CellRange find_range_around(const Pass *pass, const Cell *cell, int reach) {
    int rows = (reach + CELL_ROWS - 1) / CELL_ROWS;
    int columns = (reach + CELL_COLUMNS - 1) / CELL_COLUMNS;
    CellRange all = pass->ranges[cell->row * pass->cell_columns + cell->column];
    for (int row = cell->row - rows; row <= cell->row + rows; row++)
        for (int column = cell->column - columns; column <= cell->column + columns; column++) {
            if (row < 0 || row >= pass->cell_rows || column < 0 || column >= pass->cell_columns)
                continue;
            CellRange one = pass->ranges[row * pass->cell_columns + column];
            all.low = one.low < all.low ? one.low : all.low;
            all.high = one.high > all.high ? one.high : all.high;
        }
    return all;
}

static void load_light(const Pass *pass, const Cell *cell, CellValues *values) {
    for (int row = 0; row < cell->rows; row++) {
        const float *light = pass->job->light + 3 * place_in_map(pass, cell, row);
        float part[3 * CELL_COLUMNS] = {0};
        for (int x = 0; x < 3 * CELL_COLUMNS; x += CELL_COLUMNS)
            FETCH_AHEAD(light + 4 * CELL_COLUMNS + x, 0);
        if (cell->columns < CELL_COLUMNS)
            light = memcpy(part, light, sizeof(float) * 3 * (size_t)cell->columns);
        Floats16 a = load16(light), b = load16(light + 16), c = load16(light + 32);
        Floats16 red = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, -1, -1,
                                               -1, -1, -1);
        Floats16 green = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, -1,
                                                 -1, -1, -1, -1);
        Floats16 blue = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, -1, -1,
                                                -1, -1, -1, -1);
        store16(__builtin_shufflevector(red, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26,
                                        29),
                values->values[0][row]);
        store16(__builtin_shufflevector(green, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27,
                                        30),
                values->values[1][row]);
        store16(__builtin_shufflevector(blue, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28,
                                        31),
                values->values[2][row]);
    }
}

void load_cell(const Pass *pass, const Cell *cell, CellValues *values) {
    if (pass->is_first) {
        load_light(pass, cell, values);
        return;
    }
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++) {
            const float *light = row_at(&pass->from, channel, cell->top + row) + cell->left;
            FETCH_AHEAD(light, 0);
            store16(load16(light), values->values[channel][row]);
        }
}

void keep_mosaic(CellValues *values) {
    for (int row = 0; row < CELL_ROWS; row++) {
        /* Cells begin at even rows and columns. */
        int even = row & 1;
        Floats16 first = load16(values->values[even][row]);
        store16(alternate16(first, load16(values->values[even + 1][row])), values->values[0][row]);
    }
    values->planes = 1;
}

/* Luminance of each row of cells, in float64 and in one order for any number of threads. */
void sum_luminance(const Pass *pass, const Cell *cell, const CellValues *values, int number) {
    static const double weights[3] = {0.2126, 0.7152, 0.0722};
    Doubles16 sums = {0};
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++) {
            Floats16 light = load16(values->values[channel][row]);
            light = select16(columns_below(cell->columns), light, splat16(0.0f));
            sums += weights[channel] * __builtin_convertvector(light, Doubles16);
        }
    double *sum = pass->row_sums + number * pass->cell_rows + cell->row;
    for (int x = 0; x < CELL_COLUMNS; x++)
        *sum += sums[x];
}

static CellRange find_range(const CellValues *values, const Cell *cell) {
    Floats16 low = splat16(values->values[0][0][0]), high = low;
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++) {
            Floats16 light = load_columns(values->values[channel][row], cell->columns);
            low = least16(light, low);
            high = most16(light, high);
        }
    return (CellRange){least_of16(low), most_of16(high)};
}

/* Repeat the image's edge beside a row: the last cell may reach farther than the border proper. */
static void fill_sides(const Planes *planes, const Cell *cell, float *row) {
    if (cell->left == 0)
        for (int x = -planes->border; x < 0; x++)
            row[x] = row[0];
    if (cell->left + CELL_COLUMNS >= planes->width)
        for (int x = planes->width; x < (int)planes->stride - planes->border; x++)
            row[x] = row[planes->width - 1];
}

static void store_planes(const Pass *pass, const Cell *cell, const CellValues *values) {
    for (int channel = 0; channel < 3; channel++)
        for (int row = 0; row < cell->rows; row++) {
            float *to = row_at(&pass->to, channel, cell->top + row);
            FETCH_AHEAD(to + cell->left, 1);
            store16(load16(values->values[channel][row]), to + cell->left);
            fill_sides(&pass->to, cell, to);
        }
    pass->next_ranges[cell->row * pass->cell_columns + cell->column] = find_range(values, cell);
}

/* A pixel measures at most a full well. Beside the edge the image is mirrored about its last pixel,
 * which keeps the pattern. */
static void store_mosaic(const Pass *pass, const Cell *cell, const CellValues *values) {
    int last = pass->mosaic.width - 1;
    for (int row = 0; row < cell->rows; row++) {
        float *to = row_at(&pass->mosaic, 0, cell->top + row);
        FETCH_AHEAD(to + cell->left, 1);
        store16(least16(load16(values->values[0][row]), splat16(1.0f)), to + cell->left);
        if (cell->left == 0)
            to[-1] = to[last > 0];
        if (cell->left + CELL_COLUMNS > last)
            to[last + 1] = to[last > 0 ? last - 1 : 0];
    }
}

/* Row of the sRGB table; what is not a number is black. */
static Ints16 levels_of(Floats16 linear) {
    Floats16 clipped = select16(linear > 0.0f, least16(linear, splat16(1.0f)), splat16(0.0f));
    return __builtin_convertvector(clipped * 65535.0f + 0.5f, Ints16);
}

static void store_rgb(const uint8_t *table, const CellValues *values, int row, int columns,
                      uint8_t *rgb) {
    int32_t levels[3][CELL_COLUMNS];
    FETCH_AHEAD(rgb + 4 * CELL_COLUMNS, 1);
    for (int channel = 0; channel < 3; channel++)
        store_ints16(levels_of(load16(values->values[channel][row])), levels[channel]);
    for (int x = 0; x < columns; x++)
        for (int channel = 0; channel < 3; channel++)
            rgb[3 * x + channel] = table[levels[channel][x]];
}

static void store_picture(const Pass *pass, const Cell *cell, const CellValues *values) {
    const ImageJob *job = pass->job;
    for (int row = 0; row < cell->rows; row++) {
        size_t first = 3 * place_in_map(pass, cell, row);
        if (job->rgb)
            store_rgb(job->srgb_table, values, row, cell->columns, job->rgb + first);
        for (int channel = 0; channel < 3 && job->linear; channel++)
            for (int x = 0; x < cell->columns; x++)
                job->linear[first + (size_t)(3 * x + channel)] = values->values[channel][row][x];
    }
}

void store_cell(const Pass *pass, const Cell *cell, const CellValues *values) {
    if (pass->sums_luminance)
        sum_luminance(pass, cell, values, 0);
    if (pass->target == TO_PLANES)
        store_planes(pass, cell, values);
    else if (pass->target == TO_MOSAIC)
        store_mosaic(pass, cell, values);
    else if (pass->target == TO_PICTURE)
        store_picture(pass, cell, values);
}

void fill_rows_beyond(const Planes *planes) {
    size_t row_bytes = sizeof(float) * planes->stride;
    for (int channel = 0; channel < 3; channel++) {
        float *first = row_at(planes, channel, 0) - planes->border;
        float *last = row_at(planes, channel, planes->height - 1) - planes->border;
        for (int row = 1; row <= planes->rows_beyond; row++) {
            memcpy(first - (size_t)row * planes->stride, first, row_bytes);
            memcpy(last + (size_t)row * planes->stride, last, row_bytes);
        }
    }
}
