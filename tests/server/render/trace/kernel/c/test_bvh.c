/* Tests of bvh.h and instances.h: what every hierarchy holds, and rays against all triangles.
 *
 * Compiled with the kernel's sources by test_bvh.py and `make sanitize`. Silent when all is well; else
 * the place and the case, and a status of 1. The triangles are met by scalar operations in the order
 * of bvh.c, so distances are the same bits. */
#include "instances.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *mesh_name = "", *ray_name = "";
static const int THREADS[] = {1, 4};
static int threads;

#define CHECK(condition)                                                                           \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "%s:%d: %s: %s %s, %d threads\n", __FILE__, __LINE__, #condition,      \
                    mesh_name, ray_name, threads);                                                 \
            exit(1);                                                                               \
        }                                                                                          \
    } while (0)

static uint64_t random_state, seed = 7;

static uint32_t draw(void) {
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(random_state >> 33);
}

/* Evenly between -1 and 1. */
static float even(void) { return (float)draw() * 0x1p-30f - 1.0f; }

/* In one order with every compiler. */
static Vec3 even3(void) {
    float x = even(), y = even(), z = even();
    return (Vec3){x, y, z};
}

/* Meshes: each writes the corners of one triangle of `count`. */
static void put_random(float *corners, int32_t i, int32_t count) {
    (void)i;
    float size = 1.5f / cbrtf((float)count);
    Vec3 at = even3();
    for (int k = 0; k < 9; k++)
        corners[k] = (&at.x)[k % 3] + size * even();
}

static void put_sheet(float *corners, int32_t i, int32_t count) {
    int side = (int)sqrtf((float)count / 2.0f) + 1, column = i / 2 % side, row = i / 2 / side;
    for (int corner = 0; corner < 3; corner++) {
        corners[3 * corner] = (float)(column + (corner + i % 2 > 1)) / (float)side;
        corners[3 * corner + 1] = (float)(row + (corner > 0 && (i % 2 || corner == 1))) / (float)side;
        corners[3 * corner + 2] = 0.25f;
    }
}

static void put_copy(float *corners, int32_t i, int32_t count) {
    static const float first[2][9] = {{-1, -1, 0.5, 1, -1, 0.5, 0, 1, 0.5},
                                      {-1, 1, 0.5, 1, 1, 0.5, 0, -1, 0.5}};
    (void)count;
    memcpy(corners, first[i % 7 == 3], sizeof *first); /* two triangles with the same box */
}

static void put_concentric(float *corners, int32_t i, int32_t count) {
    put_random(corners, i, count);
    for (int axis = 0; axis < 3; axis++) {
        corners[3 + axis] = -corners[axis];
        corners[6 + axis] = 0.5f * even() * corners[axis];
    }
}

static void put_needle(float *corners, int32_t i, int32_t count) {
    (void)i, (void)count;
    for (int k = 0; k < 9; k++)
        corners[k] = k < 6 ? even() : corners[k - 6] + 1e-5f * even();
}

static void put_exponential(float *corners, int32_t i, int32_t count) {
    put_random(corners, i, 1);
    float size = powf(10.0f, -30.0f + 41.0f * (float)i / (float)count);
    for (int k = 0; k < 9; k++)
        corners[k] *= size;
}

static void put_flat(float *corners, int32_t i, int32_t count) {
    put_random(corners, i, count);
    for (int axis = 0; axis < 3; axis++) {
        corners[6 + axis] = corners[axis];
        if (i % 2)
            corners[3 + axis] = corners[axis];
    }
}

static void put_hostile(float *corners, int32_t i, int32_t count) {
    static const float values[] = {NAN, INFINITY, -INFINITY, 1e18f, -1e30f, 3e38f, 1e12f};
    put_random(corners, i, count);
    if (i % 3)
        corners[draw() % 9] = values[draw() % 7];
}

