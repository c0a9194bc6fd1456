/* Provides blur_occlusion.h: mean factors of a moving facet's sky.
 * Float64 twin: world/shading.py, averaged over sharp frames. Owns nothing: writes what its
 * caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "blur_occlusion.h"

#include "blur_intervals.h"
#include "occlusion.h"

AtlasRays find_atlas_rays(const Scene *scene, int32_t triangle, const Pose *pose) {
    const OcclusionPatch *patch = patch_of(scene, triangle);
    return (AtlasRays){
        .to_column = rotate_back(pose->rotation, vec3(patch->column)),
        .to_row = rotate_back(pose->rotation, vec3(patch->row)),
        .first_column = atlas_coordinate(patch->column, vec3(pose->translation)),
        .first_row = atlas_coordinate(patch->row, vec3(pose->translation)),
    };
}

/* Times of a part, counted for its begin and its end by their nearness to either. */
static void add_shares(const int32_t seen[BLOCK_RAYS], int part, int bins,
                       float begin[BLOCK_RAYS], float end[BLOCK_RAYS]) {
    float step = 1.0f / (float)bins;
    for (int bin = 0; bin < bins; bin++) {
        float nearness = ((float)bin + 0.5f) * step;
        for (int i = 0; i < BLOCK_RAYS; i++) {
            float is_seen = (float)(seen[i] >> (part * bins + bin) & 1);
            begin[i] += (1.0f - nearness) * is_seen;
            end[i] += nearness * is_seen;
        }
    }
}

static void find_factors_at(const Scene *scene, int32_t triangle, const AtlasRays *atlas,
                            const float inverse[BLOCK_RAYS], const RayBlock *rays,
                            float factors[3][BLOCK_RAYS]) {
    _Alignas(64) float columns[BLOCK_RAYS], rows[BLOCK_RAYS];
    Vec3 c = atlas->to_column, r = atlas->to_row;
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float x = rays->direction[0][i], y = rays->direction[1][i], z = rays->direction[2][i];
        float distance = 1.0f / inverse[i];
        columns[i] = atlas->first_column + (c.x * x + c.y * y + c.z * z) * distance;
        rows[i] = atlas->first_row + (r.x * x + r.y * y + r.z * z) * distance;
    }
    find_factors(scene, triangle, 0xffff, columns, rows, factors);
}

void find_mean_factors(const Scene *scene, int32_t triangle, const OcclusionTimes *times,
                       const RayBlock *rays, const int32_t seen[BLOCK_RAYS],
                       float factors[3][BLOCK_RAYS]) {
    _Alignas(64) float shares[MAX_PARTS + 1][BLOCK_RAYS] = {{0.0f}};
    _Alignas(64) float total[BLOCK_RAYS] = {0.0f}, sum[3][BLOCK_RAYS] = {{0.0f}};
    for (int part = 0; part < times->parts; part++)
        add_shares(seen, part, times->bins, shares[part], shares[part + 1]);
    for (int at = 0; at <= times->parts; at++) {
        _Alignas(64) float here[3][BLOCK_RAYS];
        find_factors_at(scene, triangle, &times->atlas[at], times->inverse[at], rays, here);
        for (int i = 0; i < BLOCK_RAYS; i++)
            total[i] += shares[at][i];
        for (int channel = 0; channel < 3; channel++)
            for (int i = 0; i < BLOCK_RAYS; i++)
                sum[channel][i] += shares[at][i] * here[channel][i];
    }
    for (int channel = 0; channel < 3; channel++)
        for (int i = 0; i < BLOCK_RAYS; i++)
            factors[channel][i] = total[i] > 0.0f ? sum[channel][i] / total[i] : 1.0f;
}
