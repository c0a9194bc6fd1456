/* Provides image_planes.h: cells of an image, their extremes and its border.
 * No twin. Owns nothing: planes are the job's scratch memory.
 * Threads: any thread of the pool, each for cells of its own. */
#include "image_planes.h"

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

void copy_cell(const Pass *pass, const Cell *cell) {
    for (int channel = 0; channel < 3; channel++)
        for (int row = cell->top; row < cell->top + cell->rows; row++)
            memcpy(row_at(&pass->to, channel, row) + cell->left,
                   row_at(&pass->from, channel, row) + cell->left, sizeof(float) * CELL_COLUMNS);
}

void for_each_cell(Pass *pass, void (*visit)(Pass *, const Cell *)) {
    int row;
    while ((row = atomic_fetch_add(&pass->next, 1)) < pass->cell_rows) {
        int top = row * CELL_ROWS, left_rows = pass->from.height - top;
        int rows = left_rows < CELL_ROWS ? left_rows : CELL_ROWS;
        for (int column = 0; column < pass->cell_columns; column++) {
            int left = column * CELL_COLUMNS, left_columns = pass->from.width - left;
            int columns = left_columns < CELL_COLUMNS ? left_columns : CELL_COLUMNS;
            Cell cell = {row, column, top, left, rows, columns};
            visit(pass, &cell);
        }
    }
}

static void fill_sides(const Planes *planes, float *row) {
    /* The last cell may reach farther than the border proper. */
    int end = (int)(planes->stride) - planes->border;
    for (int x = -planes->border; x < 0; x++)
        row[x] = row[0];
    for (int x = planes->width; x < end; x++)
        row[x] = row[planes->width - 1];
}

void fill_border(Pass *pass) {
    const Planes *planes = &pass->from;
    size_t row_bytes = sizeof(float) * planes->stride;
    for (int channel = 0; channel < 3; channel++) {
        for (int row = 0; row < planes->height; row++)
            fill_sides(planes, row_at(planes, channel, row));
        float *first = row_at(planes, channel, 0) - planes->border;
        float *last = row_at(planes, channel, planes->height - 1) - planes->border;
        for (int row = 1; row <= planes->border; row++) {
            memcpy(first - (size_t)row * planes->stride, first, row_bytes);
            memcpy(last + (size_t)row * planes->stride, last, row_bytes);
        }
    }
}
