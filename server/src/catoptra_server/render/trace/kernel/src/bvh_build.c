/* Provides bvh.h: the build, from the top down by the surface area heuristic in bins (Wald, "On
 * fast Construction of SAH-based Bounding Volume Hierarchies", 2007), eight children at once.
 * No twin. A hierarchy owns its nodes and leaves, from build_bvh to free_bvh.
 * Threads: the pool's; each takes subtrees that nobody else has. Which node lies where in memory
 * depends on them, which boxes there are does not. */
#define _GNU_SOURCE
#include "bvh.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

/* Least x, y, z and, negative, most x, y, z, each with a number that is not used: a box is widened
 * by one minimum. */
typedef Floats8 Bounds;

enum { MAX_BINS = 16, FEW_BINS = 8, FEW_BOXES = 64 };
/* Subtrees from this size on are handed to whichever thread is free. */
enum { SHARED_BOXES = 4096, LEAVES_AT_ONCE = 1024 };
/* Of the nodes that there may be, one in so many is made of most meshes. */
enum { LARGE_PAGE = 1 << 21, USUAL_NODES = 8 };
/* From this depth on halves, so that no input makes the stacks of the queries overflow: 2^31
 * boxes are 11 levels more. */
enum { DEEPEST_HEURISTIC = MAX_DEPTH - 12 };
/* Centres that lie closer are one: the bins of a shorter range have no finite number to a metre. */
#define LEAST_SIZE 1e-36f

/* Boxes that lie together, in an order that is still open. */
typedef struct {
    int32_t first, count, depth;
    int32_t has_no_copies; /* known so: of two equal triangles one was left out */
    Bounds bounds, centres; /* of the boxes, and of twice their centres */
} Range;

typedef struct {
    Range range;
    int32_t node;
} Subtree;

typedef struct {
    int32_t first, count;
} LeafRange;

typedef struct {
    ItemBox *boxes;
    BvhNode *nodes;
    LeafRange *leaves; /* NULL: leaves are single boxes, named by their items */
    int32_t leaf_size;
    atomic_int num_nodes, num_leaves;
    pthread_mutex_t lock; /* guards the list of subtrees that wait for a thread */
    pthread_cond_t changed;
    Subtree *waiting; /* NULL: one thread builds */
    int num_waiting, unfinished;
    float padding; /* of the boxes, to all sides */
    const float *corners;
    const double *fine_corners; /* NULL without */
    BvhLeaf *filled;
    FineLeaf *finely_filled;
    atomic_int next_leaf;
} Build;

static inline Bounds no_bounds(void) { return splat8(INFINITY); }

static inline Bounds box_bounds(const ItemBox *box) {
    const Ints8 signs = {0, 0, 0, 0, INT32_MIN, INT32_MIN, INT32_MIN};
    return (Floats8)((Ints8)load8(box->least) ^ signs);
}

static inline void widen(Bounds *bounds, Bounds other) {
#if defined(__AVX__)
    /* By name: a masked store, which compilers make of a selection, delays the next load. */
    *bounds = (Bounds)_mm256_min_ps((__m256)other, (__m256)*bounds);
#else
    *bounds = least8(other, *bounds);
#endif
}

static inline Floats4 twice_centre(const ItemBox *box) {
    return load4(box->least) + load4(box->most);
}

static inline Bounds point_bounds(Floats4 point) {
    return __builtin_shufflevector(point, -point, 0, 1, 2, 3, 4, 5, 6, 7);
}

static inline float bounds_size(Bounds bounds, int axis) {
    return -bounds[4 + axis] - bounds[axis];
}

static float half_area(const Bounds *bounds) {
    float x = bounds_size(*bounds, 0), y = bounds_size(*bounds, 1), z = bounds_size(*bounds, 2);
    return x < 0.0f ? 0.0f : x * y + y * z + z * x;
}

static int compare_corners(const Build *build, int32_t a, int32_t b) {
    size_t i = 9 * (size_t)a, j = 9 * (size_t)b;
    return build->fine_corners
               ? memcmp(build->fine_corners + i, build->fine_corners + j, 9 * sizeof(double))
               : memcmp(build->corners + i, build->corners + j, 9 * sizeof(float));
}

static int compare_triangles(const void *first, const void *second, void *build) {
    const ItemBox *a = first, *b = second;
    int order = compare_corners(build, a->item, b->item);
    return order ? order : (a->item > b->item) - (a->item < b->item);
}

