/* Provides blur of image_spread.h, by symmetric kernels: one for each colour, or one for each
 * pixel from a table of discs.
 * Float64 twin: effects/kernels/convolution.py. Owns nothing: planes are the job's scratch memory.
 * Threads: any thread of the pool, each for cells of its own.
 *
 * A kernel has one weight for each pair (i, j), 0 <= j <= i, of offsets: the (up to eight) pixels
 * that are i and j away along the axes share it. maps[0] has the weights: (3, pairs) where num_rows
 * is 0, else (num_rows, pairs), of which each pixel takes the linear mixture of two rows.
 * maps[1] is the row of each pixel, (h, w); or, with ranges in maps[3], the circle of confusion
 * (4, h, w) from which the row follows (circle_of_confusion); numbers[0] is the light that kernels
 * of neighbouring rows exchange at most. maps[2] is the mask, uint8, of pixels that take part:
 * weights of others go to the central pixel; NULL: all take part. Its edges are repeated, size
 * times to each side and 16 more at the right.
 */
#include "image_spread.h"

#include "image_change.h"

#include <math.h>
#include <string.h>

#define ROWS_PER_PX2 64.0f
#define MIN_DENOMINATOR 1e-6f

/* The kernels of a cell. */
typedef struct {
    Floats16 row[CELL_ROWS]; /* of the table, by pixel */
    int reach;               /* half width of the widest one */
    float exchange;          /* most light that a pixel takes from others */
    float apart;             /* most rows from others */
} CellKernels;

static int pair_count(int half_width) { return (half_width + 1) * (half_width + 2) / 2; }

static Floats16 row_of_diameter(Floats16 diameter) {
    return ROWS_PER_PX2 / 16.0f * diameter * diameter;
}

/* Rows of the table for the pixels of a cell; with ranges also those of the discs of infinity, and
 * how far they are apart. */
static void find_rows(const Pass *pass, const Cell *cell, CellKernels *kernels, CellKernels *far) {
    const ImageStage *stage = pass->stage;
    size_t plane = (size_t)pass->job->width * (size_t)pass->job->height;
    Floats16 last = splat16((float)(stage->num_rows - 1)), apart = {0};
    for (int row = 0; row < cell->rows; row++) {
        size_t first = place_in_map(pass, cell, row);
        Floats16 circle[4];
        for (size_t i = 0; i < (stage->maps[3] ? 4 : 1); i++)
            circle[i] = load_map(stage->maps[1], i * plane + first, cell->columns);
        kernels->row[row] = least16(circle[0], last);
        if (!stage->maps[3])
            continue;
        Floats16 ranges = load_map(stage->maps[3], first, cell->columns);
        Floats16 denominators =
            most16(circle[2] * ranges + circle[3], splat16(MIN_DENOMINATOR));
        Floats16 near = circle[0] + circle[1] / denominators;
        kernels->row[row] = least16(row_of_diameter(near), last);
        far->row[row] = least16(row_of_diameter(circle[0]), last);
        apart = most16(absolute16(kernels->row[row] - far->row[row]), apart);
    }
    far->apart = most_of16(apart);
}

static float largest_row(const Cell *cell, const CellKernels *kernels) {
    Floats16 largest = {0};
    for (int row = 0; row < cell->rows; row++)
        largest = most16(kernels->row[row], largest);
    return most_of16(largest);
}

/* Half width and light from others of the kernels up to a row; wider discs have all that narrower
 * ones have. */
static void find_reach(const ImageStage *stage, float row, CellKernels *kernels) {
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
    kernels->reach = reach;
    kernels->exchange = 1.0f - table[(size_t)last * (size_t)pairs];
}

static void find_colour_reach(const ImageStage *stage, CellKernels *kernels) {
    int pairs = pair_count(stage->size);
    const float *weights = stage->maps[0];
    kernels->reach = stage->size;
    kernels->exchange = 0.0f;
    for (int channel = 0; channel < 3; channel++) {
        float others = 1.0f - weights[(size_t)channel * (size_t)pairs];
        kernels->exchange = others > kernels->exchange ? others : kernels->exchange;
    }
}

/* Place of 16 pixels between two rows of the table: pixels nearby mostly lie between the same. */
typedef struct {
    Floats16 fraction;
    int count;
    const float *rows[CELL_COLUMNS]; /* weights of the row below, of the pixels of each mask */
    Ints16 masks[CELL_COLUMNS];
} TablePlace;

static TablePlace place_in_table(const ImageStage *stage, Floats16 rows) {
    int pairs = pair_count(stage->size), last = stage->num_rows - 2;
    Ints16 below = __builtin_convertvector(least16(rows, splat16((float)last)), Ints16);
    TablePlace place = {.fraction = rows - __builtin_convertvector(below, Floats16)};
    for (uint32_t rest = 0xffffu; rest; place.count++) {
        int row = below[__builtin_ctz(rest)];
        place.rows[place.count] = (const float *)stage->maps[0] + row * pairs;
        place.masks[place.count] = below == row;
        rest &= ~bits16(below == row);
    }
    return place;
}

