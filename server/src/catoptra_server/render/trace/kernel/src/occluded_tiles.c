/* Provides occluded_tiles.h: tiles of one facet with a factor for each pixel.
 * Float64 twin: world/shading.py:OcclusionMap. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "occluded_tiles.h"

#include "blur_plan.h"
#include "body_shade.h"
#include "fog.h"
#include "labels.h"
#include "measures.h"
#include "occlusion.h"
#include "pixels.h"
#include "plane_light.h"
#include "ranges.h"

#include <math.h>

/* A factor at a pixel's centre is the mean of its samples where a pixel sees at most this much of a
 * grid, nodes along a side: factors change slowly from node to node. Farther off, the mirror's
 * curve within a tile is too many nodes. */
#define MAX_NODES_PER_PIXEL 1.0f

/* A quantity of the rays of a tile: linear in the two tangents of the tile's pyramid. */
typedef struct {
    float middle, per_a, per_b;
} Linear;

/* Directions of a tile's pixels: axis + a along_a + b along_b, neither of unit length. */
typedef struct {
    Vec3 axis, along_a, along_b; /* the scene's axes */
    float a[TILE_PX], b[TILE_PX]; /* of rows, of columns */
} PixelGrid;

/* Tangents at the centres of pixels: the pyramid ends at the outermost samples. */
static void place_centres(float first, float last, int is_reversed, int samples,
                          float centres[TILE_PX]) {
    float step = (last - first) / (float)(TILE_PX * samples - 1);
    for (int i = 0; i < TILE_PX; i++) {
        float sample = ((float)i + 0.5f) * (float)samples - 0.5f;
        centres[is_reversed ? TILE_PX - 1 - i : i] = first + step * sample;
    }
}

static void find_grid(const FrameState *state, const Beam *beam, PixelGrid *grid) {
    const float *rotation = state->camera.rotation;
    float mixed = dot(beam->a, beam->b);
    float inverse = 1.0f / (1.0f - mixed * mixed);
    /* The dual of a and b within their plane. */
    grid->axis = rotate(rotation, beam->axis);
    grid->along_a =
        rotate(rotation, scale(inverse, subtract(beam->a, scale(mixed, beam->b))));
    grid->along_b =
        rotate(rotation, scale(inverse, subtract(beam->b, scale(mixed, beam->a))));
    int samples = state->rays->samples;
    /* Rows of the tile differ in a, columns in b: the other is constant along each. */
    place_centres(beam->a_min, beam->a_max, dot(beam->a, beam->down) < 0.0f, samples, grid->a);
    place_centres(beam->b_min, beam->b_max, dot(beam->b, beam->across) < 0.0f, samples, grid->b);
}

static Linear project_rays(const PixelGrid *grid, Vec3 onto) {
    return (Linear){dot(onto, grid->axis), dot(onto, grid->along_a), dot(onto, grid->along_b)};
}

static inline float at(Linear value, float a, float b) {
    return value.middle + a * value.per_a + b * value.per_b;
}

/* Columns and rows of the atlas that the pixels' centres show, and points there. */
static void find_positions(const FrameState *state, int32_t triangle, const PixelGrid *grid,
                           float columns[BLOCK_RAYS], float rows[BLOCK_RAYS],
                           float points[3][BLOCK_RAYS]) {
    const Scene *scene = state->scene;
    const OcclusionPatch *patch = patch_of(scene, triangle);
    Vec3 origin = vec3(state->camera.translation);
    Vec3 normal = vec3(scene->mesh->arrays.normals + 3 * (size_t)triangle);
    Vec3 first = plane_point(state, triangle);
    float height = dot(normal, subtract(first, origin));
    float first_column = atlas_coordinate(patch->column, origin);
    float first_row = atlas_coordinate(patch->row, origin);
    Linear along_normal = project_rays(grid, normal);
    Linear to_column = project_rays(grid, vec3(patch->column));
    Linear to_row = project_rays(grid, vec3(patch->row));
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float a = grid->a[i / TILE_PX], b = grid->b[i % TILE_PX];
        float distance = height / at(along_normal, a, b);
        columns[i] = first_column + distance * at(to_column, a, b);
        rows[i] = first_row + distance * at(to_row, a, b);
        Vec3 along = add(grid->axis, add(scale(a, grid->along_a), scale(b, grid->along_b)));
        set_lane(points, i, add(origin, scale(distance, along)));
    }
}