static void put_smallest(float *corners, int32_t i, int32_t count) {
    (void)count;
    for (int k = 0; k < 9; k++)
        corners[k] = 1e-38f * (float)((i >> k % 3 & 1) + (k / 3 == k % 3));
}

typedef struct {
    const char *name;
    void (*put)(float *corners, int32_t i, int32_t count);
    float largest; /* of the coordinates that rays are aimed at */
} Kind;

static const Kind KINDS[] = {
    {"random", put_random, 2},         {"sheet", put_sheet, 2},
    {"copies", put_copy, 2},           {"concentric", put_concentric, 2},
    {"needles", put_needle, 2},        {"exponential", put_exponential, 1e11f},
    {"zero area", put_flat, 2},        {"hostile", put_hostile, 2},
    {"smallest", put_smallest, 1e-37f},
};
enum { NUM_KINDS = sizeof KINDS / sizeof *KINDS };

static float *make_mesh(const Kind *kind, int32_t count) {
    float *corners = malloc(sizeof *corners * 9 * (size_t)(count ? count : 1));
    CHECK(corners);
    mesh_name = kind->name;
    random_state = seed;
    for (int32_t i = 0; i < count; i++)
        kind->put(corners + 9 * (size_t)i, i, count);
    return corners;
}

static int has_place(const float *corners) {
    for (int k = 0; k < 9; k++)
        if (!(fabsf(corners[k]) <= 1e12f))
            return 0;
    return 1;
}

/* What a walk through a hierarchy has seen; the hash does not depend on where nodes lie. */
typedef struct {
    const Bvh *bvh;
    const float *corners;
    uint8_t *is_in_leaf;
    int32_t nodes, leaves;
    uint64_t hash;
} Walk;

static void hash_values(Walk *walk, const void *values, size_t size) {
    for (size_t i = 0; i < size; i++)
        walk->hash = (walk->hash ^ ((const uint8_t *)values)[i]) * 1099511628211u;
}

/* Whether a leaf has a triangle's corners in their order, from any of them on. */
static int has_corners(const BvhLeaf *leaf, int lane, const float *corners) {
    for (int first = 0; first < 3; first++) {
        int same = 1;
        for (int k = 0; k < 9; k++)
            same &= leaf->corner[k][lane] == corners[(3 * first + k) % 9];
        if (same)
            return 1;
    }
    return 0;
}

static void walk_leaf(Walk *walk, const BvhLeaf *leaf, const float least[3], const float most[3]) {
    walk->leaves++;
    CHECK(leaf->triangle[0] != NO_TRIANGLE);
    for (int lane = 0; lane < LANES; lane++) {
        int32_t triangle = leaf->triangle[lane];
        hash_values(walk, &triangle, sizeof triangle);
        for (int k = 0; k < 9 && triangle == NO_TRIANGLE; k++)
            CHECK(isnan(leaf->corner[k][lane]));
        if (triangle == NO_TRIANGLE)
            continue;
        CHECK(!walk->is_in_leaf[triangle]++);
        CHECK(has_corners(leaf, lane, walk->corners + 9 * (size_t)triangle));
        for (int k = 0; k < 9; k++) {
            CHECK(least[k % 3] <= leaf->corner[k][lane] && leaf->corner[k][lane] <= most[k % 3]);
        }
    }
}

static void walk_node(Walk *walk, int32_t number, int depth, const float least[3],
                      const float most[3]) {
    const BvhNode *node = walk->bvh->nodes + number;
    CHECK(depth <= MAX_DEPTH && number < walk->bvh->num_nodes);
    walk->nodes++;
    hash_values(walk, node->bounds, sizeof node->bounds);
    for (int slot = 0, has_ended = 0; slot < LANES; slot++) {
        float from[3], to[3];
        for (int axis = 0; axis < 3; axis++) {
            from[axis] = node->bounds[axis][slot];
            to[axis] = node->bounds[3 + axis][slot];
        }
        has_ended |= node->child[slot] == NO_CHILD;
        CHECK(has_ended == (node->child[slot] == NO_CHILD));
        CHECK(!has_ended || (from[0] == INFINITY && to[0] == -INFINITY));
        for (int axis = 0; axis < 3 && !has_ended; axis++)
            CHECK(least[axis] <= from[axis] && to[axis] <= most[axis]);
        if (node->child[slot] >= 0)
            walk_node(walk, node->child[slot], depth + 1, from, to);
        else if (!has_ended)
            walk_leaf(walk, walk->bvh->leaves + ~node->child[slot], from, to);
    }
}

