/* Provides occlusion.h: factors of the sky's light on a static scene.
 * Float64 twin: world/shading.py:OcclusionMap. Owns nothing: atlas and sums are Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "occlusion.h"

#include "body_shade.h"
#include "hit_textures.h"
#include "lanes.h"
#include "measures.h"
#include "pixels.h"

#include <math.h>
#include <string.h>

/* Parts of a plane are widened by this much of themselves: the rays between their corners bulge. */
#define BULGE 0.1f
/* A tile's samples reach half a pixel beyond the centres of its pixels, which are three apart; and
 * a bulge. */
#define CENTRES_MARGIN 0.3f
/* So many rays on one facet are faster looked up one by one than 16 at once. */
enum { MAX_FEW = 6 };
/* Float32's rounding of a position in the atlas, nodes. */
#define TOLERANCE 0.01f
/* Twin: effects/scene/baked_light.py: a surface darker than white changes by less, but for the jump
 * of the sRGB curve's slope. */
#define JUMP 1.0173f

/* Not a number becomes the first. */
static inline float limit(float value, float first, float last) {
    return value > first ? value < last ? value : last : first;
}

/* Node before a position, and the rest. A grid has two nodes a side at least, so that there is one
 * after each but the last. */
static inline int32_t find_node(float position, int32_t first, int32_t last, float *rest) {
    float limited = limit(position, (float)first, (float)last);
    int32_t node = (int32_t)limited;
    node = node < last ? node : last - 1;
    *rest = limited - (float)node;
    return node;
}

/* Value between four nodes; most are open. */
static float mix_bytes(const uint8_t *upper, int32_t width, float fx, float fy) {
    const uint8_t *lower = upper + width;
    if ((upper[0] & upper[1] & lower[0] & lower[1]) == 255)
        return 1.0f;
    float a = upper[0], b = upper[1], c = lower[0], d = lower[1];
    float top = a + fx * (b - a), bottom = c + fx * (d - c);
    return (top + fy * (bottom - top)) * (1.0f / 255.0f);
}

/* Two nodes side by side: the first in the low half. */
static inline uint32_t load_bytes(const uint8_t *texels) {
    return texels[0] | (uint32_t)texels[1] << 8;
}

static inline float mix_pair(uint32_t pair, float share) {
    float first = (float)(int32_t)(pair & 255), second = (float)(int32_t)(pair >> 8);
    return first + share * (second - first);
}

/* All vector code. */
static inline void mix_pairs(const uint32_t upper[BLOCK_RAYS], const uint32_t lower[BLOCK_RAYS],
                             const float fx[BLOCK_RAYS], const float fy[BLOCK_RAYS],
                             float factors[BLOCK_RAYS]) {
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float top = mix_pair(upper[i], fx[i]);
        factors[i] = (top + fy[i] * (mix_pair(lower[i], fx[i]) - top)) * (1.0f / 255.0f);
    }
    /* A product with 1 / 255 need not be 1. */
    for (int i = 0; i < BLOCK_RAYS; i++)
        factors[i] = (upper[i] & lower[i]) == 0xffff ? 1.0f : factors[i];
}

/* Baked light of some rays, around nodes like a texture's texels; white for the others. */
static void mix_light(const Occlusion *occlusion, uint32_t lanes, const int32_t node[BLOCK_RAYS],
                      PlacedTexels *placed, float factors[3][BLOCK_RAYS]) {
    TexelSquares *squares = &placed->fine;
    placed->lanes = lanes, placed->mixed = squares->bytes = 0;
    for (int i = 0; i < BLOCK_RAYS; i++) {
        squares->size[i] = 3 * (int32_t)sizeof(uint16_t);
        squares->stride[i] = squares->size[i] * occlusion->width;
        squares->upper[i] = (const uint8_t *)(occlusion->light + 3 * (size_t)node[i]);
    }
    mix_textures(placed, factors);
}

void find_factors(const Scene *scene, int32_t triangle, uint32_t lanes,
                  const float columns[BLOCK_RAYS], const float rows[BLOCK_RAYS],
                  float factors[3][BLOCK_RAYS]) {
    const Occlusion *occlusion = &scene->occlusion;
    const OcclusionPatch *patch = patch_of(scene, triangle);
    int32_t width = occlusion->width;
    PlacedTexels placed;
    float *fx = placed.fine.fx, *fy = placed.fine.fy;
    _Alignas(64) int32_t node[BLOCK_RAYS];
    _Alignas(64) uint32_t upper[BLOCK_RAYS], lower[BLOCK_RAYS];
    for (int i = 0; i < BLOCK_RAYS; i++)
        node[i] = find_node(rows[i], patch->top, patch->bottom, &fy[i]) * width +
                  find_node(columns[i], patch->left, patch->right, &fx[i]);
    if (occlusion->light) {
        mix_light(occlusion, lanes, node, &placed, factors);
        return;
    }
    for (int i = 0; i < BLOCK_RAYS; i++) {
        const uint8_t *texels = occlusion->texels + node[i];
        upper[i] = load_bytes(texels);
        lower[i] = load_bytes(texels + width);
    }
    mix_pairs(upper, lower, fx, fy, factors[0]);
    memcpy(factors[1], factors[0], sizeof factors[0]);
    memcpy(factors[2], factors[0], sizeof factors[0]);
}