/* Triangles in one place cannot be divided, and a ray meets all: the first of equal ones stays. */
static void drop_copies(const Build *build, Range *range) {
    if (range->has_no_copies || !build->corners || range->count <= build->leaf_size)
        return;
    for (int axis = 0; axis < 3; axis++)
        if (bounds_size(range->centres, axis) > LEAST_SIZE)
            return;
    ItemBox *boxes = build->boxes + range->first;
    qsort_r(boxes, (size_t)range->count, sizeof *boxes, compare_triangles, (void *)build);
    int32_t kept = 1;
    for (int32_t i = 1; i < range->count; i++)
        if (compare_corners(build, boxes[kept - 1].item, boxes[i].item))
            boxes[kept++] = boxes[i];
    range->count = kept;
    range->has_no_copies = 1;
}

static inline void widen_range(Range *range, const ItemBox *box) {
    widen(&range->bounds, box_bounds(box));
    widen(&range->centres, point_bounds(twice_centre(box)));
}

static void measure_range(const ItemBox *boxes, Range *range) {
    range->bounds = range->centres = no_bounds();
    for (int32_t i = range->first; i < range->first + range->count; i++)
        widen_range(range, &boxes[i]);
}

/* Where a range is divided: boxes up to a bin of an axis. */
typedef struct {
    int axis, bin;
    float cost; /* infinite where no plane divides the centres */
    Floats4 origin, scale; /* bin of a centre: (centre - origin) scale */
} Division;

static inline Ints4 find_bins(const Division *division, const ItemBox *box) {
    return __builtin_convertvector((twice_centre(box) - division->origin) * division->scale, Ints4);
}

typedef struct {
    Bounds bounds[3][MAX_BINS];
    int32_t count[3][MAX_BINS];
} Bins;

static void fill_bins(const ItemBox *boxes, const Range *range, const Division *division,
                      int num_bins, Bins *bins) {
    for (int axis = 0; axis < 3; axis++)
        for (int bin = 0; bin < num_bins; bin++) {
            bins->bounds[axis][bin] = no_bounds();
            bins->count[axis][bin] = 0;
        }
    for (int32_t i = range->first; i < range->first + range->count; i++) {
        Bounds bounds = box_bounds(&boxes[i]);
        Ints4 bin = find_bins(division, &boxes[i]);
        for (int axis = 0; axis < 3; axis++) {
            widen(&bins->bounds[axis][bin[axis]], bounds);
            bins->count[axis][bin[axis]]++;
        }
    }
}

/* Rays that meet a half, times the leaves that they meet there: half full, as they come out. */
static float half_cost(const Bounds *bounds, int32_t count, int32_t leaf_size) {
    enum { HALF = LEAF_TRIANGLES / 2 }; /* known here: a division in one step */
    return half_area(bounds) * (float)(leaf_size > 1 ? (count + HALF - 1) / HALF : count);
}

static void sweep_axis(const Bins *bins, int axis, int num_bins, int32_t leaf_size,
                       Division *best) {
    float after[MAX_BINS];
    Bounds bounds = no_bounds();
    int32_t count = 0;
    for (int bin = num_bins - 1; bin > 0; bin--) {
        widen(&bounds, bins->bounds[axis][bin]);
        count += bins->count[axis][bin];
        after[bin] = count ? half_cost(&bounds, count, leaf_size) : INFINITY;
    }
    bounds = no_bounds();
    count = 0;
    for (int bin = 0; bin < num_bins - 1; bin++) {
        widen(&bounds, bins->bounds[axis][bin]);
        count += bins->count[axis][bin];
        float cost = half_cost(&bounds, count, leaf_size) + after[bin + 1];
        if (count && cost < best->cost) {
            best->cost = cost;
            best->axis = axis;
            best->bin = bin;
        }
    }
}

static Division choose_division(const Build *build, const Range *range) {
    int num_bins = range->count < FEW_BOXES ? FEW_BINS : MAX_BINS;
    Division best = {.cost = INFINITY};
    for (int axis = 0; axis < 3; axis++) {
        float size = bounds_size(range->centres, axis);
        best.origin[axis] = range->centres[axis];
        /* A little less than all bins: the last centre belongs to the last bin. */
        best.scale[axis] = size > LEAST_SIZE ? (float)num_bins * 0.9999f / size : 0.0f;
    }
    Bins bins;
    fill_bins(build->boxes, range, &best, num_bins, &bins);
    for (int axis = 0; axis < 3; axis++)
        if (best.scale[axis] > 0.0f)
            sweep_axis(&bins, axis, num_bins, build->leaf_size, &best);
    return best;
}