/* One left out is a copy of a triangle before it. */
static int has_earlier(const Walk *walk, int32_t triangle) {
    const float *corners = walk->corners + 9 * (size_t)triangle;
    for (int32_t i = 0; i < triangle; i++)
        if (walk->is_in_leaf[i] && !memcmp(walk->corners + 9 * (size_t)i, corners, 9 * sizeof *corners))
            return 1;
    return 0;
}

static uint64_t check_structure(const Bvh *bvh, const float *corners, int32_t count) {
    Walk walk = {bvh, corners, calloc((size_t)count + 1, 1), 0, 0, 1};
    CHECK(walk.is_in_leaf);
    if (bvh->num_nodes)
        walk_node(&walk, 0, 1, bvh->box.least, bvh->box.most);
    else
        CHECK(bvh->box.least[0] > bvh->box.most[0]);
    CHECK(walk.nodes == bvh->num_nodes && walk.leaves == bvh->num_leaves);
    CHECK(bvh->num_nodes <= max_nodes(count, LEAF_TRIANGLES));
    for (int32_t i = 0; i < count; i++) {
        int is_whole = has_place(corners + 9 * (size_t)i);
        CHECK(walk.is_in_leaf[i] == is_whole || (is_whole && has_earlier(&walk, i)));
    }
    free(walk.is_in_leaf);
    return walk.hash;
}

static void test_structures(Workers *const workers[2]) {
    static const int32_t counts[] = {0, 1, 8, 9, 64, 5000, 100000};
    for (int k = 0; k < NUM_KINDS; k++)
        for (int c = 0; c < 7; c++) {
            float *corners = make_mesh(&KINDS[k], counts[c]);
            uint64_t hash[2];
            for (int pool = 0; pool < 2; pool++) {
                Bvh bvh;
                threads = THREADS[pool];
                CHECK(build_bvh(&bvh, workers[pool], corners, NULL, counts[c]));
                hash[pool] = check_structure(&bvh, corners, counts[c]);
                free_bvh(&bvh);
            }
            CHECK(hash[0] == hash[1]);
            free(corners);
        }
}

/* A million triangles in one place are no more work for a ray than one. */
static void test_copies(Workers *workers) {
    float *corners = make_mesh(&KINDS[2], 1000000);
    Bvh bvh;
    CHECK(build_bvh(&bvh, workers, corners, NULL, 1000000));
    CHECK(bvh.num_nodes == 1 && bvh.num_leaves == 1);
    CHECK(bvh.leaves[0].triangle[0] + bvh.leaves[0].triangle[1] == 3);
    free_bvh(&bvh);
    free(corners);
}