/* Weights of one pair for 16 pixels. */
static Floats16 mix_weights(const TablePlace *place, int pairs, int pair) {
    Floats16 mixed = {0};
    for (int i = 0; i < place->count; i++) {
        float lower = place->rows[i][pair], upper = place->rows[i][pairs + pair];
        mixed = select16(place->masks[i], lower + place->fraction * (upper - lower), mixed);
    }
    return mixed;
}

/* What the sums of a cell's row read: a colour, with a mask where it is 1 alone; or the mask. */
typedef struct {
    const float *light;  /* of the row's first pixel; NULL: 1 */
    const uint8_t *mask; /* of the same pixel; NULL: all take part */
    ptrdiff_t stride, mask_stride;
} BlurSource;

/* Inlined with and without a mask. */
#define ALWAYS_INLINE static inline __attribute__((always_inline))

ALWAYS_INLINE Floats16 read_shifted(const BlurSource *source, ptrdiff_t dx, ptrdiff_t dy) {
    typedef uint8_t Bytes16 __attribute__((vector_size(16)));
    Floats16 light = splat16(1.0f);
    Bytes16 mask;
    if (source->light)
        light = load16(source->light + dy * source->stride + dx);
    if (!source->mask)
        return light;
    memcpy(&mask, source->mask + dy * source->mask_stride + dx, sizeof mask);
    return select16(__builtin_convertvector(mask, Ints16) != 0, light, splat16(0.0f));
}

ALWAYS_INLINE Floats16 sum_shifts(const BlurSource *source, int i, int j) {
    if (j == 0)
        return read_shifted(source, -i, 0) + read_shifted(source, i, 0);
    return (read_shifted(source, -i, -j) + read_shifted(source, i, -j)) +
           (read_shifted(source, -i, j) + read_shifted(source, i, j));
}

/* Sums of the pixels that share the weight of a pair. */
ALWAYS_INLINE Floats16 sum_pair(const BlurSource *source, int i, int j) {
    if (i == 0)
        return read_shifted(source, 0, 0);
    Floats16 sums = sum_shifts(source, i, j);
    if (j == 0)
        return sums + (read_shifted(source, 0, -i) + read_shifted(source, 0, i));
    return i == j ? sums : sums + sum_shifts(source, j, i);
}

/* Sums of a cell's row by all weights, of `count` sources, for one or two sets of kernels. */
ALWAYS_INLINE void sum_row(const ImageStage *stage, int sets, const Floats16 *rows, int reach,
                           int count, const BlurSource *sources, Floats16 totals[2][4]) {
    int pairs = pair_count(stage->size), pair = 0;
    TablePlace places[2];
    for (int set = 0; set < sets; set++) {
        if (stage->num_rows)
            places[set] = place_in_table(stage, rows[set]);
        for (int source = 0; source < count; source++)
            totals[set][source] = splat16(0.0f);
    }
    for (int i = 0; i <= reach; i++)
        for (int j = 0; j <= i; j++, pair++) {
            Floats16 weights[2];
            for (int set = 0; set < sets && stage->num_rows; set++)
                weights[set] = mix_weights(places + set, pairs, pair);
            for (int source = 0; source < count; source++) {
                Floats16 sums = sum_pair(sources + source, i, j);
                if (!stage->num_rows)
                    weights[0] = splat16(((const float *)stage->maps[0])[source * pairs + pair]);
                for (int set = 0; set < sets; set++)
                    totals[set][source] += weights[set] * sums;
            }
        }
}

static void blur_row(const ImageStage *stage, int sets, const Floats16 *rows, int reach,
                     const BlurSource *sources, Floats16 totals[2][4]) {
    BlurSource colours[3];
    for (int channel = 0; channel < 3; channel++)
        colours[channel] = (BlurSource){.light = sources[channel].light,
                                        .stride = sources[channel].stride};
    if (sets == 1)
        sum_row(stage, 1, rows, reach, 3, colours, totals);
    else
        sum_row(stage, 2, rows, reach, 3, colours, totals);
}

/* The mask is summed like a colour: what is missing in its sum of weights goes to the central
 * pixel. */
static void blur_masked_row(const ImageStage *stage, int sets, const Floats16 *rows, int reach,
                            const BlurSource *sources, Floats16 totals[2][4]) {
    sum_row(stage, sets, rows, reach, 4, sources, totals);
    Ints16 takes_part = read_shifted(sources + 3, 0, 0) != 0.0f;
    for (int set = 0; set < sets; set++)
        for (int channel = 0; channel < 3; channel++) {
            Floats16 own = load16(sources[channel].light);
            Floats16 blurred = totals[set][channel] + (1.0f - totals[set][3]) * own;
            totals[set][channel] = select16(takes_part, blurred, own);
        }
}

static ptrdiff_t mask_stride(const Pass *pass) {
    return pass->job->width + 2 * pass->stage->size + CELL_COLUMNS;
}

