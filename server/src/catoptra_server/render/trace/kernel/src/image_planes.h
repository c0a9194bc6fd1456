/* An image as three planes of floats, in cells of 16 x 8 pixels.
 *
 * Cells are what stages leave plain or change, and what threads take. A pass develops each cell in
 * the processor's nearest cache: by a stage that reads other pixels of the image before, then by
 * all stages that act on a pixel, up to the next pass. Rows of a cell are whole vectors: the last
 * column of cells reaches into the border, which repeats the image's edge.
 */
#ifndef CATOPTRA_IMAGE_PLANES_H
#define CATOPTRA_IMAGE_PLANES_H

#include "image.h"
#include "lanes.h"
#include "pixel_change.h"

#include <stdatomic.h>
#include <stddef.h>

enum { CELL_COLUMNS = 16, CELL_ROWS = 8 };

typedef struct {
    int width, height;
    int border, rows_beyond; /* px beside, and above and below */
    size_t stride, plane;    /* floats from row to row, and from plane to plane */
    float *values;           /* with the border */
} Planes;

/* Extremes of the three colours of each cell. */
typedef struct {
    float low, high;
} CellRange;

typedef struct {
    int row, column;       /* of the cell */
    int top, left;         /* px */
    int rows, columns;     /* px within the image */
} Cell;

/* A cell in development: three colours, or in the first plane the one that a mosaic keeps. */
typedef struct {
    _Alignas(64) float values[3][CELL_ROWS][CELL_COLUMNS];
    int planes;
} CellValues;

/* Changes by a stage; of a blur by range the other one is that of the image without any blur, and
 * `spilt` are those of pixels beside, by what the stage changes above the well. */
typedef struct {
    ChangeMeasure own, other, spilt;
    float mean_luminance; /* of the picture without a factor, before an automatic gain */
} Changes;

typedef enum { TO_NOTHING, TO_PLANES, TO_MOSAIC, TO_PICTURE } Target;

/* What the threads of a pass share. */
typedef struct Pass {
    const ImageJob *job;
    const ImageStage *stage;  /* that reads other pixels; or NULL */
    const ImageStage *points; /* that act on a pixel */
    int num_points;
    Target target;
    int is_first; /* reads the job's light */
    int sums_luminance;
    Planes from, to, mosaic;
    int cell_rows, cell_columns;
    CellRange *ranges, *next_ranges; /* (cell_rows, cell_columns) of `from` and `to` */
    double *row_sums; /* (1 + stages, cell_rows) luminance, with all stages, without each factor */
    float mean_luminance;
    float *means, *scattered; /* (3, rows, columns) of a glare's cells */
    float *lines;             /* (3, rows, width) scattered light between them */
    float veil[3];
    Changes *changes; /* of all stages of the job; NULL: nothing is measured */
    char *maps;       /* memory of the changes' maps */
    size_t maps_bytes;
    const struct Pass *before; /* of a mosaic: the pass that made it */
} Pass;

static inline float *row_at(const Planes *planes, int channel, int row) {
    return planes->values + (size_t)channel * planes->plane +
           (size_t)(row + planes->rows_beyond) * planes->stride + (size_t)planes->border;
}

static inline int clamp(int value, int last) {
    return value < 0 ? 0 : value < last ? value : last;
}

/* A row of the image; those above and below repeat the edge. */
static inline const float *clamped_row(const Planes *planes, int channel, int row) {
    return row_at(planes, channel, clamp(row, planes->height - 1));
}

/* Index of a cell's row in maps of the image's size. */
static inline size_t place_in_map(const Pass *pass, const Cell *cell, int row) {
    return (size_t)(cell->top + row) * (size_t)pass->job->width + (size_t)cell->left;
}

/* Fetch what the cell after the next one reads of a row, or writes: rows are far apart in memory,
 * too many for the processor to foresee. */
#define FETCH_AHEAD(row, is_written) __builtin_prefetch((row) + 2 * CELL_COLUMNS, is_written)

/* Sixteen values of a map's row, of which `count` are in the image; the others repeat the first. */
static inline Floats16 load_map(const void *map, size_t first, int count) {
    const float *values = (const float *)map + first;
    FETCH_AHEAD(values, 0);
    if (count == CELL_COLUMNS)
        return load16(values);
    Floats16 loaded = splat16(values[0]);
    __builtin_memcpy(&loaded, values, sizeof(float) * (size_t)count);
    return loaded;
}

/* Extremes of a cell and of those within a distance in px around it. */
CellRange find_range_around(const Pass *pass, const Cell *cell, int reach);

/* The cell as it is before the pass. */
void load_cell(const Pass *pass, const Cell *cell, CellValues *values);

/* Add the luminance of a cell to one of its row's sums. */
void sum_luminance(const Pass *pass, const Cell *cell, const CellValues *values, int number);

/* Put a developed cell where the next pass, or the caller, reads it. */
void store_cell(const Pass *pass, const Cell *cell, const CellValues *values);

/* Repeat the first and the last row of planes whose rows are all stored. */
void fill_rows_beyond(const Planes *planes);

/* Keep of three colours the one that an RGGB mosaic measures. */
void keep_mosaic(CellValues *values);

#endif