/* Distance at which a ray meets a triangle; infinite without. */
static float meet_triangle(const float *corners, const RayBlock *rays, int lane) {
    float inverse[3], size[3], x[3], y[3], to[3][3];
    for (int axis = 0; axis < 3; axis++) {
        size[axis] = fabsf(rays->direction[axis][lane]);
        inverse[axis] = 1.0f / (size[axis] < 1e-20f ? 1e-20f : rays->direction[axis][lane]);
    }
    int along = size[0] >= size[1] && size[0] >= size[2] ? 0 : size[1] >= size[2] ? 1 : 2;
    int axis[3] = {along == 0 ? 1 : 0, along == 2 ? 1 : 2, along};
    float shear[2] = {rays->direction[axis[0]][lane] * inverse[along],
                      rays->direction[axis[1]][lane] * inverse[along]};
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++)
            to[i][k] = corners[3 * i + axis[k]] - rays->origin[axis[k]][lane];
        x[i] = to[i][0] - shear[0] * to[i][2];
        y[i] = to[i][1] - shear[1] * to[i][2];
    }
    float u = x[2] * y[1] - y[2] * x[1], v = x[0] * y[2] - y[0] * x[2], w = x[1] * y[0] - y[1] * x[0];
    if ((u >= 0 && v >= 0 && w >= 0) == (u <= 0 && v <= 0 && w <= 0))
        return INFINITY;
    for (int i = 0; i < 2; i++) {
        const float *at = i ? y : x;
        if (fminf(fminf(at[0], at[1]), at[2]) > 0 || fmaxf(fmaxf(at[0], at[1]), at[2]) < 0)
            return INFINITY;
    }
    float first[3], second[3], length[3];
    for (int i = 0; i < 3; i++) {
        const float *start = corners + (i + 1) % 3 * 3, *end = corners + (i + 2) % 3 * 3;
        float dx = end[0] - start[0], dy = end[1] - start[1], dz = end[2] - start[2];
        length[i] = dx * dx + dy * dy + dz * dz;
    }
    int base = length[0] >= length[1] && length[0] >= length[2] ? 0 : length[1] >= length[2] ? 1 : 2;
    const float *from = corners + 3 * base, *other = corners + (base + 1) % 3 * 3;
    const float *last = corners + (base + 2) % 3 * 3;
    for (int k = 0; k < 3; k++) {
        first[k] = other[axis[k]] - from[axis[k]];
        second[k] = last[axis[k]] - from[axis[k]];
    }
    float a = first[1] * second[2] - first[2] * second[1];
    float b = first[2] * second[0] - first[0] * second[2];
    float c = first[0] * second[1] - first[1] * second[0];
    float depth = (a * to[base][0] + b * to[base][1] + c * to[base][2]) / (a * shear[0] + b * shear[1] + c);
    float least = fminf(fminf(to[0][2], to[1][2]), to[2][2]);
    float most = fmaxf(fmaxf(to[0][2], to[1][2]), to[2][2]);
    depth = depth > least ? depth : least;
    depth = depth < most ? depth : most;
    return depth * inverse[along] > 0.0f ? depth * inverse[along] : INFINITY;
}

/* The nearest of all triangles before a ray's limit, of the lowest number. */
static int32_t meet_all(const float *corners, int32_t count, const RayBlock *rays, int lane,
                        float *limit) {
    int32_t nearest = NO_TRIANGLE;
    for (int32_t i = 0; i < count; i++) {
        float distance = has_place(corners + 9 * i) ? meet_triangle(corners + 9 * i, rays, lane)
                                                    : INFINITY;
        if (distance < *limit) {
            *limit = distance;
            nearest = i;
        }
    }
    return nearest;
}

static const uint32_t ACTIVE[] = {0xffff, 0xffff, 0x8421, 0x1, 0x8000, 0x70, 0x9249, 0x7fff, 0x333};
static const char *const RAYS[] = {"narrow", "narrow from a sheet", "wide", "along the axes",
                                   "from far", "at one point"};
enum { NUM_RAYS = sizeof RAYS / sizeof *RAYS, NUM_ACTIVE = sizeof ACTIVE / sizeof *ACTIVE };

/* A point of a random triangle: a corner, a point of an edge or of the inside. */
static Vec3 aim(const float *corners, int32_t count) {
    const float *triangle = corners + 9 * (size_t)(draw() % (uint32_t)count);
    float p = draw() % 2 ? 0.5f + 0.5f * even() : 0.0f, q = draw() % 2 ? (1.0f - p) * 0.4f : 0.0f;
    if (!has_place(triangle))
        return even3();
    return add(scale(1.0f - p - q, vec3(triangle)),
               add(scale(p, vec3(triangle + 3)), scale(q, vec3(triangle + 6))));
}

