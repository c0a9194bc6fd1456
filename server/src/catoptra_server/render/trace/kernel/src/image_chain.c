/* Provides catoptra_change_image: the chain of an image's stages in as few passes as they allow,
 * one after the other, each by all threads. A pass ends where the next stage reads other pixels, or
 * a mean of all. The pass before a mosaic develops the colour of each pixel that it keeps.
 * Float64 twin: the formulas of effects/, in their order. Owns nothing: Python lends the scratch
 * memory of catoptra_image_scratch bytes.
 * Threads: the calling thread begins each pass, the pool runs it. */
#define _GNU_SOURCE
#include "image_change.h"
#include "image_glare.h"
#include "image_points.h"
#include "image_spread.h"

#include "device.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Least border beside: whole vectors are read at most one beyond the image's edge. */
enum { MIN_BORDER = 2 * CELL_COLUMNS, ALIGNMENT = 64 };
/* Stages that a change is followed through. */
enum { MAX_LENS = 16 };

typedef struct {
    const Pass *pass;
    atomic_int next;
} PassJob;

static double now_ms(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

static void (*const SPREADS[])(const Pass *, const Cell *, CellValues *) = {
    [STAGE_BLUR] = blur,   [STAGE_WARP] = warp,      [STAGE_MAGNIFY] = magnify,
    [STAGE_BLOOM] = bloom, [STAGE_BAYER] = demosaic, [STAGE_GHOST] = add_ghost,
};

static int reads_others(const ImageStage *stage) { return stage->kind >= STAGE_BLUR; }

static int needs_luminance(const ImageStage *stage) {
    return stage->kind == STAGE_AUTO_GAIN || stage->kind == STAGE_COVER;
}

static int begins_pass(const ImageStage *stage) {
    return reads_others(stage) || needs_luminance(stage) || stage->kind == STAGE_GLARE;
}

/* The three colours of a cell behind the pass's stage that reads others. */
static void begin_cell(const Pass *pass, const Cell *cell, CellValues *values) {
    values->planes = 3;
    if (pass->stage)
        SPREADS[pass->stage->kind](pass, cell, values);
    else
        load_cell(pass, cell, values);
}

/* The mosaic's change is that against the three colours, of which the pass before dropped two:
 * developed again, where stages had dropped any work no more than until the effect is seen. */
static void measure_mosaic(const Pass *pass, const Cell *cell, const CellValues *values) {
    const ImageStage *stage = pass->stage;
    CellValues colours;
    if (!is_measured(pass, stage))
        return;
    ChangeMeasure *measure = &changes_of(pass, stage)->own;
    if (pass->before->num_points && !is_counted(measure, &stage->limits))
        return;
    begin_cell(pass->before, cell, &colours);
    change_points(pass->before, cell, &colours);
    measure_change(stage, measure, &colours, values, cell);
}

static void develop_cell(const Pass *pass, const Cell *cell) {
    CellValues values;
    begin_cell(pass, cell, &values);
    if (pass->stage && pass->stage->kind == STAGE_BAYER)
        measure_mosaic(pass, cell, &values);
    if (pass->target == TO_MOSAIC)
        keep_mosaic(&values);
    change_points(pass, cell, &values);
    if (pass->sums_luminance)
        visit_factors(pass, pass->points + pass->num_points, cell, &values);
    store_cell(pass, cell, &values);
}

/* Rows of cells, each by one thread from left to right. */
static void develop_rows(void *argument) {
    PassJob *job = argument;
    const Pass *pass = job->pass;
    int row;
    while ((row = atomic_fetch_add(&job->next, 1)) < pass->cell_rows) {
        int top = row * CELL_ROWS, left_rows = pass->job->height - top;
        int rows = left_rows < CELL_ROWS ? left_rows : CELL_ROWS;
        for (int i = 0; i <= pass->job->num_stages; i++)
            pass->row_sums[i * pass->cell_rows + row] = 0.0;
        for (int column = 0; column < pass->cell_columns; column++) {
            int left = column * CELL_COLUMNS, left_columns = pass->job->width - left;
            int columns = left_columns < CELL_COLUMNS ? left_columns : CELL_COLUMNS;
            develop_cell(pass, &(Cell){row, column, top, left, rows, columns});
        }
    }
}

/* Whether no well overflows, so that a pass goes on through that stage: by the brightest light of
 * the pass, where its stages before mix light, or multiply it by known factors. */
static int is_without_overflow(const Pass *pass, const ImageStage *overflow) {
    const ImageStage *first = pass->stage ? pass->stage : pass->points;
    float high = 0.0f;
    if (pass->is_first || first == overflow || first->kind < STAGE_COVER ||
        first->kind > STAGE_MAGNIFY || !(first->spill[0] > 0.0f))
        return 0;
    for (const ImageStage *stage = pass->points; stage < overflow; stage++) {
        if (stage->kind != STAGE_GAIN && stage->kind != STAGE_COVER)
            return 0;
        if (stage->kind == STAGE_COVER)
            high = fmaxf(high, stage->numbers[0] * pass->mean_luminance);
    }
    for (int cell = 0; cell < pass->cell_rows * pass->cell_columns; cell++)
        high = fmaxf(high, pass->ranges[cell].high);
    /* Weights of a mean may sum to a little more than 1. */
    if (!(first->spill[0] * high <= 0.9999f))
        return 0;
    size_t cells = (size_t)pass->cell_rows * (size_t)pass->cell_columns;
    for (const ImageStage *stage = pass->job->stages; stage < overflow; stage++) {
        const uint8_t *overflows = changes_of(pass, stage)->own.maps.overflows;
        if (overflows && memchr(overflows, 1, cells))
            return 0;
    }
    return 1;
}

/* Choose the stages of a pass, from one on, and what the pass develops them for. */
static void plan_pass(const ImageJob *job, int first, int number, Pass *pass) {
    const ImageStage *end = job->stages + job->num_stages, *stage = job->stages + first;
    /* The first pass ends before a stage that needs more than a pixel; others begin with one. */
    pass->stage = number && reads_others(stage) ? stage : NULL;
    pass->points = pass->stage ? stage + 1 : stage;
    const ImageStage *next = pass->points + (number && !pass->stage);
    while (next < end && (!begins_pass(next) ||
                          (next->kind == STAGE_BLOOM && is_without_overflow(pass, next))))
        next++;
    pass->num_points = (int)(next - pass->points);
    pass->sums_luminance = next < end && needs_luminance(next);
    pass->target = next == end ? TO_PICTURE : next->kind == STAGE_BAYER ? TO_MOSAIC : TO_PLANES;
    /* Of light as it is a mean alone is missing. */
    if (!number && !pass->num_points && pass->sums_luminance)
        pass->target = TO_NOTHING;
}

static float sum_rows(const Pass *pass, int number) {
    double sum = 0.0;
    for (int row = 0; row < pass->cell_rows; row++)
        sum += pass->row_sums[number * pass->cell_rows + row];
    int32_t pixels = pass->job->mirror_pixels;
    return (float)(sum / (pixels > 0 ? pixels : 1));
}

/* Make what a pass developed the source of the next one. */
static void finish_pass(Pass *pass) {
    if (pass->sums_luminance)
        pass->mean_luminance = sum_rows(pass, 0);
    for (int i = 0; pass->sums_luminance && i < pass->job->num_stages; i++)
        pass->changes[i].mean_luminance = sum_rows(pass, 1 + i);
    if (pass->target != TO_PLANES)
        return;
    fill_rows_beyond(&pass->to);
    Planes from = pass->from;
    CellRange *ranges = pass->ranges;
    pass->from = pass->to, pass->ranges = pass->next_ranges;
    pass->to = from, pass->next_ranges = ranges;
}

/* Relative times of stages on whole images: tests/measurements/image_chain.py. */
static double relative_time(const ImageStage *stage) {
    switch (stage->kind) {
    case STAGE_BLUR:
        return 6.0;
    case STAGE_WARP:
    case STAGE_MAGNIFY:
    case STAGE_SHOT_NOISE:
    case STAGE_READ_NOISE:
        return 3.0;
    default:
        return 1.0;
    }
}

static int is_before_mosaic(const ImageJob *job, const ImageStage *stage) {
    for (const ImageStage *next = stage + 1; next < job->stages + job->num_stages; next++)
        if (next->kind == STAGE_BAYER)
            return 1;
    return 0;
}

/* Whether light of a stage reaches the wells pixel by pixel: where it overflows is known. */
static int is_before_overflow(const ImageJob *job, const ImageStage *stage) {
    const ImageStage *next = find_exposure(job, stage) + 1, *end = job->stages + job->num_stages;
    while (next < end && !reads_others(next) && next->kind != STAGE_GLARE)
        next++;
    return stage->spill[1] > 0.0f && next < end && next->kind == STAGE_BLOOM;
}

/* The next part of some memory; with none of it only its size counts. */
static void *take_memory(char *memory, size_t *taken, size_t bytes) {
    void *part = memory ? memory + *taken : NULL;
    *taken += (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    return part;
}

/* Bytes of the maps that measures need, with those to be zero first; their places, with memory. */
static size_t lay_out_maps(const Pass *pass, char *memory, size_t *zeros) {
    const ImageJob *job = pass->job;
    size_t taken = 0, cells = (size_t)pass->cell_rows * (size_t)pass->cell_columns;
    size_t bits = sizeof(uint16_t) * (size_t)job->height * (size_t)pass->cell_columns;
    Changes unused, *changes;
    for (int i = 0; i < job->num_stages; i++) {
        const ImageStage *stage = job->stages + i;
        changes = memory ? pass->changes + i : &unused;
        changes->own.maps.cell_columns = changes->other.maps.cell_columns = pass->cell_columns;
        if (stage->limits.max_change < 0.0f)
            continue;
        if (is_before_overflow(job, stage))
            changes->own.maps.overflows = take_memory(memory, &taken, cells);
        if (is_before_mosaic(job, stage))
            changes->own.maps.visible = take_memory(memory, &taken, bits);
        if (is_before_mosaic(job, stage) && stage->kind == STAGE_BLUR && stage->maps[3])
            changes->other.maps.visible = take_memory(memory, &taken, bits);
    }
    *zeros = taken;
    for (int i = 0; i < job->num_stages; i++) {
        changes = memory ? pass->changes + i : &unused;
        if (job->stages[i].limits.max_change >= 0.0f && is_before_overflow(job, job->stages + i))
            changes->own.maps.excess =
                take_memory(memory, &taken, sizeof(float) * cells * CELL_ROWS * CELL_COLUMNS);
    }
    return taken;
}

/* A row's bits of some columns, with those beside: words of 16 pixels. */
static uint32_t widen(const uint16_t *row, int column, int columns, uint32_t which) {
    uint32_t own = row[column] & which, left = column ? row[column - 1] & which : 0;
    uint32_t right = column + 1 < columns ? row[column + 1] & which : 0;
    return (own | own << 1 | own >> 1 | left >> 15 | right << 15) & 0xffffu;
}

/* Pixels behind a mosaic that the visible ones before reach: green ones their neighbours in row and
 * column, red and blue ones all eight. */
static int count_behind_mosaic(const ImageJob *job, const ChangeMaps *maps) {
    int columns = maps->cell_columns, pixels = 0;
    for (int y = 0; y < job->height; y++)
        for (int column = 0; column < columns; column++) {
            const uint16_t *own = maps->visible + (size_t)y * (size_t)columns;
            uint32_t reached = widen(own, column, columns, 0xffffu);
            for (int other = y - 1; other <= y + 1; other += 2) {
                if (other < 0 || other >= job->height)
                    continue;
                const uint16_t *row = maps->visible + (size_t)other * (size_t)columns;
                uint32_t coloured = other & 1 ? 0xaaaau : 0x5555u;
                reached |= row[column] | widen(row, column, columns, coloured);
            }
            int left = job->width - column * CELL_COLUMNS;
            pixels += __builtin_popcount(left < CELL_COLUMNS ? reached & ((1u << left) - 1)
                                                             : reached);
        }
    return pixels;
}

static PixelChange read_change(const ImageJob *job, const ImageStage *stage,
                               ChangeMeasure *measure, float spilt) {
    if (spilt > 0.0f)
        raise_largest(measure, fminf(read_largest(measure) + spilt, 255.0f));
    int is_spread = measure->maps.visible && is_counted(measure, &stage->limits);
    if (is_spread && atomic_load(&measure->num_visible))
        atomic_store(&measure->num_visible, count_behind_mosaic(job, &measure->maps));
    return conclude_change(measure, &stage->limits, job->width * job->height);
}

static void read_changes(const Pass *pass) {
    const ImageJob *job = pass->job;
    for (int i = 0; i < job->num_stages; i++) {
        ImageStage *stage = job->stages + i;
        Changes *changes = pass->changes + i;
        stage->change = read_change(job, stage, &changes->own, read_largest(&changes->spilt));
        stage->other_change = read_change(job, stage, &changes->other, 0.0f);
    }
}

/* Times of a pass's stages. They share its time by their relative times; the change of the layout
 * and the encoding count like a gain: that part is returned. */
static double finish_stages(ImageJob *job, const Pass *pass, double ms) {
    ImageStage *first = job->stages + ((pass->stage ? pass->stage : pass->points) - job->stages);
    ImageStage *end = job->stages + (pass->points - job->stages) + pass->num_points;
    double layout = pass->is_first || pass->target == TO_PICTURE ? 1.0 : 0.0, sum = layout;
    for (ImageStage *stage = first; stage < end; stage++)
        sum += relative_time(stage);
    for (ImageStage *stage = first; stage < end; stage++) {
        stage->ms = ms * relative_time(stage) / sum;
        ChangeMeasure *own = &changes_of(pass, stage)->own;
        /* Not all cells of this mosaic were compared: it is seen, but not how much. */
        if (stage->kind == STAGE_BAYER && pass->before->num_points &&
            !is_counted(own, &stage->limits))
            raise_largest(own, INFINITY);
    }
    return sum > 0.0 ? ms * layout / sum : 0.0;
}

static Planes lay_out(const ImageJob *job, int reach) {
    int columns = (job->width + CELL_COLUMNS - 1) / CELL_COLUMNS * CELL_COLUMNS;
    Planes planes = {.width = job->width, .height = job->height, .rows_beyond = reach};
    /* Whole vectors, so that rows of cells are aligned. */
    planes.border = (reach + CELL_COLUMNS - 1) / CELL_COLUMNS * CELL_COLUMNS;
    planes.border = planes.border > MIN_BORDER ? planes.border : MIN_BORDER;
    planes.stride = (size_t)(columns + 2 * planes.border);
    planes.plane = planes.stride * (size_t)(job->height + 2 * reach);
    return planes;
}

static int largest_reach(const ImageJob *job) {
    int reach = 0;
    for (int i = 0; i < job->num_stages; i++)
        if (job->stages[i].kind == STAGE_BLUR && job->stages[i].size > reach)
            reach = job->stages[i].size;
    return reach;
}

/* Bytes of scratch memory that the pass takes. */
static size_t lay_out_pass(const ImageJob *job, char *scratch, Pass *pass) {
    size_t taken = 0;
    *pass = (Pass){.job = job, .is_first = 1, .from = lay_out(job, largest_reach(job))};
    pass->to = pass->from;
    pass->mosaic = lay_out(job, 0);
    pass->cell_rows = (job->height + CELL_ROWS - 1) / CELL_ROWS;
    pass->cell_columns = (job->width + CELL_COLUMNS - 1) / CELL_COLUMNS;
    size_t rows = (size_t)pass->cell_rows, cells = rows * (size_t)pass->cell_columns;
    size_t plane_bytes = sizeof(float) * 3 * pass->from.plane;
    pass->from.values = take_memory(scratch, &taken, plane_bytes);
    pass->to.values = take_memory(scratch, &taken, plane_bytes);
    pass->mosaic.values = take_memory(scratch, &taken, sizeof(float) * pass->mosaic.plane);
    pass->ranges = take_memory(scratch, &taken, sizeof(CellRange) * cells);
    pass->next_ranges = take_memory(scratch, &taken, sizeof(CellRange) * cells);
    pass->row_sums =
        take_memory(scratch, &taken, sizeof(double) * rows * (size_t)(1 + job->num_stages));
    pass->changes = take_memory(scratch, &taken, sizeof(Changes) * (size_t)job->num_stages);
    pass->means = take_memory(scratch, &taken, glare_bytes(job));
    pass->maps = take_memory(scratch, &taken, lay_out_maps(pass, NULL, &pass->maps_bytes));
    return taken;
}

int64_t catoptra_image_scratch(const ImageJob *job) {
    Pass pass;
    return (int64_t)lay_out_pass(job, NULL, &pass);
}

/* Run a job's passes in laid out scratch memory, by all threads of a device, or by this one. */
static void run_passes(Device *device, ImageJob *job, Pass *pass) {
    Pass before;
    memset(pass->changes, 0, sizeof(Changes) * (size_t)job->num_stages);
    lay_out_maps(pass, pass->maps, &pass->maps_bytes);
    memset(pass->maps, 0, pass->maps_bytes);
    pass->before = &before;
    job->encode_ms = 0.0;
    for (int first = 0, number = 0; !number || first < job->num_stages; number++) {
        double begin_ms = now_ms();
        PassJob rows = {.pass = pass};
        plan_pass(job, first, number, pass);
        if (pass->num_points && pass->points->kind == STAGE_GLARE)
            scatter(pass);
        if (device)
            workers_run(device->workers, develop_rows, &rows);
        else
            develop_rows(&rows);
        finish_pass(pass);
        job->encode_ms += finish_stages(job, pass, now_ms() - begin_ms);
        before = *pass;
        before.changes = NULL;
        first = (int)(pass->points - job->stages) + pass->num_points;
        pass->is_first = pass->target == TO_NOTHING;
    }
}

/* Rows of a map, some bytes apart, one behind the other in further memory. */
static void *crop(const void *map, size_t stride, int rows, size_t bytes, char **memory) {
    char *begin = *memory;
    for (int row = 0; row < rows; row++, *memory += bytes)
        memcpy(*memory, (const char *)map + (size_t)row * stride, bytes);
    return begin;
}

/* The same of the part of planes of floats that a window shows. */
static void *crop_planes(const ImageJob *job, const Cell *window, const void *map, int planes,
                         char **memory) {
    size_t width = (size_t)job->width;
    size_t first = (size_t)window->top * width + (size_t)window->left;
    char *begin = *memory;
    for (size_t plane = 0; plane < (size_t)planes; plane++)
        crop((const float *)map + plane * width * (size_t)job->height + first,
             sizeof(float) * width, window->rows, sizeof(float) * (size_t)window->columns, memory);
    return begin;
}

/* A stage in a window of the picture, drawn everywhere; a gain by the mean of all is that of the
 * whole picture. */
static ImageStage crop_stage(const Pass *whole_pass, const Cell *window, const ImageStage *whole,
                             char **memory) {
    const ImageJob *job = whole_pass->job;
    ImageStage stage = *whole;
    const void **maps = stage.maps;
    stage.limits.max_change = -1.0f;
    if (stage.kind == STAGE_AUTO_GAIN) {
        stage.kind = STAGE_GAIN;
        stage.numbers[0] = stage.numbers[1] = stage.numbers[2] =
            find_auto_gain(whole, whole_pass->mean_luminance);
    }
    for (int i = 0; stage.kind == STAGE_WARP && i < 3; i++)
        maps[i] = crop_planes(job, window, maps[i], 1, memory);
    if (stage.kind == STAGE_GAIN && maps[0])
        maps[0] = crop_planes(job, window, maps[0], 1, memory);
    for (int i = 0; stage.kind == STAGE_PATTERN && i < 2; i++)
        maps[i] = crop_planes(job, window, maps[i], 3, memory);
    if (stage.kind == STAGE_MAGNIFY) {
        maps[0] = crop((const float *)maps[0] + window->left, sizeof(float) * (size_t)job->width, 2,
                       sizeof(float) * (size_t)window->columns, memory);
        maps[1] = crop((const float *)maps[1] + window->top, sizeof(float) * (size_t)job->height, 2,
                       sizeof(float) * (size_t)window->rows, memory);
    }
    if (stage.kind == STAGE_BLUR && stage.num_rows)
        maps[1] = crop_planes(job, window, maps[1], maps[3] ? 4 : 1, memory);
    if (stage.kind == STAGE_BLUR && maps[3])
        maps[3] = crop_planes(job, window, maps[3], 1, memory);
    if (stage.kind == STAGE_BLUR && maps[2]) {
        size_t beside = (size_t)(2 * stage.size + CELL_COLUMNS);
        size_t stride = (size_t)job->width + beside;
        const uint8_t *mask = maps[2];
        maps[2] = crop(mask + (size_t)window->top * stride + (size_t)window->left, stride,
                       window->rows + 2 * stage.size, (size_t)window->columns + beside, memory);
        *memory += -(uintptr_t)*memory % ALIGNMENT;
    }
    return stage;
}

/* Stages of which a window of the picture is enough, from the first one on, and how far they spread
 * light. */
typedef struct {
    const ImageStage *stages[MAX_LENS];
    int count, reach;
} Lens;

/* Of lens and sensor. What covers or scatters is left out, since it takes of a difference, and adds
 * light; so are noise, and the overflow of wells that are not full. */
static Lens find_lens(const ImageJob *job, int may_spill) {
    const unsigned left_out = 1u << STAGE_COVER | 1u << STAGE_GHOST | 1u << STAGE_GLARE |
                              1u << STAGE_QUANTISE | 1u << STAGE_SHOT_NOISE |
                              1u << STAGE_READ_NOISE | (may_spill ? 0 : 1u << STAGE_BLOOM);
    Lens lens = {.count = 0};
    for (int i = 0; i < job->num_stages && lens.count < MAX_LENS; i++) {
        const ImageStage *stage = job->stages + i;
        if (left_out >> stage->kind & 1)
            continue;
        lens.stages[lens.count++] = stage;
        lens.reach += stage->kind == STAGE_BAYER ? 1 : stage->size;
    }
    return lens;
}

static Cell clip_window(const ImageJob *job, int top, int left, int bottom, int right) {
    top = top > 0 ? top : 0, left = left > 0 ? left : 0;
    bottom = bottom < job->height ? bottom : job->height;
    right = right < job->width ? right : job->width;
    return (Cell){0, 0, top, left, bottom - top, right - left};
}

static int round_up(int value, int step) { return (value + step - 1) / step * step; }

/* Largest change between two lights behind a stage, of a window of the picture, in a part of it. */
static float compare_lights(const ImageStage *stage, const float *near, const float *far,
                            const Cell *window, const Cell *part) {
    ChangeMeasure found = {.maps = {0}};
    int right = part->left + part->columns;
    for (int row = part->top; row < part->top + part->rows; row++)
        for (int column = part->left; column < right; column += CELL_COLUMNS) {
            int count = right - column < CELL_COLUMNS ? right - column : CELL_COLUMNS;
            size_t first = (size_t)(row - window->top) * (size_t)window->columns +
                           (size_t)(column - window->left);
            CellValues one = {.planes = 3}, other = {.planes = 3};
            for (int x = 0; x < count; x++)
                for (int channel = 0; channel < 3; channel++) {
                    size_t at = 3 * (first + (size_t)x) + (size_t)channel;
                    one.values[channel][0][x] = near[at];
                    other.values[channel][0][x] = far[at];
                }
            measure_change(stage, &found, &other, &one, &(Cell){.rows = 1, .columns = count});
        }
    return read_largest(&found);
}

/* Whether any light of a window may reach beyond a well. */
static int may_overflow(const ImageJob *job, const Cell *window) {
    float high = 0.0f;
    for (int row = window->top; row < window->top + window->rows; row++) {
        const float *light = job->light + 3 * ((size_t)row * (size_t)job->width +
                                               (size_t)window->left);
        for (int i = 0; i < 3 * window->columns; i++)
            high = fmaxf(high, light[i]);
    }
    /* Weights of a mean may sum to a little more than 1. */
    return job->stages->spill[0] * high > 0.9999f;
}

/* A part of the picture with so many pixels around it, in whole cells or not. */
static Cell widen_part(const ImageJob *job, const Cell *part, int reach, int is_in_cells) {
    int rows = is_in_cells ? round_up(reach, CELL_ROWS) : reach;
    int columns = is_in_cells ? round_up(reach, CELL_COLUMNS) : reach;
    return clip_window(job, part->top - rows, part->left - columns, part->top + part->rows + rows,
                       part->left + part->columns + columns);
}

static Cell place_window(const ImageJob *job, const Lens *lens, const Cell *part) {
    return widen_part(job, part, 2 * lens->reach + job->stages->size, 1);
}

/* Largest change, behind lens and sensor, by what a first blur by range changes in a part of the
 * picture against the disc of infinity; infinite if memory is short. */
static float measure_behind_lens(const Pass *whole, float own, const Cell *part) {
    const ImageJob *job = whole->job;
    Lens lens = find_lens(job, 1);
    Cell window = place_window(job, &lens, part);
    if (!may_overflow(job, &window)) {
        lens = find_lens(job, 0);
        window = place_window(job, &lens, part);
    }
    if (lens.count < 2)
        return own;
    Cell changed = widen_part(job, part, lens.reach, 0);
    size_t pixels = (size_t)window.rows * (size_t)window.columns, size = 0;
    ImageStage stages[MAX_LENS];
    ImageJob small = {.width = window.columns, .height = window.rows, .num_stages = lens.count,
                      .stages = stages};
    for (int i = 0; i < lens.count; i++) {
        stages[i] = *lens.stages[i];
        size_t beside = 2 * (size_t)stages[i].size;
        size += 6 * sizeof(float) * pixels + ALIGNMENT +
                ((size_t)window.rows + beside) * ((size_t)window.columns + beside + CELL_COLUMNS);
    }
    size_t scratch = (size_t)catoptra_image_scratch(&small), picture = 3 * sizeof(float) * pixels;
    char *memory = aligned_alloc(ALIGNMENT, (scratch + 3 * picture + size) / ALIGNMENT * ALIGNMENT +
                                                ALIGNMENT);
    if (!memory)
        return INFINITY;
    float *near = (float *)(memory + scratch), *far = near + 3 * pixels;
    char *rest = (char *)(far + 3 * pixels);
    small.scratch = memory;
    small.light = crop(job->light + 3 * ((size_t)window.top * (size_t)job->width +
                                         (size_t)window.left),
                       3 * sizeof(float) * (size_t)job->width, window.rows,
                       3 * sizeof(float) * (size_t)window.columns, &rest);
    for (int i = 0; i < lens.count; i++)
        stages[i] = crop_stage(whole, &window, lens.stages[i], &rest);
    for (int is_far = 0; is_far < 2; is_far++) {
        float *ranges = (float *)stages[0].maps[3];
        Pass pass;
        for (size_t i = 0; is_far && i < pixels; i++)
            ranges[i] = INFINITY;
        small.linear = is_far ? far : near;
        lay_out_pass(&small, memory, &pass);
        run_passes(NULL, &small, &pass);
    }
    float largest = compare_lights(lens.stages[lens.count - 1], near, far, &window, &changed);
    free(memory);
    return largest;
}

/* Cells that are looked at together, at 0.4 to 1 ms of a thread; where so many blocks do not tell,
 * the change counts as large as before lens and sensor. */
enum { BLOCK_ROWS = 4, BLOCK_COLUMNS = 2, MAX_BLOCKS = 24, PILOT_BLOCKS = 8 };
/* From so many blocks on, those with the largest changes, others are taken to keep no more of
 * theirs than any of these did, times a reserve. Of 960 situations that leaves none out wrongly;
 * with four blocks it did in four (docs/EFFECTS.md). */
#define PILOT_RESERVE 1.5f
/* At rest what is measured here is what the picture changes by, within 1e-3. The light of motion is
 * within 2 levels of that of 64 sharp frames in 99 % of the pixels, 2 % of a contrast whose discs
 * differ by a level: changes are up to 2.2 % larger in that of 64 frames (docs/EFFECTS.md). */
#define LIGHT_RESERVE 1.03f

/* Decide on the changes that a first stage deferred, the largest ones first, by what is left of
 * them behind lens and sensor, until one is beyond its limit. */
static void decide_deferred(const Pass *pass) {
    const ImageStage *stage = pass->job->stages;
    ChangeMeasure *measure = &pass->changes->own;
    int cells = pass->cell_rows * pass->cell_columns;
    float kept = 0.0f;
    for (int tried = 0;; tried++) {
        int largest = 0;
        for (int cell = 0; cell < cells; cell++)
            largest = stage->deferred[cell] > stage->deferred[largest] ? cell : largest;
        float own = stage->deferred[largest];
        if (!(own > 0.0f))
            return;
        float rest = tried < PILOT_BLOCKS ? INFINITY : PILOT_RESERVE * kept * own;
        if (rest <= stage->limits.max_change || tried == MAX_BLOCKS) {
            raise_largest(measure, fminf(rest, own));
            return;
        }
        int row = largest / pass->cell_columns / BLOCK_ROWS * BLOCK_ROWS;
        int column = largest % pass->cell_columns / BLOCK_COLUMNS * BLOCK_COLUMNS;
        Cell part = {0, 0, row * CELL_ROWS, column * CELL_COLUMNS, BLOCK_ROWS * CELL_ROWS,
                     BLOCK_COLUMNS * CELL_COLUMNS};
        float change = LIGHT_RESERVE * measure_behind_lens(pass, own, &part);
        kept = fmaxf(kept, change / own);
        raise_largest(measure, change > stage->limits.max_change ? own : change);
        if (change > stage->limits.max_change)
            return;
        for (int i = row; i < row + BLOCK_ROWS && i < pass->cell_rows; i++)
            for (int k = column; k < column + BLOCK_COLUMNS && k < pass->cell_columns; k++)
                stage->deferred[i * pass->cell_columns + k] = 0.0f;
    }
}

void catoptra_change_image(Device *device, ImageJob *job) {
    Pass pass;
    lay_out_pass(job, job->scratch, &pass);
    run_passes(device, job, &pass);
    double begin_ms = now_ms();
    if (job->num_stages && job->stages->deferred) {
        decide_deferred(&pass);
        job->stages->ms += now_ms() - begin_ms;
    }
    read_changes(&pass);
}
