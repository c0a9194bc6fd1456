/* Provides hit_textures.h: texture colours of a block's hits.
 * Float64 twin: world/textures.py:sample_levels. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "hit_textures.h"

#include "camera_rays.h"
#include "facet_plane.h"
#include "texture_levels.h"

#include <string.h>

static const Texture *texture_of_facet(const FrameState *state, int object, int32_t triangle) {
    const MeshArrays *mesh = mesh_of(state, object);
    const Texture *textures = object == OBJECT_STATIC ? state->scene->textures : mesh->textures;
    return textures + mesh->texture[triangle];
}

/* Plane of a facet that a ray meets at a time. */
static FacetPlane find_plane_at(const FrameState *state, int object, int32_t triangle, float time) {
    if (object == OBJECT_STATIC)
        return find_facet_plane(state, triangle);
    const MeshArrays *mesh = mesh_of(state, object);
    const float *corners = mesh->corners + 9 * (size_t)triangle;
    const Frame *frame = state->frame;
    Pose pose = frame->object_poses[object - 1];
    if (frame->num_poses > 1)
        pose_at(frame->object_poses + object - 1, frame->num_poses, frame->num_objects, time, &pose);
    Vec3 offset = vec3(pose.translation), placed[3];
    for (int i = 0; i < 3; i++)
        placed[i] = add(rotate(pose.rotation, vec3(corners + 3 * i)), offset);
    return span_plane(placed[0], placed[1], placed[2], corner_uv(mesh, triangle));
}

/* Coordinates and footprints of the hits with the facet of one lane, a bit mask of which is
 * returned: vector code for all rays of the block, kept where they meet the facet. */
static uint32_t find_facet_points(const FrameState *state, const RayBlock *rays,
                                  const HitBlock *hits, const HitPoints *at,
                                  const RaySteps *ray_steps, int lane, TexturePoints *points) {
    int32_t triangle = hits->triangle[lane], object = hits->object[lane];
    const TextureLevel *image = texture_of_facet(state, object, triangle)->levels;
    FacetPlane plane = find_plane_at(state, object, triangle, rays->time[lane]);
    /* Each ray meets a moving object at a place of its own. */
    int is_moving = object != OBJECT_STATIC && state->frame->num_poses > 1;
    uint32_t mask = is_moving ? 1u << lane : find_same(hits, lane);
    _Alignas(64) int32_t here[BLOCK_RAYS];
    store_ints16(mask16(mask), here);
    PlaneSteps steps = find_plane_steps(&plane, ray_steps, image);
    set_images(texture_of_facet(state, object, triangle), load_ints16(here), points);
    Vec3 n = plane.normal, gu = scale((float)image->width, plane.u_gradient);
    Vec3 gv = scale((float)image->height, plane.v_gradient);
    for (int i = 0; i < BLOCK_RAYS; i++) {
        int is_here = here[i];
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
    return mask;
}

/* Coordinates and footprints of textured hits; of the other rays, points without a size. */
static void find_texture_points(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                                const SurfaceBlock *surface, TexturePoints *points) {
    RaySteps steps = find_ray_steps(state, rays);
    memset(points, 0, sizeof *points);
    for (uint32_t left = surface->textured; left;)
        left &= ~find_facet_points(state, rays, hits, &surface->points, &steps,
                                   __builtin_ctz(left), points);
}

/* Levels of some rays, and the weights of the next coarser ones: 2^k (1 + weight) texels, by the
 * exponent and the fraction of the number itself. Bit mask of the rays that read two levels. */
static uint32_t choose_levels(const TexturePoints *points, uint32_t lanes,
                              int32_t level[BLOCK_RAYS], float weight[BLOCK_RAYS]) {
    Floats16 texels = load16(points->texels);
    Ints16 coarsest = load_ints16(points->coarsest);
    Ints16 bits = (Ints16)texels, found = (bits >> 23) - 127;
    /* Also false for what is not a number, of a plane that holds the viewpoint. */
    Ints16 is_large = texels > splat16(1.0f), is_mixed = is_large & (found < coarsest);
    found = (found & is_mixed) | (coarsest & is_large & ~is_mixed);
    /* Below one and a half of its texels a level is read alone: half of the second look-ups. */
    Floats16 part = 2.0f * (Floats16)((bits & 0x7fffff) | 0x3f800000) - 3.0f;
    is_mixed &= part > splat16(0.0f);
    store_ints16(found, level);
    store16(select16(is_mixed, part, splat16(0.0f)), weight);
    return bits16(is_mixed) & lanes;
}

static const Texture *texture_of(const TextureChoice *from, int lane) {
    return from->common ? from->common : from->own[lane];
}

/* Columns and rows in the bordered level of `find_texel`, of coordinates as by vector code. */
static void find_texels(const int32_t width[BLOCK_RAYS], const int32_t height[BLOCK_RAYS],
                        const float u[BLOCK_RAYS], const float v[BLOCK_RAYS],
                        int32_t column[BLOCK_RAYS], int32_t row[BLOCK_RAYS], TexelSquares *squares) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        column[lane] = find_texel(u[lane], width[lane], &squares->fx[lane]);
        row[lane] = find_texel(v[lane], height[lane], &squares->fy[lane]);
    }
}

/* Sides of levels of images: each is half the one before, rounded down, and one at least. */
static void halve_sides(const int32_t sides[BLOCK_RAYS], const int32_t level[BLOCK_RAYS],
                        int32_t halved[BLOCK_RAYS]) {
    Ints16 found = load_ints16(sides) >> load_ints16(level);
    store_ints16(found - (found == 0), halved);
}

