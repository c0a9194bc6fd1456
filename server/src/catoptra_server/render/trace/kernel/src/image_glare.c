/* Provides image_glare.h: the stage of veiling glare.
 * Stage: maps[0] weights (rows, 2 columns - 1) of cells by rows apart and columns from
 * 1 - columns on; maps[1] sources (num_rows, 8): pixel, peak and veil in RGB; numbers: fraction of
 * light that is not scattered, veil per light of all pixels, 1 / shoulder^2.
 * Float64 twin: effects/medium/veiling_glare.py. Owns nothing: cells are the job's scratch memory.
 * Threads: `scatter` by the calling one, in one order; `change_glare` by any. */
#include "image_glare.h"

enum { SOURCE_NUMBERS = 8 };

typedef struct {
    int side, rows, columns; /* px; cells */
    size_t plane;
} Cells;

static Cells lay_out_cells(const ImageJob *job, const ImageStage *stage) {
    int side = stage->size;
    int rows = (job->height + side - 1) / side, columns = (job->width + side - 1) / side;
    return (Cells){side, rows, columns, (size_t)rows * (size_t)columns};
}

size_t glare_bytes(const ImageJob *job) {
    size_t most = 0;
    for (int i = 0; i < job->num_stages; i++) {
        if (job->stages[i].kind != STAGE_GLARE)
            continue;
        Cells cells = lay_out_cells(job, job->stages + i);
        size_t values = 2 * cells.plane + (size_t)cells.rows * (size_t)job->width;
        most = values > most ? values : most;
    }
    return sizeof(float) * 3 * most;
}

/* Means of cells; what lies beyond the image's edge counts as black. Sum of all light. */
static double average_cells(Pass *pass, const Cells *cells, int channel) {
    float *means = pass->means + (size_t)channel * cells->plane;
    double total = 0.0;
    for (int row = 0; row < cells->rows; row++) {
        double sums[64] = {0.0}; /* the twin has at most 40 cells along a side */
        int end = (row + 1) * cells->side;
        for (int y = row * cells->side; y < end && y < pass->from.height; y++) {
            const float *values = row_at(&pass->from, channel, y);
            for (int column = 0; column < cells->columns; column++) {
                int right = (column + 1) * cells->side;
                right = right < pass->from.width ? right : pass->from.width;
                float sum = 0.0f;
                for (int x = column * cells->side; x < right; x++)
                    sum += values[x];
                sums[column] += (double)sum;
            }
        }
        for (int column = 0; column < cells->columns; column++) {
            means[row * cells->columns + column] =
                (float)(sums[column] / ((double)cells->side * cells->side));
            total += sums[column];
        }
    }
    return total;
}

static void exchange(const Pass *pass, const Cells *cells, int channel) {
    const float *weights = pass->points->maps[0];
    const float *means = pass->means + (size_t)channel * cells->plane;
    float *received = pass->scattered + (size_t)channel * cells->plane;
    int columns = cells->columns;
    for (size_t i = 0; i < cells->plane; i++)
        received[i] = 0.0f;
    for (int from = 0; from < cells->rows * columns; from++) {
        float mean = means[from];
        int row = from / columns, column = from % columns;
        if (mean == 0.0f)
            continue; /* most of what lies beside the mirror */
        for (int to = 0; to < cells->rows; to++) {
            int apart = to > row ? to - row : row - to;
            const float *weight = weights + apart * (2 * columns - 1) + columns - 1 - column;
            float *sums = received + to * columns;
            for (int x = 0; x < columns; x++)
                sums[x] += mean * weight[x];
        }
    }
}

/* Cell before a pixel's place between the centres of cells, and the fraction of the way to the
 * next. */
static int place_between(int pixel, int side, int count, float *fraction) {
    float place = ((float)pixel + 0.5f) / (float)side - 0.5f;
    place = place > 0.0f ? place : 0.0f;
    int before = (int)place, last = count > 1 ? count - 2 : 0;
    before = before < last ? before : last;
    *fraction = place - (float)before < 1.0f ? place - (float)before : 1.0f;
    return before;
}

/* Interpolate each row of cells to the image's columns. */
static void widen(const Pass *pass, const Cells *cells, int channel) {
    const float *received = pass->scattered + (size_t)channel * cells->plane;
    int width = pass->job->width;
    float *line = pass->lines + (size_t)(channel * cells->rows) * (size_t)width;
    for (int row = 0; row < cells->rows; row++, received += cells->columns, line += width)
        for (int x = 0; x < width; x++) {
            float right;
            int column = place_between(x, cells->side, cells->columns, &right);
            int next = cells->columns > 1 ? column + 1 : column;
            line[x] = received[column] + right * (received[next] - received[column]);
        }
}

void scatter(Pass *pass) {
    const ImageStage *stage = pass->points;
    Cells cells = lay_out_cells(pass->job, stage);
    pass->scattered = pass->means + 3 * cells.plane;
    pass->lines = pass->scattered + 3 * cells.plane;
    for (int channel = 0; channel < 3; channel++) {
        pass->veil[channel] = (float)average_cells(pass, &cells, channel) * stage->numbers[1];
        exchange(pass, &cells, channel);
        widen(pass, &cells, channel);
        const float *source = stage->maps[1];
        for (int i = 0; i < stage->num_rows; i++)
            pass->veil[channel] += source[i * SOURCE_NUMBERS + 5 + channel];
    }
}

void change_glare(const Pass *pass, const ImageStage *stage, int channel, size_t first,
                  float *values, int count) {
    Cells cells = lay_out_cells(pass->job, stage);
    size_t width = (size_t)pass->job->width;
    int y = (int)(first / width), left = (int)(first % width);
    float below, kept = stage->numbers[0], veil = pass->veil[channel];
    int row = place_between(y, cells.side, cells.rows, &below);
    const float *above = pass->lines + (size_t)(channel * cells.rows + row) * width + left;
    const float *under = above + (cells.rows > 1 ? width : 0);
    for (int x = 0; x < count; x++)
        values[x] = kept * values[x] + (above[x] + below * (under[x] - above[x])) + veil;
    for (int i = 0; i < stage->num_rows; i++) {
        const float *source = (const float *)stage->maps[1] + i * SOURCE_NUMBERS;
        float dv = (float)y + 0.5f - source[1], from_row = dv * dv, peak = source[2 + channel];
        for (int x = 0; x < count; x++) {
            float du = (float)(left + x) + 0.5f - source[0];
            values[x] += peak / (1.0f + stage->numbers[2] * (du * du + from_row));
        }
    }
}