static const uint8_t *mask_at(const Pass *pass, int row, int column) {
    const ImageStage *stage = pass->stage;
    return (const uint8_t *)stage->maps[2] + (row + stage->size) * mask_stride(pass) +
           (stage->size + column);
}

static int is_masked(const Pass *pass, const Cell *cell, int reach) {
    size_t columns = (size_t)(cell->columns + 2 * reach);
    if (!pass->stage->maps[2])
        return 0;
    for (int row = cell->top - reach; row < cell->top + cell->rows + reach; row++)
        if (memchr(mask_at(pass, row, cell->left - reach), 0, columns))
            return 1;
    return 0;
}

/* A cell by its kernels, and by others where these are given. */
static void blur_cell(const Pass *pass, const Cell *cell, const CellKernels *kernels,
                      const CellKernels *others, int reach, CellValues *to, CellValues *by_others) {
    int masked = is_masked(pass, cell, reach);
    for (int row = 0; row < cell->rows; row++) {
        BlurSource sources[4] = {{0}};
        Floats16 totals[2][4], rows[2] = {kernels->row[row]};
        if (others)
            rows[1] = others->row[row];
        for (int i = 0; i < 4; i++) {
            if (i < 3) {
                sources[i].light = row_at(&pass->from, i, cell->top + row) + cell->left;
                FETCH_AHEAD(sources[i].light, 0);
            }
            if (masked)
                sources[i].mask = mask_at(pass, cell->top + row, cell->left);
            sources[i].stride = (ptrdiff_t)pass->from.stride;
            sources[i].mask_stride = mask_stride(pass);
        }
        (masked ? blur_masked_row : blur_row)(pass->stage, others ? 2 : 1, rows, reach, sources,
                                              totals);
        for (int channel = 0; channel < 3; channel++) {
            store16(totals[0][channel], to->values[channel][row]);
            if (others)
                store16(totals[1][channel], by_others->values[channel][row]);
        }
    }
}

/* Largest change of a mean of pixels over that of one of these, in the dark: twin, with the proof,
 * effects/__init__.py:COUNTED_LEVELS. */
#define MEAN_CHANGE 1.3215f

/* Note the change of a cell, or that it is to be found behind the stages that follow. */
static void measure_or_defer(const Pass *pass, const Cell *cell, const CellValues *before,
                             const CellValues *after) {
    const ImageStage *stage = pass->stage;
    ChangeMeasure *own = &changes_of(pass, stage)->own;
    if (!stage->deferred) {
        measure_change(stage, own, before, after, cell);
        return;
    }
    ChangeMeasure alone = {.maps = own->maps};
    measure_change(stage, &alone, before, after, cell);
    float most = MEAN_CHANGE * read_largest(&alone);
    atomic_store(&alone.largest, 0);
    add_measure(own, &alone);
    if (most > stage->limits.max_change)
        stage->deferred[cell->row * pass->cell_columns + cell->column] = most;
    else
        raise_largest(own, most);
}

void blur(const Pass *pass, const Cell *cell, CellValues *to) {
    const ImageStage *stage = pass->stage;
    CellKernels kernels, far = {.reach = 0, .exchange = 0.0f};
    CellRange range = find_range_around(pass, cell, stage->size);
    int is_compared = stage->maps[3] && is_measured(pass, stage);
    if (range.low == range.high) {
        load_cell(pass, cell, to);
        return;
    }
    if (stage->num_rows) {
        find_rows(pass, cell, &kernels, &far);
        find_reach(stage, largest_row(cell, &kernels), &kernels);
    } else {
        find_colour_reach(stage, &kernels);
    }
    if (is_compared)
        find_reach(stage, largest_row(cell, &far), &far);
    int reach = kernels.reach > far.reach ? kernels.reach : far.reach;
    range = find_range_around(pass, cell, reach);
    float bound = INFINITY;
    if (is_plain(pass, cell, range, fmaxf(kernels.exchange, far.exchange), &bound)) {
        load_cell(pass, cell, to);
        return;
    }
    if (!is_compared) {
        blur_cell(pass, cell, &kernels, NULL, reach, to, NULL);
        measure_cell(pass, cell, bound, to);
        return;
    }
    /* With ranges the change that counts is that against the disc of infinity, which another effect
     * stands for. The change against the image before is the other one. */
    CellValues values;
    Changes *changes = changes_of(pass, stage);
    float own = bound;
    if (bound < INFINITY) {
        float light = stage->numbers[0] * far.apart * (range.high - range.low);
        own = fminf(bound, bound_change(stage, (LightChange){range.low, range.high, light}));
    }
    int may_differ = may_tell(stage, &changes->own, own);
    blur_cell(pass, cell, &kernels, may_differ ? &far : NULL, reach, to, &values);
    if (may_differ)
        measure_or_defer(pass, cell, &values, to);
    if (!may_tell(stage, &changes->other, bound))
        return;
    load_cell(pass, cell, &values);
    measure_change(stage, &changes->other, &values, to, cell);
}