static float factor_at(const Scene *scene, const OcclusionPatch *patch, Vec3 point) {
    const Occlusion *occlusion = &scene->occlusion;
    float fx, fy;
    int32_t left =
        find_node(atlas_coordinate(patch->column, point), patch->left, patch->right, &fx);
    int32_t top = find_node(atlas_coordinate(patch->row, point), patch->top, patch->bottom, &fy);
    size_t node = (size_t)top * (size_t)occlusion->width + (size_t)left;
    return mix_bytes(occlusion->texels + node, occlusion->width, fx, fy);
}

/* Node before a coordinate, within a grid. */
static int32_t node_before(float coordinate, int32_t first, int32_t last) {
    return (int32_t)limit(coordinate, (float)first, (float)last);
}

/* Nodes of a grid that are not open, of those that positions from `low` to `high` are interpolated
 * from. */
static int32_t count_dark(const Occlusion *occlusion, const OcclusionPatch *patch,
                          const float low[2], const float high[2], int32_t *nodes) {
    int32_t left = node_before(low[0], patch->left, patch->right);
    int32_t top = node_before(low[1], patch->top, patch->bottom);
    /* The node after a point is interpolated, too. */
    int32_t right = node_before(high[0] + 1.0f, patch->left, patch->right) + 1;
    int32_t bottom = node_before(high[1] + 1.0f, patch->top, patch->bottom) + 1;
    size_t stride = (size_t)occlusion->width + 1;
    const int32_t *upper = occlusion->dark_sums + (size_t)top * stride;
    const int32_t *lower = occlusion->dark_sums + (size_t)bottom * stride;
    *nodes = (right - left) * (bottom - top);
    return lower[right] - lower[left] - upper[right] + upper[left];
}

/* What is known between two corners of an atlas that are moved apart by a share of themselves. */
static SkyView find_view_between(const Scene *scene, const OcclusionPatch *patch,
                                 const float low[2], const float high[2], float share) {
    float first[2], last[2];
    for (int axis = 0; axis < 2; axis++) {
        float margin = share * (high[axis] - low[axis]) + TOLERANCE;
        first[axis] = low[axis] - margin;
        last[axis] = high[axis] + margin;
    }
    int32_t nodes, dark = count_dark(&scene->occlusion, patch, first, last, &nodes);
    if (!dark)
        return SKY_OPEN;
    return dark == nodes ? SKY_HIDDEN : SKY_MIXED;
}

SkyView find_sky_view(const Scene *scene, int32_t triangle, const Vec3 corners[4]) {
    const OcclusionPatch *patch = patch_of(scene, triangle);
    float low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (int i = 0; i < 4; i++) {
        float x = atlas_coordinate(patch->column, corners[i]);
        float y = atlas_coordinate(patch->row, corners[i]);
        low[0] = fminf(low[0], x);
        low[1] = fminf(low[1], y);
        high[0] = fmaxf(high[0], x);
        high[1] = fmaxf(high[1], y);
    }
    return find_view_between(scene, patch, low, high, BULGE);
}

/* Position in the atlas where each ray meets a facet's plane: all vector code. */
static void find_positions(const FrameState *state, int32_t triangle, const RayBlock *rays,
                           float columns[BLOCK_RAYS], float rows[BLOCK_RAYS]) {
    const Scene *scene = state->scene;
    const OcclusionPatch *patch = patch_of(scene, triangle);
    Vec3 n = vec3(scene->mesh->arrays.normals + 3 * (size_t)triangle);
    float height = dot(n, plane_point(state, triangle));
    Vec3 c = vec3(patch->column), r = vec3(patch->row);
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float ox = rays->origin[0][i], oy = rays->origin[1][i], oz = rays->origin[2][i];
        float x = rays->direction[0][i], y = rays->direction[1][i], z = rays->direction[2][i];
        float distance =
            (height - (n.x * ox + n.y * oy + n.z * oz)) / (n.x * x + n.y * y + n.z * z);
        x = ox + distance * x;
        y = oy + distance * y;
        z = oz + distance * z;
        columns[i] = c.x * x + c.y * y + c.z * z + patch->column[3];
        rows[i] = r.x * x + r.y * y + r.z * z + patch->row[3];
    }
}

