/* An image as three planes of floats, with a border, in cells of 16 x 8 pixels.
 *
 * Cells are what stages leave plain or change, and what threads take. Rows of a cell are whole
 * vectors: the last column of cells reaches into the border, which repeats the image's edge.
 */
#ifndef CATOPTRA_IMAGE_PLANES_H
#define CATOPTRA_IMAGE_PLANES_H

#include "image.h"
#include "pixel_change.h"
#include "workers.h"

#include <stdatomic.h>
#include <stddef.h>

enum { CELL_COLUMNS = 16, CELL_ROWS = 8 };

typedef struct {
    int width, height, border;
    size_t stride, plane; /* floats from row to row, and from plane to plane */
    float *values;        /* with the border */
} Planes;

/* Extremes of the three colours of each cell. */
typedef struct {
    float low, high;
} CellRange;

/* What the threads of a stage share. */
typedef struct {
    const ImageJob *job;
    ImageStage *stage;
    int count; /* stages from `stage` on that are done in one pass */
    Planes from, to;
    int cell_rows, cell_columns;
    CellRange *ranges; /* (cell_rows, cell_columns) of `from`, where a stage asks for them */
    double *row_sums;  /* (height,) luminance */
    float mean_luminance;
    float *means, *scattered; /* (3, rows, columns) of a glare's cells */
    float *lines;             /* (3, rows, width) scattered light between them */
    float veil[3];
    atomic_int next;
    ChangeMeasure change, other_change;
    ChangeMeasure *changes; /* (count,) of stages that share a pass */
} Pass;

typedef struct {
    int row, column;       /* of the cell */
    int top, left;         /* px */
    int rows, columns;     /* px within the image */
} Cell;

static inline float *row_at(const Planes *planes, int channel, int row) {
    return planes->values + (size_t)channel * planes->plane +
           (size_t)(row + planes->border) * planes->stride + (size_t)planes->border;
}

/* Extremes of a cell and of those within a distance in px around it. */
CellRange find_range_around(const Pass *pass, const Cell *cell, int reach);

void copy_cell(const Pass *pass, const Cell *cell);

/* Visit all cells of the pass, each by one thread. */
void for_each_cell(Pass *pass, void (*visit)(Pass *pass, const Cell *cell));

/* Repeat the image's edge in the border. */
void fill_border(Pass *pass);

#endif