static RayBlock make_rays(int kind, const float *corners, int32_t count, float size) {
    RayBlock rays = {.has_origins = kind != 0, .active = ACTIVE[draw() % NUM_ACTIVE]};
    Vec3 from = scale(kind == 4 ? 1e3f * size : size, even3());
    Vec3 at = aim(corners, count);
    float spread = powf(10.0f, -3.0f + 2.0f * even());
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        Vec3 random = even3();
        Vec3 start = kind == 0 || kind == 4 ? from
                     : kind == 1            ? add(from, scale(spread * size, random))
                                            : scale(size, random);
        Vec3 end = kind == 2 || kind == 3 || draw() % 4 == 0 ? aim(corners, count)
                   : kind == 5 ? at
                               : add(at, scale(spread * size, even3()));
        Vec3 along = subtract(end, start);
        if (kind == 3) { /* along an axis or in the plane of two, through the end */
            int axis = (int)(draw() % 3), other = (int)(draw() % 3);
            along = (Vec3){0};
            (&along.x)[axis] = draw() % 2 ? 1.0f : -1.0f;
            if (draw() % 2)
                (&along.x)[other] = even();
            start = subtract(end, scale(size, along));
        }
        float length = sqrtf(dot(along, along));
        along = length > 0.0f && length < INFINITY ? scale(1.0f / length, along) : (Vec3){0, 0, 1};
        set_lane(rays.origin, lane, start);
        set_lane(rays.direction, lane, along);
        rays.time[lane] = kind && draw() % 3 ? 0.5f + 0.5f * even() : 0.25f;
        rays.limit[lane] = draw() % 3 ? INFINITY : size * (1.0f + even());
    }
    return rays;
}

typedef struct {
    float limit[BLOCK_RAYS];
    HitBlock hits;
} Expected;

static HitBlock no_hits(void) {
    HitBlock hits;
    memset(&hits, 0xff, sizeof hits);
    return hits;
}

typedef void (*Intersect)(const void *scene, RayBlock *rays, HitBlock *hits);
typedef uint32_t (*Occlude)(const void *scene, const RayBlock *rays);

/* A block of rays, and each alone, meet what is expected; nobody else's hit is written. */
static int check_rays(const void *scene, const RayBlock *rays, const Expected *expected,
                      Intersect intersect, Occlude occlude) {
    uint32_t met = 0;
    for (int lane = -1; lane < BLOCK_RAYS; lane++) {
        RayBlock block = *rays;
        HitBlock hits = no_hits();
        block.active = lane < 0 ? rays->active : 1u << lane;
        uint32_t occluded = occlude(scene, &block), active = block.active;
        intersect(scene, &block, &hits);
        for (int i = 0; i < BLOCK_RAYS; i++) {
            int is_met = active >> i & 1 && expected->hits.object[i] >= 0;
            met |= (uint32_t)is_met << i;
            CHECK(block.limit[i] == (is_met ? expected->limit[i] : rays->limit[i]));
            CHECK(hits.object[i] == (is_met ? expected->hits.object[i] : OBJECT_NONE));
            CHECK(hits.triangle[i] == (is_met ? expected->hits.triangle[i] : NO_TRIANGLE));
            CHECK((occluded >> i & 1) == (uint32_t)is_met);
        }
    }
    return __builtin_popcount(met);
}

static void intersect_mesh(const void *bvh, RayBlock *rays, HitBlock *hits) {
    intersect_bvh(bvh, NULL, OBJECT_STATIC, rays, hits);
}

static uint32_t occlude_mesh(const void *bvh, const RayBlock *rays) {
    return occlude_bvh(bvh, NULL, rays, NULL);
}