/* Whether factors at the centres of pixels are their means. */
static int are_near(const float columns[BLOCK_RAYS], const float rows[BLOCK_RAYS]) {
    float limit = MAX_NODES_PER_PIXEL * (TILE_PX - 1);
    enum { LEFT = 0, RIGHT = TILE_PX - 1, LAST = BLOCK_RAYS - 1, BOTTOM = BLOCK_RAYS - TILE_PX };
    return fabsf(columns[LAST] - columns[LEFT]) + fabsf(rows[LAST] - rows[LEFT]) < limit &&
           fabsf(columns[BOTTOM] - columns[RIGHT]) + fabsf(rows[BOTTOM] - rows[RIGHT]) < limit;
}

static void write_factors(const FrameState *state, int tile, int32_t triangle,
                          Vec3 light, const float factors[3][BLOCK_RAYS]) {
    float radiance[3][BLOCK_RAYS], sky[3][BLOCK_RAYS];
    float whole[3] = {light.x, light.y, light.z};
    const float *ambient = state->scene->ambient_radiance + 3 * (size_t)triangle;
    for (int channel = 0; channel < 3; channel++)
        for (int i = 0; i < BLOCK_RAYS; i++) {
            sky[channel][i] = ambient[channel];
            radiance[channel][i] = whole[channel] - (1.0f - factors[channel][i]) * ambient[channel];
        }
    note_light(state, triangle, 0xffff, (const float(*)[BLOCK_RAYS])radiance,
               (const float(*)[BLOCK_RAYS])sky, factors);
    write_radiance(state, tile, (const float(*)[BLOCK_RAYS])radiance);
    fill_ranges(state, tile, triangle);
    if (!state->plan)
        return;
    note_plane(state, tile, triangle);
    note_means(state, tile, (const float(*)[BLOCK_RAYS])radiance);
}

/* Whether a tile's pixels differ by their factors at most, and by the texture. Where rays have
 * origins of their own the pyramid ends beyond the outermost. */
static int is_still(const FrameState *state, const TileContent *content, const Beam *beam) {
    return content->triangle >= 0 && !content->is_open && content->object == OBJECT_NONE &&
           beam->kind == BEAM_NARROW && has_occlusion(state->scene, content->triangle) &&
           !(state->rays->origins || state->shift > 0.0f || state->turn > 0.0f ||
             state->is_rolling);
}

static int is_fillable(const FrameState *state, const TileContent *content, PlaneLight *light) {
    return !has_fog(state) &&
           !(state->scene->mesh->arrays.flags[content->triangle] & FACET_TEXTURED) &&
           !is_glossy(state, content->triangle) &&
           find_plane_light(state, content->triangle, content->proof, light) &&
           /* What shadows change is measured by samples. */
           !(finds_shadow_change(state) && !light->is_table);
}

int fill_occluded_tile(const FrameState *state, int tile, const TileContent *content,
                       const Beam *beam) {
    if (state->frame->output >= OUTPUT_HITS || !is_still(state, content, beam) ||
        !is_wholly_valid(state, tile))
        return 0;
    PlaneLight light;
    PixelGrid grid;
    int32_t triangle = content->triangle;
    _Alignas(64) float columns[BLOCK_RAYS], rows[BLOCK_RAYS], factors[3][BLOCK_RAYS];
    _Alignas(64) float points[3][BLOCK_RAYS], parts[BLOCK_RAYS];
    find_grid(state, beam, &grid);
    find_positions(state, triangle, &grid, columns, rows, points);
    /* Baked light is open at its brightest nodes alone. */
    int is_light = state->scene->occlusion.light != NULL;
    if (!is_light && is_sky_open(state->scene, triangle, columns, rows)) {
        TileContent open = *content;
        open.is_open = 1;
        render_tile(state, tile, &open);
        return 1;
    }
    int is_near = are_near(columns, rows), is_filled = is_near && is_fillable(state, content, &light);
    if (!is_filled && !(is_near && is_light))
        return 0;
    find_factors(state->scene, triangle, 0xffff, columns, rows, factors);
    Vec3 normal = vec3(state->scene->mesh->arrays.normals + 3 * (size_t)triangle);
    if (content->is_shaded &&
        find_open_parts(state, 0xffff, (const float(*)[BLOCK_RAYS])points, normal, parts))
        for (int channel = 0; channel < 3; channel++)
            for (int i = 0; i < BLOCK_RAYS; i++)
                factors[channel][i] *= parts[i];
    if (!is_filled) {
        FacetPlane plane = find_facet_plane(state, triangle);
        TileContent dim = *content;
        dim.plane = &plane;
        dim.factors = (const float(*)[BLOCK_RAYS])factors;
        render_tile(state, tile, &dim);
        return 1;
    }
    write_factors(state, tile, triangle, light.radiance, (const float(*)[BLOCK_RAYS])factors);
    if (state->frame->labels)
        label_filled_tile(state, tile, content);
    return 1;
}