/* Texels of some rays of a block, each at a level of a texture of its own, requested from memory;
 * `sharp` rays read the image alone. Vector code but for what is loaded. */
static void place_block(const TextureChoice *from, const int32_t level[BLOCK_RAYS],
                        uint32_t lanes, uint32_t sharp, const TexturePoints *points,
                        TexelSquares *squares) {
    _Alignas(64) float u[BLOCK_RAYS], v[BLOCK_RAYS];
    _Alignas(64) int32_t width[BLOCK_RAYS], height[BLOCK_RAYS];
    _Alignas(64) int32_t column[BLOCK_RAYS], row[BLOCK_RAYS];
    memcpy(u, points->u, sizeof u);
    memcpy(v, points->v, sizeof v);
    memcpy(squares->size, points->size, sizeof points->size);
    halve_sides(points->width, level, width);
    halve_sides(points->height, level, height);
    for (uint32_t left = from->is_special ? lanes : 0; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        const Texture *texture = texture_of(from, lane);
        if (texture->sampling)
            adjust_coordinates(texture, level[lane], sharp >> lane & 1, &u[lane], &v[lane]);
    }
    find_texels(width, height, u, v, column, row, squares);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        squares->stride[lane] = squares->size[lane] * (width[lane] + 2);
    squares->bytes = 0;
    for (uint32_t left = lanes; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        const TextureLevel *texels = texture_of(from, lane)->levels + level[lane];
        if (__builtin_expect(texels->light != NULL, 0)) {
            squares->bytes |= 1u << lane, squares->light = texels->light;
            squares->stride[lane] /= 2, squares->size[lane] /= 2;
        }
        squares->upper[lane] = place_texels(texels, squares->size[lane], squares->stride[lane],
                                            column[lane], row[lane]);
    }
}

static Texel mix_lane(const TexelSquares *squares, int lane) {
    const float *light = squares->bytes >> lane & 1 ? squares->light : NULL;
    TexelSquare square = {squares->upper[lane], light, squares->stride[lane],
                          squares->size[lane], squares->fx[lane], squares->fy[lane]};
    return mix_texels(&square);
}

void place_textures(const TextureChoice *from, const TexturePoints *points, uint32_t lanes,
                    PlacedTexels *placed) {
    _Alignas(64) int32_t level[BLOCK_RAYS];
    uint32_t mixed = choose_levels(points, lanes, level, placed->weight);
    uint32_t sharp = bits16(load_ints16(level) == 0) & ~mixed;
    placed->lanes = lanes, placed->mixed = mixed;
    place_block(from, level, lanes, sharp, points, &placed->fine);
    if (!mixed)
        return;
    store_ints16(load_ints16(level) - mask16(mixed), level);
    place_block(from, level, mixed, 0, points, &placed->coarse);
}

static void mix_lanes(const TexelSquares *squares, uint32_t lanes, Texel colours[BLOCK_RAYS]) {
    for (; lanes; lanes &= lanes - 1)
        colours[__builtin_ctz(lanes)] = mix_lane(squares, __builtin_ctz(lanes));
}

void mix_textures(const PlacedTexels *placed, float colours[3][BLOCK_RAYS]) {
    Texel mixed[BLOCK_RAYS], coarse[BLOCK_RAYS];
    for (int lane = 0; placed->lanes != 0xffff && lane < BLOCK_RAYS; lane++)
        mixed[lane] = (Texel){1, 1, 1, 1};
    /* One level of all rays, then the other: which rays read two, no processor predicts. */
    mix_lanes(&placed->fine, placed->lanes, mixed);
    mix_lanes(&placed->coarse, placed->mixed, coarse);
    for (uint32_t left = placed->mixed; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        mixed[lane] += placed->weight[lane] * (coarse[lane] - mixed[lane]);
    }
    for (int lane = 0; lane < BLOCK_RAYS; lane += 4) {
        const Texel *at = mixed + lane;
        Texel low[2], high[2], channel[3];
        for (int i = 0; i < 2; i++) {
            low[i] = __builtin_shufflevector(at[2 * i], at[2 * i + 1], 0, 4, 1, 5);
            high[i] = __builtin_shufflevector(at[2 * i], at[2 * i + 1], 2, 6, 3, 7);
        }
        channel[0] = __builtin_shufflevector(low[0], low[1], 0, 1, 4, 5);
        channel[1] = __builtin_shufflevector(low[0], low[1], 2, 3, 6, 7);
        channel[2] = __builtin_shufflevector(high[0], high[1], 0, 1, 4, 5);
        for (int i = 0; i < 3; i++)
            memcpy(colours[i] + lane, &channel[i], sizeof channel[i]);
    }
}

void place_hit_textures(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                        const SurfaceBlock *surface, PlacedTexels *placed) {
    TexturePoints points;
    TextureChoice from = {.common = NULL};
    find_texture_points(state, rays, hits, surface, &points);
    measure_footprints(&points);
    for (uint32_t left = surface->textured; left; left &= left - 1) {
        int lane = __builtin_ctz(left);
        from.own[lane] = texture_of_facet(state, hits->object[lane], hits->triangle[lane]);
        from.is_special |= from.own[lane]->sampling;
    }
    place_textures(&from, &points, surface->textured, placed);
}