/* Bring the boxes before a division to the front, and measure both parts. */
static void partition(ItemBox *boxes, const Division *division, Range *range, Range *rest) {
    int32_t front = range->first, back = front + range->count, end = back;
    Range before = *range, behind = *rest;
    before.bounds = before.centres = behind.bounds = behind.centres = no_bounds();
    while (front < back) {
        ItemBox box = boxes[front];
        if (find_bins(division, &box)[division->axis] <= division->bin) {
            widen_range(&before, &box);
            front++;
        } else {
            widen_range(&behind, &box);
            boxes[front] = boxes[--back];
            boxes[back] = box;
        }
    }
    before.count = front - before.first;
    behind.first = front;
    behind.count = end - front;
    *range = before;
    *rest = behind;
}

static void divide_range(const Build *build, Range *range, Range *rest) {
    Division division = {.cost = INFINITY};
    if (range->depth < DEEPEST_HEURISTIC)
        division = choose_division(build, range);
    *rest = *range;
    if (division.cost < INFINITY) {
        partition(build->boxes, &division, range, rest);
    } else {
        /* Boxes with one centre: no division is better than another. */
        range->count /= 2;
        rest->first += range->count;
        rest->count -= range->count;
        measure_range(build->boxes, range);
        measure_range(build->boxes, rest);
    }
    drop_copies(build, range);
    drop_copies(build, rest);
}

/* The largest part that is no leaf yet; -1 without. Where halves are taken, the fullest. */
static int choose_part(const Build *build, const Range *parts, int count) {
    int chosen = -1;
    float largest = -1.0f;
    for (int i = 0; i < count; i++) {
        float size = parts[i].depth < DEEPEST_HEURISTIC ? half_area(&parts[i].bounds)
                                                        : (float)parts[i].count;
        if (parts[i].count > build->leaf_size && size > largest) {
            largest = size;
            chosen = i;
        }
    }
    return chosen;
}

static int32_t make_leaf(Build *build, const Range *range) {
    if (!build->leaves)
        return ~build->boxes[range->first].item;
    int32_t leaf = atomic_fetch_add(&build->num_leaves, 1);
    build->leaves[leaf] = (LeafRange){range->first, range->count};
    return ~leaf;
}

static void set_child(const Build *build, BvhNode *node, int slot, const Range *range) {
    for (int axis = 0; axis < 3; axis++) {
        node->bounds[axis][slot] = range ? range->bounds[axis] - build->padding : INFINITY;
        node->bounds[3 + axis][slot] =
            range ? -range->bounds[4 + axis] + build->padding : -INFINITY;
    }
}

static void hand_over(Build *build, const Subtree *subtree) {
    pthread_mutex_lock(&build->lock);
    build->waiting[build->num_waiting++] = *subtree;
    build->unfinished++;
    pthread_cond_signal(&build->changed);
    pthread_mutex_unlock(&build->lock);
}

static void build_subtree(Build *build, const Subtree *subtree) {
    Range parts[LANES];
    int count = 1, chosen, inner = 0;
    parts[0] = subtree->range;
    parts[0].depth++;
    while (count < LANES && (chosen = choose_part(build, parts, count)) >= 0) {
        divide_range(build, &parts[chosen], &parts[count]);
        count++;
    }
    BvhNode *node = build->nodes + subtree->node;
    for (int i = 0; i < LANES; i++)
        set_child(build, node, i, i < count ? &parts[i] : NULL);
    for (int i = 0; i < count; i++)
        inner += parts[i].count > build->leaf_size;
    int32_t next = atomic_fetch_add(&build->num_nodes, inner);
    for (int i = 0; i < LANES; i++)
        node->child[i] = i >= count                          ? NO_CHILD
                         : parts[i].count > build->leaf_size ? next++
                                                             : make_leaf(build, &parts[i]);
    for (int i = 0; i < count; i++) {
        if (parts[i].count <= build->leaf_size)
            continue;
        Subtree part = {parts[i], node->child[i]};
        if (build->waiting && part.range.count >= SHARED_BOXES)
            hand_over(build, &part);
        else
            build_subtree(build, &part);
    }
}

/* Threads without work sleep: others of the process prepare the same scene. */
static void build_subtrees(void *argument) {
    Build *build = argument;
    pthread_mutex_lock(&build->lock);
    while (build->unfinished > 0) {
        if (build->num_waiting == 0) {
            pthread_cond_wait(&build->changed, &build->lock);
            continue;
        }
        Subtree subtree = build->waiting[--build->num_waiting];
        pthread_mutex_unlock(&build->lock);
        build_subtree(build, &subtree);
        pthread_mutex_lock(&build->lock);
        if (--build->unfinished == 0)
            pthread_cond_broadcast(&build->changed);
    }
    pthread_mutex_unlock(&build->lock);
}

