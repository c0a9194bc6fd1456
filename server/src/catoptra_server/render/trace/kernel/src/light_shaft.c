/* Provides light_shaft.h: shafts of light against hierarchies of boxes, and triangles in leaves.
 * No twin: conservative bounds. Owns nothing.
 * Threads: any. */
#include "light_shaft.h"

#include "instances.h"
#include "light_map.h"

#include <math.h>

/* Twice the distance of a shadow ray's origin from its point, of the largest coordinate. */
#define RESERVE 0x1p-17f
/* Errors of differences, products and sums of coordinates, of the product of their sizes. */
#define ROUNDING 0x1p-20f
/* Triangles flatter along a directional light, radians, have no side towards it. */
#define MIN_SLOPE 1e-5f
/* Shafts through more nodes cost more than the rays that they save. */
enum { MAX_VISITS = 32 };
enum { SIDES = 6 };

/* What is below a limit along one of the normals is outside. */
typedef struct {
    Vec3 normal[SIDES];
    float limit[SIDES];
    Vec3 corners[4], light; /* position of a lamp, direction towards any other light */
    int is_lamp;
    float reserve, largest; /* metres; largest coordinate */
} Shaft;

static Vec3 towards_light(const Shaft *shaft, Vec3 point) {
    return shaft->is_lamp ? subtract(shaft->light, point) : shaft->light;
}

static void set_side(Shaft *shaft, int side, Vec3 normal, Vec3 point, float reserve) {
    shaft->normal[side] = normal;
    shaft->limit[side] = dot(normal, point) - reserve;
}

/* A side through an edge of the quadrangle and the light; 0 without a plane. */
static int add_side(Shaft *shaft, int side, Vec3 from, Vec3 to, Vec3 middle) {
    Vec3 edge = subtract(to, from), way = towards_light(shaft, from), normal = cross(edge, way);
    float length = sqrtf(dot(normal, normal));
    float product = sqrtf(dot(edge, edge) * dot(way, way));
    float sign = dot(normal, subtract(middle, from)) < 0.0f ? -1.0f : 1.0f;
    /* An edge that nearly points to the light is rounded to another plane. */
    float turn = 0.5f * ROUNDING * product / length * shaft->largest;
    set_side(shaft, side, scale(sign / length, normal), from, shaft->reserve + turn);
    return length > 0.0f && isfinite(turn);
}

/* How far the points that rays show of a plane may lie beside its part between beams, metres. */
static float find_error(const FrameState *state, Vec3 normal, const Shaft *shaft) {
    float least = 1.0f;
    for (int i = 0; i < 4; i++) {
        Vec3 view = subtract(shaft->corners[i], vec3(state->camera.translation));
        least = fminf(least, fabsf(dot(normal, view)) / sqrtf(dot(view, view)));
    }
    return 0.5f * ROUNDING * shaft->largest / least;
}

static int aim_shaft(const FrameState *state, const Light *light, int32_t triangle,
                     const Vec3 corners[4], float largest, Shaft *shaft) {
    static const int around[5] = {0, 1, 3, 2, 0};
    Vec3 normal = vec3(state->scene->mesh->arrays.normals + 3 * (size_t)triangle);
    Vec3 middle = {0, 0, 0};
    shaft->light = vec3(light->vector);
    shaft->is_lamp = light->kind == LIGHT_POINT;
    shaft->largest = fmaxf(largest, max_abs(vec3(state->camera.translation)));
    if (shaft->is_lamp)
        shaft->largest = fmaxf(shaft->largest, max_abs(shaft->light));
    for (int i = 0; i < 4; i++) {
        shaft->corners[i] = corners[i];
        shaft->largest = fmaxf(shaft->largest, max_abs(corners[i]));
        middle = add(middle, scale(0.25f, corners[i]));
    }
    shaft->reserve = RESERVE * shaft->largest;
    shaft->reserve += find_error(state, normal, shaft);
    /* Before the plane, and not beyond the lamp. */
    set_side(shaft, 4, normal, corners[0], shaft->reserve);
    set_side(shaft, 5, scale(-1.0f, normal), shaft->is_lamp ? shaft->light : corners[0],
             shaft->is_lamp ? shaft->reserve : INFINITY);
    int is_whole = isfinite(shaft->reserve);
    for (int i = 0; i < 4; i++)
        is_whole &= add_side(shaft, i, corners[around[i]], corners[around[i + 1]], middle);
    return is_whole;
}

/* Children of a node that may reach into a shaft. */
static uint32_t find_inside(const Shaft *shaft, const BvhNode *node) {
    const Floats8 *least = node->bounds, *most = node->bounds + 3;
    Ints8 is_outside = {0};
    for (int side = 0; side < SIDES; side++) {
        Vec3 n = shaft->normal[side];
        Floats8 highest = n.x * (n.x > 0.0f ? most[0] : least[0]) +
                          n.y * (n.y > 0.0f ? most[1] : least[1]) +
                          n.z * (n.z > 0.0f ? most[2] : least[2]);
        is_outside |= highest < shaft->limit[side];
    }
    return bits8(~is_outside & (load_ints8(node->child) != NO_CHILD));
}

/* Eight vectors. */
typedef struct {
    Floats8 x, y, z;
} Vectors;

static inline Vectors spread(Vec3 a) { return (Vectors){splat8(a.x), splat8(a.y), splat8(a.z)}; }

