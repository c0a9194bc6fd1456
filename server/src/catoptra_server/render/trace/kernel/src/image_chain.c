/* Provides catoptra_change_image: the chain of an image's stages, one pass after the other, each
 * by all threads.
 * Float64 twin: the formulas of effects/, in their order. Owns nothing: Python lends the scratch
 * memory of catoptra_image_scratch bytes.
 * Threads: the calling thread begins each pass, the pool runs it. */
#define _GNU_SOURCE
#include "image_change.h"
#include "image_glare.h"
#include "image_points.h"
#include "image_spread.h"

#include "device.h"

#include <time.h>

enum { MAX_SHARED = 16 }; /* stages of one pass */

typedef void Visit(Pass *pass, const Cell *cell);

typedef struct {
    Pass *pass;
    Visit *visit;
} CellJob;

static double now_ms(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

static void visit_cells(void *argument) {
    CellJob *job = argument;
    for_each_cell(job->pass, job->visit);
}

static void run(Device *device, Pass *pass, Visit *visit) {
    CellJob job = {pass, visit};
    atomic_store(&pass->next, 0);
    workers_run(device->workers, visit_cells, &job);
}

static void load_cell(Pass *pass, const Cell *cell) {
    for (int row = cell->top; row < cell->top + cell->rows; row++) {
        const float *light = pass->job->light + 3 * ((size_t)row * (size_t)pass->job->width +
                                                     (size_t)cell->left);
        for (int channel = 0; channel < 3; channel++) {
            float *values = row_at(&pass->from, channel, row) + cell->left;
            for (int x = 0; x < cell->columns; x++)
                values[x] = light[3 * x + channel];
        }
    }
}

/* Row of the sRGB table; what is not a number is black. */
static int32_t level_of(float linear) {
    float clipped = linear > 0.0f ? linear < 1.0f ? linear : 1.0f : 0.0f;
    return (int32_t)(clipped * 65535.0f + 0.5f);
}

static void store_cell(Pass *pass, const Cell *cell) {
    const ImageJob *job = pass->job;
    for (int row = cell->top; row < cell->top + cell->rows; row++) {
        size_t first = 3 * ((size_t)row * (size_t)job->width + (size_t)cell->left);
        for (int channel = 0; channel < 3; channel++) {
            const float *values = row_at(&pass->from, channel, row) + cell->left;
            for (int x = 0; x < cell->columns && job->linear; x++)
                job->linear[first + (size_t)(3 * x + channel)] = values[x];
            for (int x = 0; x < cell->columns && job->rgb; x++)
                job->rgb[first + (size_t)(3 * x + channel)] =
                    job->srgb_table[level_of(values[x])];
        }
    }
}

static void find_range(Pass *pass, const Cell *cell) {
    Floats16 low = (Floats16){0} + row_at(&pass->from, 0, cell->top)[cell->left], high = low;
    for (int channel = 0; channel < 3; channel++)
        for (int row = cell->top; row < cell->top + cell->rows; row++) {
            const float *first = row_at(&pass->from, channel, row) + cell->left;
            Floats16 values = load_columns(first, cell->columns);
            low = least16(values, low);
            high = most16(values, high);
        }
    pass->ranges[cell->row * pass->cell_columns + cell->column] =
        (CellRange){smallest_of(low), largest_of(high)};
}

/* Luminance of each row of cells, in float64 and in one order for any number of threads. */
static void sum_cell(Pass *pass, const Cell *cell) {
    static const double weights[3] = {0.2126, 0.7152, 0.0722};
    double sum = 0.0;
    for (int channel = 0; channel < 3; channel++)
        for (int row = cell->top; row < cell->top + cell->rows; row++) {
            const float *values = row_at(&pass->from, channel, row) + cell->left;
            double row_sum = 0.0;
            for (int x = 0; x < cell->columns; x++)
                row_sum += (double)values[x];
            sum += weights[channel] * row_sum;
        }
    pass->row_sums[cell->row] = (cell->column ? pass->row_sums[cell->row] : 0.0) + sum;
}

static void measure_luminance(Device *device, Pass *pass) {
    double sum = 0.0;
    run(device, pass, sum_cell);
    for (int row = 0; row < pass->cell_rows; row++)
        sum += pass->row_sums[row];
    int32_t pixels = pass->job->mirror_pixels;
    pass->mean_luminance = (float)(sum / (pixels > 0 ? pixels : 1));
}

static Visit *const SPREADS[] = {
    [STAGE_BLUR] = blur, [STAGE_WARP] = warp,      [STAGE_MAGNIFY] = magnify,
    [STAGE_BLOOM] = bloom, [STAGE_BAYER] = demosaic, [STAGE_GHOST] = add_ghost,
};

static int is_point_stage(const ImageStage *stage) { return stage->kind < STAGE_BLUR; }

static int needs_luminance(const ImageStage *stage) {
    return stage->kind == STAGE_AUTO_GAIN || stage->kind == STAGE_COVER;
}

/* Stages from one on that share its pass: neighbouring gains. */
static int count_shared(const ImageJob *job, int first) {
    int count = 1;
    while (first + count < job->num_stages && count < MAX_SHARED &&
           job->stages[first].kind == STAGE_GAIN && job->stages[first + count].kind == STAGE_GAIN)
        count++;
    return count;
}

static PixelChange conclude(const Pass *pass, const ImageStage *stage,
                            const ChangeMeasure *measure) {
    return conclude_change(measure, &stage->limits, pass->job->width * pass->job->height);
}

static void spread(Device *device, Pass *pass) {
    fill_border(pass);
    run(device, pass, find_range);
    run(device, pass, SPREADS[pass->stage->kind]);
    Planes from = pass->from;
    pass->from = pass->to;
    pass->to = from;
    pass->stage->change = conclude(pass, pass->stage, &pass->change);
    pass->stage->other_change = conclude(pass, pass->stage, &pass->other_change);
}

static void run_stages(Device *device, Pass *pass) {
    ChangeMeasure changes[MAX_SHARED];
    double begin_ms = now_ms();
    memset(&pass->change, 0, sizeof pass->change);
    memset(&pass->other_change, 0, sizeof pass->other_change);
    if (is_point_stage(pass->stage)) {
        pass->changes = changes;
        memset(changes, 0, sizeof changes);
        if (needs_luminance(pass->stage))
            measure_luminance(device, pass);
        if (pass->stage->kind == STAGE_GLARE)
            scatter(pass);
        run(device, pass, change_points);
        for (int i = 0; i < pass->count; i++)
            pass->stage[i].change = conclude(pass, pass->stage + i, &changes[i]);
    } else {
        spread(device, pass);
    }
    /* Stages of one pass share its time equally. */
    double ms = (now_ms() - begin_ms) / pass->count;
    for (int i = 0; i < pass->count; i++)
        pass->stage[i].ms = ms;
}

static Planes lay_out(const ImageJob *job, int border) {
    int columns = (job->width + CELL_COLUMNS - 1) / CELL_COLUMNS * CELL_COLUMNS;
    Planes planes = {.width = job->width, .height = job->height, .border = border};
    planes.stride = (size_t)(columns + 2 * border);
    planes.plane = planes.stride * (size_t)(job->height + 2 * border);
    return planes;
}

static int largest_border(const ImageJob *job) {
    int border = 1;
    for (int i = 0; i < job->num_stages; i++)
        if (job->stages[i].kind == STAGE_BLUR && job->stages[i].size > border)
            border = job->stages[i].size;
    return border;
}

static Pass lay_out_pass(const ImageJob *job) {
    Pass pass = {.job = job, .from = lay_out(job, largest_border(job))};
    pass.to = pass.from;
    pass.cell_rows = (job->height + CELL_ROWS - 1) / CELL_ROWS;
    pass.cell_columns = (job->width + CELL_COLUMNS - 1) / CELL_COLUMNS;
    return pass;
}

static size_t plane_bytes(const Pass *pass) { return sizeof(float) * 3 * pass->from.plane; }

static size_t sum_bytes(const Pass *pass) { return sizeof(double) * (size_t)pass->cell_rows; }

static size_t range_bytes(const Pass *pass) {
    return sizeof(CellRange) * (size_t)pass->cell_rows * (size_t)pass->cell_columns;
}

int64_t catoptra_image_scratch(const ImageJob *job) {
    Pass pass = lay_out_pass(job);
    return (int64_t)(2 * plane_bytes(&pass) + sum_bytes(&pass) + range_bytes(&pass) +
                     glare_bytes(job));
}

static void place(Pass *pass, char *scratch) {
    /* The widest members first: all stay aligned. */
    pass->row_sums = (double *)scratch;
    pass->ranges = (CellRange *)(scratch + sum_bytes(pass));
    pass->from.values = (float *)(scratch + sum_bytes(pass) + range_bytes(pass));
    pass->to.values = pass->from.values + 3 * pass->from.plane;
    pass->means = pass->to.values + 3 * pass->to.plane;
}

void catoptra_change_image(Device *device, ImageJob *job) {
    Pass pass = lay_out_pass(job);
    double begin_ms = now_ms();
    place(&pass, job->scratch);
    run(device, &pass, load_cell);
    job->encode_ms = now_ms() - begin_ms;
    for (int first = 0; first < job->num_stages; first += pass.count) {
        pass.stage = job->stages + first;
        pass.count = count_shared(job, first);
        run_stages(device, &pass);
    }
    begin_ms = now_ms();
    run(device, &pass, store_cell);
    job->encode_ms += now_ms() - begin_ms;
}