static float squared_length(const float *from, const float *to) {
    float sum = 0.0f;
    for (int axis = 0; axis < 3; axis++)
        sum += (to[axis] - from[axis]) * (to[axis] - from[axis]);
    return sum;
}

/* The corner of a triangle's two shorter edges, on which the queries base its normal: that of a
 * sliver's long edges is rounding alone. */
static int find_base(const float *corners) {
    float length[3];
    for (int i = 0; i < 3; i++)
        length[i] = squared_length(corners + 3 * ((i + 1) % 3), corners + 3 * ((i + 2) % 3));
    return length[0] >= length[1] && length[0] >= length[2] ? 0 : length[1] >= length[2] ? 1 : 2;
}

static void fill_lane(const Build *build, int32_t leaf, int lane, int32_t triangle) {
    size_t at = 9 * (size_t)(triangle == NO_TRIANGLE ? 0 : triangle);
    int base = find_base(build->corners + at), is_unused = triangle == NO_TRIANGLE;
    for (int i = 0; i < 9; i++) {
        size_t from = at + (size_t)(3 * base + i) % 9;
        if (build->fine_corners)
            build->finely_filled[leaf].corner[i][lane] =
                is_unused ? (double)NAN : build->fine_corners[from];
        else
            build->filled[leaf].corner[i][lane] = is_unused ? NAN : build->corners[from];
    }
    if (build->fine_corners)
        build->finely_filled[leaf].triangle[lane] = triangle;
    else
        build->filled[leaf].triangle[lane] = triangle;
}

static void fill_leaf(const Build *build, int32_t leaf) {
    const LeafRange *range = build->leaves + leaf;
    for (int lane = 0; lane < LANES; lane++)
        fill_lane(build, leaf, lane,
                  lane < range->count ? build->boxes[range->first + lane].item : NO_TRIANGLE);
}

static void fill_leaves(void *argument) {
    Build *build = argument;
    int first, count = atomic_load(&build->num_leaves);
    while ((first = atomic_fetch_add(&build->next_leaf, LEAVES_AT_ONCE)) < count)
        for (int leaf = first; leaf < first + LEAVES_AT_ONCE && leaf < count; leaf++)
            fill_leaf(build, leaf);
}

static int make_box(const float *corners, int32_t triangle, ItemBox *box) {
    for (int axis = 0; axis < 3; axis++) {
        float a = corners[axis], b = corners[3 + axis], c = corners[6 + axis];
        /* Comparisons are false for what is not a number. */
        if (!(fabsf(a) <= MOST_COORDINATE && fabsf(b) <= MOST_COORDINATE &&
              fabsf(c) <= MOST_COORDINATE))
            return 0;
        box->least[axis] = fminf(a, fminf(b, c));
        box->most[axis] = fmaxf(a, fmaxf(b, c));
    }
    box->item = triangle;
    box->spare = 0;
    return 1;
}

static int32_t make_boxes(const float *corners, int32_t count, ItemBox *boxes) {
    int32_t made = 0;
    for (int32_t triangle = 0; triangle < count; triangle++)
        made += make_box(corners + 9 * (size_t)triangle, triangle, boxes + made);
    return made;
}

int32_t max_nodes(int32_t count, int32_t leaf_size) {
    /* Nodes with less than eight children have more boxes than a leaf, and no node below: one for
     * each nine boxes. Others have eight children, which hold a box each: one for each seven. */
    return leaf_size > 1 ? count / 3 + 2 : count + 1;
}

static Range whole_range(const Build *build, int32_t count) {
    Range range = {.count = count};
    measure_range(build->boxes, &range);
    drop_copies(build, &range);
    return range;
}

/* Of the coordinates of finite bounds. */
static float find_largest(Floats4 least, Floats4 most) {
    float largest = 0.0f;
    for (int axis = 0; axis < 3; axis++)
        largest = fmaxf(largest, fmaxf(fabsf(least[axis]), fabsf(most[axis])));
    return largest;
}

/* A ray in the plane of a box's side meets the box only if the side is a little farther out. */
static float find_padding(const Bounds *bounds) {
    Floats4 halves[2];
    memcpy(halves, bounds, sizeof halves);
    return 0x1p-22f * find_largest(halves[0], halves[1]) + 1e-30f;
}