/* Least and largest of 16 values, pair by pair: vector code. */
static void find_extremes(const float values[BLOCK_RAYS], float *least, float *largest) {
    float low[BLOCK_RAYS], high[BLOCK_RAYS];
    for (int i = 0; i < BLOCK_RAYS; i++)
        low[i] = high[i] = values[i];
    for (int half = BLOCK_RAYS / 2; half; half /= 2)
        for (int i = 0; i < half; i++) {
            low[i] = low[i] < low[i + half] ? low[i] : low[i + half];
            high[i] = high[i] > high[i + half] ? high[i] : high[i + half];
        }
    *least = low[0];
    *largest = high[0];
}

static int is_open_between(const Scene *scene, int32_t triangle, const float columns[BLOCK_RAYS],
                           const float rows[BLOCK_RAYS], float share) {
    float low[2], high[2];
    find_extremes(columns, &low[0], &high[0]);
    find_extremes(rows, &low[1], &high[1]);
    return find_view_between(scene, patch_of(scene, triangle), low, high, share) == SKY_OPEN;
}

int is_sky_open(const Scene *scene, int32_t triangle, const float columns[BLOCK_RAYS],
                const float rows[BLOCK_RAYS]) {
    return is_open_between(scene, triangle, columns, rows, CENTRES_MARGIN);
}

/* Where rays end: their limits are the distances of their hits. */
static void find_ends(const RayBlock *rays, float ends[3][BLOCK_RAYS]) {
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < BLOCK_RAYS; i++)
            ends[axis][i] = rays->origin[axis][i] + rays->limit[i] * rays->direction[axis][i];
}

/* Positions in the atlas of the ends of a mask of rays; those of its first elsewhere. */
static void place_ends(const float row[4], const float ends[3][BLOCK_RAYS], uint32_t mask,
                       float positions[BLOCK_RAYS]) {
    int lane = __builtin_ctz(mask);
    float first = row[0] * ends[0][lane] + row[1] * ends[1][lane] + row[2] * ends[2][lane];
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float along = row[0] * ends[0][i] + row[1] * ends[1][i] + row[2] * ends[2][i];
        positions[i] = row[3] + (mask >> i & 1 ? along : first);
    }
}

/* Factors of a mask of rays that meet a facet, bytes, one by one; 0 if all are 1. */
static int find_few_factors(const Scene *scene, uint32_t mask, int32_t triangle,
                            const float ends[3][BLOCK_RAYS], float factors[3][BLOCK_RAYS]) {
    const OcclusionPatch *patch = patch_of(scene, triangle);
    int is_dark = 0;
    for (; mask; mask &= mask - 1) {
        int lane = __builtin_ctz(mask);
        float factor = factor_at(scene, patch, get_lane(ends, lane));
        set_lane(factors, lane, (Vec3){factor, factor, factor});
        is_dark |= factor < 1.0f;
    }
    return is_dark;
}

/* The same, all 16 at once. */
static int find_many_factors(const Scene *scene, uint32_t mask, int32_t triangle,
                             const float ends[3][BLOCK_RAYS], float factors[3][BLOCK_RAYS]) {
    const OcclusionPatch *patch = patch_of(scene, triangle);
    _Alignas(64) float columns[BLOCK_RAYS], rows[BLOCK_RAYS];
    place_ends(patch->column, ends, mask, columns);
    place_ends(patch->row, ends, mask, rows);
    find_factors(scene, triangle, mask, columns, rows, factors);
    if (scene->occlusion.light)
        return 1;
    float least, largest;
    find_extremes(factors[0], &least, &largest);
    /* Most nodes are open, even of facets with a grid. */
    return least < 1.0f;
}

void note_light(const FrameState *state, int32_t triangle, uint32_t lanes,
                const float radiance[3][BLOCK_RAYS], const float sky[3][BLOCK_RAYS],
                const float factors[3][BLOCK_RAYS]) {
    const Occlusion *occlusion = &state->scene->occlusion;
    if (!occlusion->means || state->measures->ended & MEASURE_LIGHT)
        return;
    const float open[3] = {1.0f, 1.0f, 1.0f};
    int32_t grid = occlusion->patch_of[triangle];
    const float *means = grid < 0 ? open : occlusion->means + 3 * (size_t)grid;
    float gain = state->frame->largest_gain;
    uint32_t bright = 0;
    _Alignas(64) float one[3][BLOCK_RAYS], other[3][BLOCK_RAYS];
    for (int channel = 0; channel < 3; channel++) {
        Floats16 lit = load16(radiance[channel]);
        Floats16 change = JUMP * (load16(factors[channel]) - means[channel]) * load16(sky[channel]);
        Floats16 plain = lit - change, larger = gain * most16(lit, plain);
        /* Of all that a texture leaves, what just reaches white shows most. */
        Floats16 white = 1.0f / most16(larger, splat16(1.0f));
        bright |= bits16(larger > splat16(1.0f)) & lanes;
        store16(white * lit, one[channel]);
        store16(white * most16(plain, splat16(0.0f)), other[channel]);
        Floats16 lost = select16(mask16(lanes), absolute16(lit - plain), splat16(0.0f));
        /* Lamps, which are not in it yet, may fill the well. */
        if (state->frame->spill[1] > 0.0f)
            raise_largest(&state->measures->spilt,
                          spilt_levels(state->frame, INFINITY, most_of16(lost)));
    }
    note_samples(state, &state->measures->light, lanes, one, other);
    if (bright)
        note_samples(state, &state->measures->bright, bright, one, other);
}