static inline Vectors minus(Vectors a, Vectors b) {
    return (Vectors){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline Floats8 inner(Vectors a, Vectors b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline Vectors outer(Vectors a, Vectors b) {
    return (Vectors){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/* The sum of a vector's sizes along the axes: no less than its length. */
static inline Floats8 size_of(Vectors a) {
    return absolute8(a.x) + absolute8(a.y) + absolute8(a.z);
}

/* Triangles that a plane separates from the shaft: their own, or one through an edge and the
 * light. */
static Ints8 are_beside(const Shaft *shaft, const Vectors corner[3]) {
    Vectors light = spread(shaft->light), edge[3], points[4];
    for (int i = 0; i < 3; i++)
        edge[i] = minus(corner[(i + 1) % 3], corner[i]);
    for (int i = 0; i < 4; i++)
        points[i] = spread(shaft->corners[i]);
    float reserve = shaft->reserve, rounding = 6.0f * ROUNDING * shaft->largest;
    Vectors normal = outer(edge[0], edge[1]);
    Floats8 size = size_of(normal), area = size_of(edge[0]) * size_of(edge[1]);
    Floats8 margin = reserve * size + rounding * area;
    Floats8 height = inner(normal, shaft->is_lamp ? minus(light, corner[0]) : light);
    Floats8 sign = select8(height < 0.0f, splat8(-1.0f), splat8(1.0f));
    /* Others lie as near the lamp as rounding, or along the light. */
    Ints8 has_side = absolute8(height) > (shaft->is_lamp ? margin : MIN_SLOPE * area);
    Ints8 is_before = has_side;
    for (int i = 0; i < 4; i++)
        is_before &= sign * inner(normal, minus(points[i], corner[0])) > margin;
    Ints8 is_beside = is_before;
    for (int i = 0; i < 3; i++) {
        Vectors way = shaft->is_lamp ? minus(light, corner[i]) : light;
        Vectors inward = outer(way, edge[i]);
        Floats8 limit = -(reserve * size_of(inward) + rounding * (size_of(edge[i]) * size_of(way)));
        Ints8 is_out = has_side;
        for (int point = 0; point < 4; point++)
            is_out &= sign * inner(inward, minus(points[point], corner[i])) < limit;
        is_beside |= is_out;
    }
    return is_beside;
}

/* Triangles of a leaf that may reach into a shaft. */
static uint32_t find_blockers(const Shaft *shaft, const BvhLeaf *leaf) {
    Vectors corner[3];
    for (int i = 0; i < 3; i++)
        corner[i] =
            (Vectors){leaf->corner[3 * i], leaf->corner[3 * i + 1], leaf->corner[3 * i + 2]};
    Ints8 is_outside = load_ints8(leaf->triangle) == NO_TRIANGLE;
    for (int side = 0; side < SIDES; side++) {
        Vectors n = spread(shaft->normal[side]);
        is_outside |= most8(most8(inner(n, corner[0]), inner(n, corner[1])), inner(n, corner[2])) <
                      shaft->limit[side];
    }
    uint32_t left = bits8(~is_outside);
    return left ? left & ~bits8(are_beside(shaft, corner)) : 0;
}

static int is_leaf_free(const Scene *scene, const Shaft *shaft, const BvhLeaf *leaf,
                        int32_t surface) {
    for (uint32_t left = find_blockers(shaft, leaf); left; left &= left - 1) {
        int32_t number = leaf->triangle[__builtin_ctz(left)];
        int32_t triangle = scene->caster_triangles ? scene->caster_triangles[number] : number;
        if (scene->surfaces.surface[triangle] != surface)
            return 0;
    }
    return 1;
}

/* Whether no item of a hierarchy but those of a surface reaches into a shaft, else a leaf that does,
 * from 1 on; without leaves, all are in its way. */
static int is_free(const Scene *scene, const Shaft *shaft, const BvhNode *nodes,
                   const BvhLeaf *leaves, int32_t surface, int32_t *blocker) {
    if (leaves && *blocker && !is_leaf_free(scene, shaft, leaves + *blocker - 1, surface))
        return 0;
    int32_t stack[MAX_VISITS * LANES] = {0};
    for (int height = 1, visits = 0; height; visits++) {
        const BvhNode *node = nodes + stack[--height];
        if (visits == MAX_VISITS)
            return 0;
        for (uint32_t inside = find_inside(shaft, node); inside; inside &= inside - 1) {
            int32_t child = node->child[__builtin_ctz(inside)];
            if (child >= 0)
                stack[height++] = child;
            else if (!leaves || !is_leaf_free(scene, shaft, leaves + ~child, surface)) {
                *blocker = -child;
                return 0;
            }
        }
    }
    return 1;
}

static int is_way_free(const FrameState *state, const Light *light, int32_t triangle,
                       const Vec3 corners[4], int32_t *blocker) {
    const Scene *scene = state->scene;
    const Bvh *casters = scene->casters ? &scene->casters->bvh : &scene->mesh->bvh;
    const BvhNode *objects = object_nodes(state);
    int32_t object;
    Shaft shaft;
    /* Where coordinates are too large for floats, rays decide. */
    if (has_origin(state) || casters->fine_leaves ||
        !aim_shaft(state, light, triangle, corners,
                   fmaxf(casters->largest, scene->mesh->bvh.largest), &shaft))
        return 0;
    return (!objects || is_free(scene, &shaft, objects, NULL, -1, &object)) &&
           (!casters->num_nodes || is_free(scene, &shaft, casters->nodes, casters->leaves,
                                           scene->surfaces.surface[triangle], blocker));
}

uint32_t find_free_lights(const FrameState *state, int32_t triangle, const Vec3 corners[4],
                          uint32_t others, int32_t blockers[MAX_SHAFTS]) {
    uint32_t found = 0;
    for (int number = 0; number < state->scene->num_lights && number < MAX_SHAFTS; number++) {
        const Light *light = &state->scene->lights[number];
        if (!(others >> number & 1) && find_incidence(state, light, triangle) > 0.0f &&
            is_way_free(state, light, triangle, corners, blockers + number))
            found |= 1u << number;
    }
    return found;
}