void build_box_nodes(ItemBox *boxes, int32_t count, BvhNode *nodes) {
    Build build = {.boxes = boxes, .nodes = nodes, .leaf_size = 1, .num_nodes = 1};
    Subtree root = {whole_range(&build, count), 0};
    build.padding = find_padding(&root.range.bounds);
    build_subtree(&build, &root);
}

/* Memory in large pages, where there are such, as far as it will be used: rays take 0.92 times as
 * long in a million triangles. A large page that is touched is taken whole. */
static void *allocate_pages(size_t size, size_t used) {
    void *pages = NULL;
    if (posix_memalign(&pages, used < LARGE_PAGE ? 64 : LARGE_PAGE, size))
        return NULL;
#if defined(MADV_HUGEPAGE)
    if (used >= LARGE_PAGE)
        madvise(pages, used / LARGE_PAGE * LARGE_PAGE, MADV_HUGEPAGE);
#endif
    return pages;
}

static int allocate(Build *build, int32_t count) {
    build->boxes = malloc(sizeof *build->boxes * (size_t)count);
    build->leaves = malloc(sizeof *build->leaves * (size_t)count);
    size_t size = sizeof *build->nodes * (size_t)max_nodes(count, LEAF_TRIANGLES);
    build->nodes = allocate_pages(size, size / USUAL_NODES);
    build->waiting = allocate_pages(sizeof *build->waiting * (size_t)(count / SHARED_BOXES + 1), 0);
    return build->boxes && build->leaves && build->nodes && build->waiting;
}

static void store_box(const Range *range, float padding, ItemBox *box) {
    for (int axis = 0; axis < 3; axis++) {
        box->least[axis] = range->bounds[axis] - padding;
        box->most[axis] = -range->bounds[4 + axis] + padding;
    }
}

static int run_build(Build *build, Bvh *bvh, Workers *workers, int32_t count) {
    int32_t used = make_boxes(build->corners, count, build->boxes);
    Subtree root = {whole_range(build, used), 0};
    build->padding = find_padding(&root.range.bounds);
    store_box(&root.range, used ? build->padding : 0.0f, &bvh->box);
    if (!used)
        return 1;
    bvh->largest = find_largest(load4(bvh->box.least), load4(bvh->box.most));
    build->num_nodes = 1;
    hand_over(build, &root);
    if (used < SHARED_BOXES)
        workers_run_alone(build_subtrees, build);
    else
        workers_run(workers, build_subtrees, build);
    bvh->num_nodes = atomic_load(&build->num_nodes);
    bvh->num_leaves = atomic_load(&build->num_leaves);
    size_t num_leaves = (size_t)bvh->num_leaves;
    size_t size = num_leaves * (build->fine_corners ? sizeof(FineLeaf) : sizeof(BvhLeaf));
    void *leaves = allocate_pages(size, size);
    if (build->fine_corners)
        bvh->fine_leaves = leaves;
    else
        bvh->leaves = leaves;
    build->filled = bvh->leaves;
    build->finely_filled = bvh->fine_leaves;
    if (!bvh->leaves && !bvh->fine_leaves)
        return 0;
    if (bvh->num_leaves <= LEAVES_AT_ONCE)
        workers_run_alone(fill_leaves, build);
    else
        workers_run(workers, fill_leaves, build);
    return 1;
}

int build_bvh(Bvh *bvh, Workers *workers, const float *corners, const double *fine_corners,
              int32_t count) {
    Build build = {
        .corners = corners, .fine_corners = fine_corners, .leaf_size = LEAF_TRIANGLES};
    *bvh = (Bvh){.num_nodes = 0};
    if (!count) {
        store_box(&(Range){.bounds = no_bounds()}, 0.0f, &bvh->box);
        return 1;
    }
    pthread_mutex_init(&build.lock, NULL);
    pthread_cond_init(&build.changed, NULL);
    int is_built = allocate(&build, count) && run_build(&build, bvh, workers, count);
    pthread_cond_destroy(&build.changed);
    pthread_mutex_destroy(&build.lock);
    free(build.boxes);
    free(build.leaves);
    free(build.waiting);
    bvh->nodes = build.nodes;
    if (!is_built)
        free_bvh(bvh);
    return is_built;
}

void free_bvh(Bvh *bvh) {
    free(bvh->nodes);
    free(bvh->leaves);
    free(bvh->fine_leaves);
    *bvh = (Bvh){.num_nodes = 0};
}
