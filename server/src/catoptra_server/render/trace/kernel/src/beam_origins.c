/* Provides beam_origins.h: apexes of beams whose rays have origins.
 * No twin: conservative bounds. Owns nothing: beams.c has the memory.
 * Threads: the thread that prepares or renders; nothing is shared while it writes. */
#include "beam_origins.h"

#include <math.h>

/* Sides of a pyramid are this far from its axis at least, in tangents: a part of a few rays would
 * need an apex far behind them. */
#define MIN_TANGENT 5e-4f
/* Rounding of points of a mirror within a metre, metres. */
#define POINT_ROUNDING_M 1e-6f
/* Pull of the mean origin on the point nearest to the rays, relative to that of a ray: along nearly
 * parallel rays their own is their squared angle, 1e-6 in images of 4000 px. */
#define MEAN_WEIGHT 1e-8

/* Where rays pass nearest: the least squares of their distances, as a 3 x 3 system. */
typedef struct {
    double matrix[3][3], right[3];
} NearestPoint;

static void add_ray(NearestPoint *system, const double origin[3], const double direction[3]) {
    double along = origin[0] * direction[0] + origin[1] * direction[1] + origin[2] * direction[2];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            system->matrix[i][j] += (i == j) - direction[i] * direction[j];
        system->right[i] += origin[i] - along * direction[i];
    }
}

static double determinant(const double m[3][3]) {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
           m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

/* By Cramer's rule: the matrix is definite. */
static Vec3 solve(const NearestPoint *system) {
    double whole = determinant(system->matrix), found[3];
    for (int column = 0; column < 3; column++) {
        double replaced[3][3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                replaced[i][j] = j == column ? system->right[i] : system->matrix[i][j];
        found[column] = determinant((const double(*)[3])replaced) / whole;
    }
    return (Vec3){(float)found[0], (float)found[1], (float)found[2]};
}

/* Distance by which the apex is moved back so that the pyramid holds a point `offset` from it and
 * all within `radius` of that point. */
static float find_retreat(const Beam *beam, Vec3 offset, float radius) {
    float along = dot(beam->axis, offset), a = dot(beam->a, offset), b = dot(beam->b, offset);
    /* A point at the tangent `value` of the axis is within the side there: value (along + retreat)
     * is at least its coordinate. The vector that measures it is longer than a unit. */
    float a_high = (a + radius * sqrtf(1.0f + beam->a_max * beam->a_max)) / beam->a_max;
    float a_low = (a - radius * sqrtf(1.0f + beam->a_min * beam->a_min)) / beam->a_min;
    float b_high = (b + radius * sqrtf(1.0f + beam->b_max * beam->b_max)) / beam->b_max;
    float b_low = (b - radius * sqrtf(1.0f + beam->b_min * beam->b_min)) / beam->b_min;
    return fmaxf(fmaxf(a_high, a_low), fmaxf(b_high, b_low)) - along;
}

static void widen(Beam *beam) {
    beam->a_min = fminf(beam->a_min, -MIN_TANGENT);
    beam->a_max = fmaxf(beam->a_max, MIN_TANGENT);
    beam->b_min = fminf(beam->b_min, -MIN_TANGENT);
    beam->b_max = fmaxf(beam->b_max, MIN_TANGENT);
}

/* Valid rays of a tile, one by one, from the number of the last; -1 after the last. */
static int next_ray(const RayTable *rays, int tile, int last, Vec3 *origin, Vec3 *direction) {
    int blocks = rays->samples * rays->samples;
    for (int ray = last + 1; ray < blocks * BLOCK_RAYS; ray++) {
        size_t block = (size_t)tile * (size_t)blocks + (size_t)(ray / BLOCK_RAYS);
        int lane = ray % BLOCK_RAYS;
        if (!(rays->valid[block] >> lane & 1))
            continue;
        size_t first = block * 3 * BLOCK_RAYS;
        *origin = get_lane((const float(*)[BLOCK_RAYS])(rays->origins + first), lane);
        *direction = get_lane((const float(*)[BLOCK_RAYS])(rays->directions + first), lane);
        return ray;
    }
    return -1;
}

/* Mean origin, and the point nearest to the rays. */
static Vec3 find_focus(const RayTable *rays, int tile, Vec3 *mean) {
    NearestPoint system = {{{0}}, {0}};
    Vec3 origin, direction, sum = {0, 0, 0};
    int count = 0;
    for (int ray = -1; (ray = next_ray(rays, tile, ray, &origin, &direction)) >= 0; count++) {
        sum = add(sum, origin);
        add_ray(&system, (double[3]){origin.x, origin.y, origin.z},
                (double[3]){direction.x, direction.y, direction.z});
    }
    *mean = scale(1.0f / (float)count, sum);
    double weight = MEAN_WEIGHT * count, pulls[3] = {mean->x, mean->y, mean->z};
    for (int i = 0; i < 3; i++) {
        system.matrix[i][i] += weight;
        system.right[i] += weight * pulls[i];
    }
    return solve(&system);
}

static float distance_between(Vec3 a, Vec3 b) {
    Vec3 offset = subtract(a, b);
    return sqrtf(dot(offset, offset));
}

void enclose_tile_origins(const RayTable *rays, int tile, Beam *beam, BeamOrigin *found) {
    float rounding = ORIGIN_ROUNDING_M + POINT_ROUNDING_M, retreat = -INFINITY;
    Vec3 origin, direction, focus = find_focus(rays, tile, &found->centre);
    widen(beam);
    found->radius = 0.0f;
    for (int ray = -1; (ray = next_ray(rays, tile, ray, &origin, &direction)) >= 0;) {
        retreat = fmaxf(retreat, find_retreat(beam, subtract(origin, focus), rounding));
        found->radius = fmaxf(found->radius, distance_between(origin, found->centre));
    }
    found->radius += rounding;
    found->apex = subtract(focus, scale(retreat, beam->axis));
}

int is_origin_inside(const Beam *beam, const BeamOrigin *found, Vec3 origin) {
    float rounding = ORIGIN_ROUNDING_M + POINT_ROUNDING_M;
    return find_retreat(beam, subtract(origin, found->apex), rounding) <= 0.0f &&
           distance_between(origin, found->centre) + rounding <= found->radius;
}

void enclose_part_origins(const BeamOrigin *const parts[4], Beam *beam, BeamOrigin *found) {
    Vec3 focus = {0, 0, 0}, centre = {0, 0, 0};
    float count = 0.0f, retreat = -INFINITY;
    for (int i = 0; i < 4; i++)
        if (parts[i]) {
            focus = add(focus, parts[i]->apex);
            centre = add(centre, parts[i]->centre);
            count += 1.0f;
        }
    focus = scale(1.0f / count, focus);
    found->centre = scale(1.0f / count, centre);
    found->radius = 0.0f;
    widen(beam);
    for (int i = 0; i < 4; i++)
        if (parts[i]) {
            Vec3 offset = subtract(parts[i]->apex, focus);
            retreat = fmaxf(retreat, find_retreat(beam, offset, POINT_ROUNDING_M));
            float reach = distance_between(parts[i]->centre, found->centre) + parts[i]->radius;
            found->radius = fmaxf(found->radius, reach + POINT_ROUNDING_M);
        }
    found->apex = subtract(focus, scale(retreat, beam->axis));
}