static void test_queries(Workers *workers, int rounds) {
    for (int k = 0; k < NUM_KINDS; k++) {
        int32_t count = 1200;
        int met = 0;
        float *corners = make_mesh(&KINDS[k], count);
        Bvh bvh;
        CHECK(build_bvh(&bvh, workers, corners, NULL, count));
        for (int round = 0; round < rounds; round++) {
            float size = KINDS[k].largest;
            if (KINDS[k].put == put_exponential)
                size = powf(10.0f, 1.0f + 10.0f * even()); /* products are normal numbers */
            ray_name = RAYS[round % NUM_RAYS];
            RayBlock rays = make_rays(round % NUM_RAYS, corners, count, size);
            Expected expected = {.hits = no_hits()};
            for (int lane = 0; lane < BLOCK_RAYS; lane++) {
                expected.limit[lane] = rays.limit[lane];
                expected.hits.triangle[lane] =
                    meet_all(corners, count, &rays, lane, &expected.limit[lane]);
                if (expected.hits.triangle[lane] != NO_TRIANGLE)
                    expected.hits.object[lane] = OBJECT_STATIC;
            }
            met += check_rays(&bvh, &rays, &expected, intersect_mesh, occlude_mesh);
        }
        CHECK(met > rounds || k == 6 || k == 8);
        ray_name = "";
        free_bvh(&bvh);
        free(corners);
    }
}

static void intersect_objects(const void *state, RayBlock *rays, HitBlock *hits) {
    intersect_instances(state, rays, hits);
}

static uint32_t occlude_objects(const void *state, const RayBlock *rays) {
    return occlude_instances(state, rays, NULL);
}

static Pose make_pose(void) {
    float turn = 3.0f * even(), tilt = 3.0f * even();
    float c = cosf(turn), s = sinf(turn), d = cosf(tilt), t = sinf(tilt);
    Vec3 at = scale(3.0f, even3());
    return (Pose){{c, -s * d, s * t, s, c * d, -c * t, 0, t, d}, {at.x, at.y, at.z}};
}

/* Ray of a block in the frame of an object at its time. */
static void move_ray(const Frame *frame, int32_t object, const RayBlock *rays, int lane,
                     RayBlock *moved) {
    Pose pose;
    pose_at(frame->object_poses + object, frame->num_poses, frame->num_objects, rays->time[lane], &pose);
    if (frame->num_poses > 1) {
        float rotation[9];
        memcpy(rotation, pose.rotation, sizeof rotation);
        invert_transposed(rotation, pose.rotation);
    }
    Vec3 start = subtract(get_lane(rays->origin, lane), vec3(pose.translation));
    set_lane(moved->origin, lane, rotate_back(pose.rotation, start));
    set_lane(moved->direction, lane, rotate_back(pose.rotation, get_lane(rays->direction, lane)));
}

enum { NUM_OBJECTS = 12, OBJECT_TRIANGLES = 60 };

