/* Provides facet_plane.h: blocks of rays that all meet one facet's plane.
 * Float64 twin: reference/triangle_search.py, world/textures.py:sample_levels. Owns nothing:
 * writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "facet_plane.h"

#include "hit_textures.h"
#include "texture_levels.h"

#include <math.h>

/* Coordinates at a point of the plane, which textures repeat after 1; in double precision, since
 * the first corner may be far. */
static void find_offsets(const FrameState *state, int32_t triangle, const double *uv,
                         FacetPlane *plane) {
    const double *origin = state->frame->origin;
    double weight[2], point[3] = {origin[0] + (double)plane->first.x,
                                  origin[1] + (double)plane->first.y,
                                  origin[2] + (double)plane->first.z};
    find_weights(state->scene->mesh->arrays.fine_corners + 9 * (size_t)triangle, point, weight);
    double u = uv[0] + weight[0] * (uv[2] - uv[0]) + weight[1] * (uv[4] - uv[0]);
    double v = uv[1] + weight[0] * (uv[3] - uv[1]) + weight[1] * (uv[5] - uv[1]);
    plane->u_offset = (float)(u - floor(u));
    plane->v_offset = (float)(v - floor(v));
}

FacetPlane span_plane(Vec3 first, Vec3 second, Vec3 third, const double *uv) {
    Vec3 edge_u = subtract(second, first), edge_v = subtract(third, first);
    Vec3 normal = cross(edge_u, edge_v);
    /* The dual of the edges within the plane: barycentric weights are its products with points. */
    float inverse = 1.0f / dot(normal, normal);
    Vec3 dual_u = scale(inverse, cross(edge_v, normal));
    Vec3 dual_v = scale(inverse, cross(normal, edge_u));
    return (FacetPlane){
        .first = first,
        .normal = normal,
        .u_gradient = add(scale((float)(uv[2] - uv[0]), dual_u),
                          scale((float)(uv[4] - uv[0]), dual_v)),
        .v_gradient = add(scale((float)(uv[3] - uv[1]), dual_u),
                          scale((float)(uv[5] - uv[1]), dual_v)),
        .u_offset = (float)uv[0],
        .v_offset = (float)uv[1],
    };
}

FacetPlane find_facet_plane(const FrameState *state, int32_t triangle) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    static const double untextured[6] = {0, 0, 0, 0, 0, 0};
    const double *uv = mesh->uv ? corner_uv(mesh, triangle) : untextured;
    FacetPlane plane = span_plane(scene_corner(state, triangle, 0), scene_corner(state, triangle, 1),
                                  scene_corner(state, triangle, 2), uv);
    if (mesh->fine_corners) {
        plane.first = plane_point(state, triangle);
        find_offsets(state, triangle, uv, &plane);
    }
    return plane;
}

/* Distance along the normal from a ray's origin to the plane. */
static inline float height_above(const FacetPlane *plane, const RayBlock *rays, int lane) {
    return dot(plane->normal, subtract(plane->first, get_lane(rays->origin, lane)));
}

static inline __attribute__((always_inline)) void
divide_heights(const FacetPlane *plane, const RayBlock *rays, int has_origins,
               float distances[BLOCK_RAYS]) {
    float common = height_above(plane, rays, 0);
    Vec3 n = plane->normal;
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float height = has_origins ? height_above(plane, rays, i) : common;
        distances[i] = height / (n.x * rays->direction[0][i] + n.y * rays->direction[1][i] +
                                 n.z * rays->direction[2][i]);
    }
}

void find_distances(const FacetPlane *plane, const RayBlock *rays, float distances[BLOCK_RAYS]) {
    if (rays->has_origins)
        divide_heights(plane, rays, 1, distances);
    else
        divide_heights(plane, rays, 0, distances);
}

/* A ray's origin in the coordinates of a plane. */
typedef struct {
    float height, u, v;
} OnPlane;

static inline OnPlane project_origin(const FacetPlane *plane, const RayBlock *rays, int lane) {
    Vec3 from_first = subtract(get_lane(rays->origin, lane), plane->first);
    return (OnPlane){-dot(plane->normal, from_first),
                     plane->u_offset + dot(plane->u_gradient, from_first),
                     plane->v_offset + dot(plane->v_gradient, from_first)};
}

/* Texture coordinates and footprints: all vector code, one for each of both kinds of rays. */
static inline __attribute__((always_inline)) void
find_coordinates(const FacetPlane *plane, const RayBlock *rays, int has_origins,
                 const TextureLevel *image, const PlaneSteps *steps, TexturePoints *points) {
    OnPlane common = project_origin(plane, rays, 0);
    Vec3 n = plane->normal, gu = plane->u_gradient, gv = plane->v_gradient;
    float width = (float)image->width, rows = (float)image->height;
    for (int i = 0; i < BLOCK_RAYS; i++) {
        float x = rays->direction[0][i], y = rays->direction[1][i], z = rays->direction[2][i];
        OnPlane origin = has_origins ? project_origin(plane, rays, i) : common;
        float inverse_cosine = 1.0f / (n.x * x + n.y * y + n.z * z);
        float distance = origin.height * inverse_cosine;
        float along_u = gu.x * x + gu.y * y + gu.z * z, along_v = gv.x * x + gv.y * y + gv.z * z;
        points->u[i] = origin.u + distance * along_u;
        points->v[i] = origin.v + distance * along_v;
        Footprint footprint =
            find_footprint(steps, distance, inverse_cosine, width * along_u, rows * along_v);
        points->squares[i] = footprint.squares;
        points->area[i] = footprint.area;
    }
}

void place_plane_texels(const FrameState *state, int32_t triangle, const FacetPlane *plane,
                        const RayBlock *rays, struct PlacedTexels *placed) {
    const Texture *texture =
        state->scene->textures + state->scene->mesh->arrays.texture[triangle];
    RaySteps ray_steps = find_ray_steps(state, rays);
    PlaneSteps steps = find_plane_steps(plane, &ray_steps, texture->levels);
    TexturePoints points;
    if (rays->has_origins)
        find_coordinates(plane, rays, 1, texture->levels, &steps, &points);
    else
        find_coordinates(plane, rays, 0, texture->levels, &steps, &points);
    TextureChoice from;
    from.common = texture, from.is_special = texture->sampling;
    set_images(texture, (Ints16){0} - 1, &points);
    measure_footprints(&points);
    place_textures(&from, &points, 0xffff, placed);
}

void texture_block(const FrameState *state, int32_t triangle, const FacetPlane *plane,
                   const RayBlock *rays, Vec3 radiance, float result[3][BLOCK_RAYS]) {
    float factors[3] = {radiance.x, radiance.y, radiance.z};
    PlacedTexels placed;
    place_plane_texels(state, triangle, plane, rays, &placed);
    mix_textures(&placed, result);
    for (int channel = 0; channel < 3; channel++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            result[channel][lane] *= factors[channel];
}
