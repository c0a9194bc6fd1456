/* Provides ranges.h: mean inverse ranges of pixels.
 * Float64 twin: reference/reference_engine.py. Owns nothing: ranges are Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "ranges.h"

#include "camera_rays.h"
#include "facet_plane.h"
#include "tile_place.h"

#include <string.h>

/* Rounding can put a plane that holds the viewpoint behind it: a tenth of a millimetre. */
#define MAX_INVERSE_RANGE 1e4f

static float limit_inverse(float inverse) {
    /* Also of what is not a number. */
    return inverse >= 0.0f && inverse < MAX_INVERSE_RANGE ? inverse : MAX_INVERSE_RANGE;
}

/* One plane that all rays meet: from one origin the inverse of its distance is linear in their
 * directions, here those of the camera's table. */
static void add_inverses(const FrameState *state, int tile, int32_t triangle,
                         float sums[TILE_PX * TILE_PX]) {
    Vec3 normal = vec3(state->scene->mesh->arrays.normals + 3 * (size_t)triangle);
    Vec3 offset = subtract(plane_point(state, triangle), vec3(state->camera.translation));
    Vec3 n = rotate_back(state->camera.rotation, scale(1.0f / dot(normal, offset), normal));
    int samples = state->rays->samples, blocks = samples * samples;
    for (int block = 0; block < blocks; block++) {
        size_t first = (size_t)(tile * blocks + block) * 3 * BLOCK_RAYS;
        const float *x = state->rays->directions + first, *y = x + BLOCK_RAYS, *z = y + BLOCK_RAYS;
        float inverse[BLOCK_RAYS];
        fetch_next_tile(state, x);
        for (int i = 0; i < BLOCK_RAYS; i++)
            inverse[i] = limit_inverse(n.x * x[i] + n.y * y[i] + n.z * z[i]);
        add_lanes(samples, block, inverse, sums);
    }
}

/* The same of rays with origins or poses of their own. */
static void add_single_inverses(const FrameState *state, int tile, int32_t triangle,
                                float sums[TILE_PX * TILE_PX]) {
    int samples = state->rays->samples, blocks = samples * samples;
    FacetPlane plane = find_facet_plane(state, triangle);
    for (int block = 0; block < blocks; block++) {
        RayBlock rays;
        float inverse[BLOCK_RAYS];
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        find_distances(&plane, &rays, inverse);
        for (int i = 0; i < BLOCK_RAYS; i++)
            inverse[i] = limit_inverse(1.0f / inverse[i]);
        add_lanes(samples, block, inverse, sums);
    }
}

void find_inverse_ranges(const RayBlock *rays, const HitBlock *hits, float inverse[BLOCK_RAYS]) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int is_met = hits->object[lane] != OBJECT_NONE && rays->active >> lane & 1;
        float found = limit_inverse(1.0f / rays->limit[lane]);
        inverse[lane] = is_met ? found : 0.0f;
    }
}

void fill_ranges(const FrameState *state, int tile, int32_t triangle) {
    float sums[TILE_PX * TILE_PX] = {0};
    if (!state->frame->inverse_range)
        return;
    if (triangle >= 0 && (state->rays->origins || state->rays->times))
        add_single_inverses(state, tile, triangle, sums);
    else if (triangle >= 0)
        add_inverses(state, tile, triangle, sums);
    write_ranges(state, tile, sums);
}

void write_ranges(const FrameState *state, int tile, const float sums[TILE_PX * TILE_PX]) {
    TilePlace place = place_tile(state->rays, state->rays->tiles[tile]);
    float factor = 1.0f / (float)(state->rays->samples * state->rays->samples);
    for (int row = 0; row < place.rows; row++)
        for (int column = 0; column < place.columns; column++)
            state->frame->inverse_range[place.first + (size_t)row * place.width_px +
                                        (size_t)column] = factor * sums[row * TILE_PX + column];
}