static void hide_sky_from_facet(const FrameState *state, uint32_t mask, uint32_t all_sky, int32_t triangle,
                                const float ends[3][BLOCK_RAYS], float radiance[3][BLOCK_RAYS]) {
    const Scene *scene = state->scene;
    _Alignas(64) float factors[3][BLOCK_RAYS] = {{0}}, parts[BLOCK_RAYS], sky[3][BLOCK_RAYS];
    Vec3 normal = vec3(scene->mesh->arrays.normals + 3 * (size_t)triangle);
    int is_dark = 0;
    int is_few = !scene->occlusion.light && __builtin_popcount(mask) <= MAX_FEW;
    int is_shaded = state->frame->shades && find_open_parts(state, mask, ends, normal, parts);
    if (has_occlusion(scene, triangle))
        is_dark = is_few ? find_few_factors(scene, mask, triangle, ends, factors)
                         : find_many_factors(scene, mask, triangle, ends, factors);
    if (!is_dark && !is_shaded)
        return;
    const float *ambient = scene->ambient_radiance + 3 * (size_t)triangle;
    for (int channel = 0; channel < 3; channel++) {
        Floats16 factor = is_dark ? load16(factors[channel]) : splat16(1.0f);
        factor = is_shaded ? factor * load16(parts) : factor;
        Floats16 lit = load16(radiance[channel]);
        Floats16 all = select16(mask16(all_sky), lit, splat16(ambient[channel]));
        lit = select16(mask16(mask), lit - (1.0f - factor) * all, lit);
        store16(factor, factors[channel]);
        store16(all, sky[channel]);
        store16(lit, radiance[channel]);
    }
    note_light(state, triangle, mask, (const float(*)[BLOCK_RAYS])radiance,
               (const float(*)[BLOCK_RAYS])sky, (const float(*)[BLOCK_RAYS])factors);
}

void hide_sky(const FrameState *state, uint32_t mask, uint32_t all_sky, const RayBlock *rays,
              const HitBlock *hits, float radiance[3][BLOCK_RAYS]) {
    _Alignas(64) float ends[3][BLOCK_RAYS];
    if (!mask)
        return;
    find_ends(rays, ends);
    /* A block shows two or three facets. */
    while (mask) {
        int32_t triangle = hits->triangle[__builtin_ctz(mask)];
        uint32_t same = 0;
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            same |= (uint32_t)(hits->triangle[lane] == triangle) << lane;
        hide_sky_from_facet(state, same & mask, all_sky, triangle, (const float(*)[BLOCK_RAYS])ends,
                            radiance);
        mask &= ~same;
    }
}

static float share_of(float part, float whole) { return whole > 0.0f ? part / whole : 0.0f; }

void hide_sky_in_block(const FrameState *state, int32_t triangle, const RayBlock *rays, Vec3 light,
                       const float (*known)[BLOCK_RAYS], float radiance[3][BLOCK_RAYS]) {
    _Alignas(64) float columns[BLOCK_RAYS], rows[BLOCK_RAYS], factors[3][BLOCK_RAYS];
    if (!known) {
        find_positions(state, triangle, rays, columns, rows);
        find_factors(state->scene, triangle, 0xffff, columns, rows, factors);
    }
    if (known)
        spread_pixels(state, rays, known, factors);
    Vec3 ambient = vec3(state->scene->ambient_radiance + 3 * (size_t)triangle);
    float share[3] = {share_of(ambient.x, light.x), share_of(ambient.y, light.y),
                      share_of(ambient.z, light.z)};
    _Alignas(64) float sky[3][BLOCK_RAYS];
    for (int channel = 0; channel < 3; channel++)
        for (int i = 0; i < BLOCK_RAYS; i++) {
            sky[channel][i] = share[channel] * radiance[channel][i];
            radiance[channel][i] -= (1.0f - factors[channel][i]) * sky[channel][i];
        }
    note_light(state, triangle, 0xffff, (const float(*)[BLOCK_RAYS])radiance,
               (const float(*)[BLOCK_RAYS])sky, (const float(*)[BLOCK_RAYS])factors);
}
