#include "occlusion.h"

#include <math.h>

/* Parts of a plane are widened by this much of themselves: the rays between their corners bulge. */
#define BULGE 0.1f
/* Float32's rounding of a position in the atlas, nodes. */
#define TOLERANCE 0.01f

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

static inline float mix_nodes(const Occlusion *occlusion, int32_t column, int32_t row, float fx,
                              float fy) {
    const uint8_t *upper = occlusion->texels + (size_t)row * (size_t)occlusion->width + column;
    const uint8_t *lower = upper + occlusion->width;
    /* Most nodes are open. */
    if ((upper[0] & upper[1] & lower[0] & lower[1]) == 0xff)
        return 1.0f;
    float a = upper[0], b = upper[1], c = lower[0], d = lower[1];
    float top = a + fx * (b - a), bottom = c + fx * (d - c);
    return (top + fy * (bottom - top)) * (1.0f / 255.0f);
}

void find_factors(const Scene *scene, int32_t triangle, const float columns[BLOCK_RAYS],
                  const float rows[BLOCK_RAYS], float factors[BLOCK_RAYS]) {
    const OcclusionPatch *patch = patch_of(scene, triangle);
    int32_t column[BLOCK_RAYS], row[BLOCK_RAYS];
    float fx[BLOCK_RAYS], fy[BLOCK_RAYS];
    for (int i = 0; i < BLOCK_RAYS; i++) {
        column[i] = find_node(columns[i], patch->left, patch->right, &fx[i]);
        row[i] = find_node(rows[i], patch->top, patch->bottom, &fy[i]);
    }
    for (int i = 0; i < BLOCK_RAYS; i++)
        factors[i] = mix_nodes(&scene->occlusion, column[i], row[i], fx[i], fy[i]);
}

static float factor_at(const Scene *scene, const OcclusionPatch *patch, float column, float row) {
    float fx, fy;
    int32_t left = find_node(column, patch->left, patch->right, &fx);
    int32_t top = find_node(row, patch->top, patch->bottom, &fy);
    return mix_nodes(&scene->occlusion, left, top, fx, fy);
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

SkyView find_sky_view(const Scene *scene, int32_t triangle, const Vec3 corners[4]) {
    const Occlusion *occlusion = &scene->occlusion;
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
    float dx = BULGE * (high[0] - low[0]) + TOLERANCE;
    float dy = BULGE * (high[1] - low[1]) + TOLERANCE;
    low[0] -= dx;
    low[1] -= dy;
    high[0] += dx;
    high[1] += dy;
    int32_t nodes, dark = count_dark(occlusion, patch, low, high, &nodes);
    if (!dark)
        return SKY_OPEN;
    return dark == nodes ? SKY_HIDDEN : SKY_MIXED;
}

/* Position in the atlas where each ray meets a facet's plane: all vector code. */
static void find_positions(const Scene *scene, int32_t triangle, const RayBlock *rays,
                           float columns[BLOCK_RAYS], float rows[BLOCK_RAYS]) {
    const OcclusionPatch *patch = patch_of(scene, triangle);
    Vec3 n = vec3(scene->mesh->arrays.normals + 3 * (size_t)triangle);
    float height = dot(n, vec3(scene->mesh->arrays.corners + 9 * (size_t)triangle));
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

/* Whether the factors of a mask of positions are all 1: most are, even on facets with a grid. */
static int shows_open_sky(const Scene *scene, const OcclusionPatch *patch, uint32_t mask,
                          const float columns[BLOCK_RAYS], const float rows[BLOCK_RAYS]) {
    float low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    int32_t nodes;
    for (; mask; mask &= mask - 1) {
        int lane = __builtin_ctz(mask);
        low[0] = columns[lane] < low[0] ? columns[lane] : low[0];
        low[1] = rows[lane] < low[1] ? rows[lane] : low[1];
        high[0] = columns[lane] > high[0] ? columns[lane] : high[0];
        high[1] = rows[lane] > high[1] ? rows[lane] : high[1];
    }
    return !count_dark(&scene->occlusion, patch, low, high, &nodes);
}

static void hide_sky_from_facet(const FrameState *state, uint32_t mask, int32_t triangle,
                                const RayBlock *rays, float radiance[3][BLOCK_RAYS]) {
    const Scene *scene = state->scene;
    const float *ambient = scene->ambient_radiance + 3 * (size_t)triangle;
    /* So far all light of a facet whose colours vary is the sky's. */
    int is_all_sky = scene->mesh->arrays.flags[triangle] & FACET_CORNER_COLOURS;
    _Alignas(64) float columns[BLOCK_RAYS], rows[BLOCK_RAYS];
    find_positions(scene, triangle, rays, columns, rows);
    const OcclusionPatch *patch = patch_of(scene, triangle);
    if (shows_open_sky(scene, patch, mask, columns, rows))
        return;
    for (; mask; mask &= mask - 1) {
        int lane = __builtin_ctz(mask);
        float hidden = 1.0f - factor_at(scene, patch, columns[lane], rows[lane]);
        for (int channel = 0; channel < 3; channel++)
            radiance[channel][lane] -=
                hidden * (is_all_sky ? radiance[channel][lane] : ambient[channel]);
    }
}

void hide_sky(const FrameState *state, uint32_t mask, const RayBlock *rays, const HitBlock *hits,
              float radiance[3][BLOCK_RAYS]) {
    /* A block shows two or three facets: their planes once each. */
    while (mask) {
        int32_t triangle = hits->triangle[__builtin_ctz(mask)];
        uint32_t same = 0;
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            same |= (uint32_t)(hits->triangle[lane] == triangle) << lane;
        hide_sky_from_facet(state, same & mask, triangle, rays, radiance);
        mask &= ~same;
    }
}

static float share_of(float part, float whole) { return whole > 0.0f ? part / whole : 0.0f; }

void hide_sky_in_block(const FrameState *state, int32_t triangle, const RayBlock *rays, Vec3 light,
                       float radiance[3][BLOCK_RAYS]) {
    _Alignas(64) float columns[BLOCK_RAYS], rows[BLOCK_RAYS], factors[BLOCK_RAYS];
    find_positions(state->scene, triangle, rays, columns, rows);
    find_factors(state->scene, triangle, columns, rows, factors);
    Vec3 ambient = vec3(state->scene->ambient_radiance + 3 * (size_t)triangle);
    float share[3] = {share_of(ambient.x, light.x), share_of(ambient.y, light.y),
                      share_of(ambient.z, light.z)};
    for (int channel = 0; channel < 3; channel++)
        for (int i = 0; i < BLOCK_RAYS; i++)
            radiance[channel][i] -= share[channel] * (1.0f - factors[i]) * radiance[channel][i];
}