static void test_instances(Workers *workers, int num_poses, int rounds) {
    float *corners = make_mesh(&KINDS[0], OBJECT_TRIANGLES);
    Mesh mesh = {.arrays = {.corners = corners}}, empty = {.arrays = {.num_triangles = 0}};
    CHECK(build_bvh(&mesh.bvh, workers, corners, NULL, OBJECT_TRIANGLES));
    CHECK(build_bvh(&empty.bvh, workers, NULL, NULL, 0));
    Mesh *objects[NUM_OBJECTS];
    Pose poses[3 * NUM_OBJECTS];
    for (int round = 0, met = 0; round < rounds; round++) {
        for (int i = 0; i < NUM_OBJECTS; i++)
            objects[i] = draw() % 4 ? &mesh : &empty;
        for (int i = 0; i < 3 * NUM_OBJECTS; i++) {
            poses[i] = make_pose();
            if (i >= NUM_OBJECTS) /* turns less than half a turn: the matrices between are regular */
                memcpy(poses[i].rotation, poses[i % NUM_OBJECTS].rotation, sizeof poses[i].rotation);
        }
        Frame frame = {.num_poses = num_poses, .num_objects = NUM_OBJECTS, .objects = objects, .object_poses = poses};
        int failed = 0;
        FrameState state = {.frame = &frame, .objects = create_instances(&frame, &failed)};
        CHECK(!failed && state.objects);
        ray_name = num_poses > 1 ? "moving" : "at rest";
        RayBlock rays = make_rays(round % 3, corners, OBJECT_TRIANGLES, 3.0f), moved = rays;
        Expected expected = {.hits = no_hits()};
        memcpy(expected.limit, rays.limit, sizeof expected.limit);
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            for (int object = 0; object < NUM_OBJECTS; object++) {
                if (objects[object] == &empty)
                    continue;
                move_ray(&frame, object, &rays, lane, &moved);
                int32_t triangle = meet_all(corners, OBJECT_TRIANGLES, &moved, lane, &expected.limit[lane]);
                if (triangle == NO_TRIANGLE)
                    continue;
                expected.hits.triangle[lane] = triangle;
                expected.hits.object[lane] = 1 + object;
            }
        met += check_rays(&state, &rays, &expected, intersect_objects, occlude_objects);
        CHECK(round < rounds - 1 || met > rounds);
        release_instances(state.objects);
    }
    free_bvh(&mesh.bvh);
    free(corners);
}

/* An object whose pose is no number is nowhere, and hides no other. */
static void test_lost_instances(Workers *workers) {
    static const float lost[] = {NAN, INFINITY, 3e38f};
    float *corners = make_mesh(&KINDS[0], OBJECT_TRIANGLES);
    Mesh mesh = {.arrays = {.corners = corners}}, *objects[] = {&mesh, &mesh, &mesh};
    CHECK(build_bvh(&mesh.bvh, workers, corners, NULL, OBJECT_TRIANGLES));
    for (int i = 0; i < 3; i++) {
        Pose poses[] = {make_pose(), make_pose(), make_pose()};
        Frame frame = {.num_poses = 1, .num_objects = 3, .objects = objects, .object_poses = poses};
        RayBlock rays = {.active = 0xffff};
        HitBlock hits = no_hits();
        Vec3 end = add(rotate(poses[2].rotation, vec3(corners)), vec3(poses[2].translation));
        poses[0].translation[i] = poses[1].translation[0] = lost[i];
        poses[1].rotation[4] = lost[i];
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            set_lane(rays.origin, lane, subtract(end, (Vec3){4.0f, 0.01f * (float)lane, 0.0f}));
            set_lane(rays.direction, lane, (Vec3){1.0f, 0.0f, 0.0f});
            rays.limit[lane] = INFINITY;
        }
        int failed = 0;
        FrameState state = {.frame = &frame, .objects = create_instances(&frame, &failed)};
        CHECK(!failed);
        intersect_instances(&state, &rays, &hits);
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            CHECK(hits.object[lane] == OBJECT_NONE || hits.object[lane] == 3);
        release_instances(state.objects);
    }
    free_bvh(&mesh.bvh);
    free(corners);
}

int main(int argc, char **argv) {
    int rounds = argc > 1 ? atoi(argv[1]) : 60;
    seed = argc > 2 ? (uint64_t)atoi(argv[2]) : seed;
    Workers *workers[] = {workers_create(THREADS[0]), workers_create(THREADS[1])};
    CHECK(workers[0] && workers[1]);
    test_structures(workers);
    test_copies(workers[1]);
    test_queries(workers[0], rounds);
    test_instances(workers[0], 1, rounds);
    test_instances(workers[0], 3, rounds);
    test_lost_instances(workers[0]);
    workers_destroy(workers[0]);
    workers_destroy(workers[1]);
    return 0;
}
