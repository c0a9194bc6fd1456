/* Provides hit_textures.h: texture colours of a block's hits.
 * Float64 twin: world/textures.py:sample_levels. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "hit_textures.h"

#include "camera_rays.h"
#include "facet_plane.h"
#include "texture_levels.h"

#include <string.h>

/* Coordinates and footprints of the hits with one facet, a bit mask of which is returned: vector
 * code for all rays of the block, kept where they meet the facet. */
static uint32_t find_facet_points(const FrameState *state, const RayBlock *rays,
                                  const HitBlock *hits, const HitPoints *at,
                                  const RaySteps *ray_steps, int32_t triangle,
                                  TexturePoints *points) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    const TextureLevel *image = state->scene->textures[mesh->texture[triangle]].levels;
    FacetPlane plane = find_facet_plane(state, triangle);
    PlaneSteps steps = find_plane_steps(&plane, ray_steps, image);
    Vec3 n = plane.normal, gu = scale((float)image->width, plane.u_gradient);
    Vec3 gv = scale((float)image->height, plane.v_gradient);
    uint32_t mask = 0;
    for (int i = 0; i < BLOCK_RAYS; i++) {
        int is_here = hits->triangle[i] == triangle;
        float x = rays->direction[0][i], y = rays->direction[1][i], z = rays->direction[2][i];
        Footprint footprint = find_footprint(
            &steps, at->distance[i], 1.0f / (n.x * x + n.y * y + n.z * z),
            gu.x * x + gu.y * y + gu.z * z, gv.x * x + gv.y * y + gv.z * z);
        Vec3 from_first = subtract(get_lane(at->position, i), plane.first);
        float u = plane.u_offset + dot(plane.u_gradient, from_first);
        float v = plane.v_offset + dot(plane.v_gradient, from_first);
        points->u[i] = is_here ? u : points->u[i];
        points->v[i] = is_here ? v : points->v[i];
        points->squares[i] = is_here ? footprint.squares : points->squares[i];
        points->area[i] = is_here ? footprint.area : points->area[i];
    }
    for (int i = 0; i < BLOCK_RAYS; i++)
        mask |= (uint32_t)(hits->triangle[i] == triangle) << i;
    return mask;
}

/* Coordinates and footprints of textured hits; of the other rays, points without a size. */
static void find_texture_points(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                                const SurfaceBlock *surface, TexturePoints *points) {
    RaySteps steps = find_ray_steps(state, rays);
    memset(points, 0, sizeof *points);
    /* Objects have no textures: a triangle's number is one of the static scene. */
    for (uint32_t left = surface->textured; left;)
        left &= ~find_facet_points(state, rays, hits, &surface->points, &steps,
                                   hits->triangle[__builtin_ctz(left)], points);
}

void read_hit_textures(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                       const SurfaceBlock *surface, float colours[3][BLOCK_RAYS]) {
    TexturePoints points;
    find_texture_points(state, rays, hits, surface, &points);
    measure_footprints(&points);
    TexelChoice texels[BLOCK_RAYS];
    /* All texels are requested before the first is used. */
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        if (!(surface->textured >> lane & 1))
            continue;
        int32_t number = state->scene->mesh->arrays.texture[hits->triangle[lane]];
        const Texture *texture = state->scene->textures + number;
        texels[lane] = find_level_texels(texture, choose_level(texture, points.texels[lane]),
                                         points.u[lane], points.v[lane]);
    }
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        set_lane(colours, lane, (Vec3){1, 1, 1});
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        if (surface->textured >> lane & 1)
            set_lane(colours, lane, mix_levels(&texels[lane]));
}
