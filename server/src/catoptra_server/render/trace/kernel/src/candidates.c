/* Provides candidates.h: lists of what a part of the image may show, kept by beam.
 * No twin: conservative bounds. A list owns one block of floats, from candidates_allocate to
 * candidates_free.
 * Threads: the thread that has the list; the frame's list of objects is only read by the others. */
#include "candidates.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BOX_TRIANGLES = 12 };

/* Candidates of whole vectors: most lists are shorter than two. What lies behind a list's end is
 * computed, and not read. */
#define FOR_BLOCKS(i, count)                                                                       \
    for (int block = 0; block < (count); block += LANES)                                           \
        for (int i = block; i < block + LANES; i++)

size_t whole_blocks(int count) { return (size_t)(count / LANES + 1) * LANES; }

int candidates_allocate(CandidateList *list, int capacity) {
    /* One block: nine coordinates, radius, reach and identifier of each candidate. */
    size_t length = whole_blocks(capacity);
    float *values = malloc(sizeof(float) * 12 * length);
    if (!values)
        return 0;
    for (size_t i = 0; i < 9; i++)
        list->corner[i] = values + i * length;
    list->radius = values + 9 * length;
    list->reach = values + 10 * length;
    list->id = (int32_t *)(values + 11 * length);
    list->count = 0;
    return 1;
}

void candidates_free(CandidateList *list) {
    free(list->corner[0]);
    list->corner[0] = NULL;
}

static float length_of(Vec3 vector) { return sqrtf(dot(vector, vector)); }

static void append(const FrameState *state, CandidateList *list, const Vec3 corners[3],
                   float radius, int32_t id) {
    int at = list->count++;
    float distance = 0.0f;
    for (int corner = 0; state->turn > 0.0f && corner < 3; corner++)
        distance = fmaxf(distance, length_of(corners[corner]));
    list->reach[at] = radius + state->shift + state->turn * (distance + radius);
    for (int corner = 0; corner < 3; corner++) {
        list->corner[3 * corner][at] = corners[corner].x;
        list->corner[3 * corner + 1][at] = corners[corner].y;
        list->corner[3 * corner + 2][at] = corners[corner].z;
    }
    list->radius[at] = radius;
    list->id[at] = id;
}

Vec3 candidate_corner(const CandidateList *list, int at, int corner) {
    return (Vec3){list->corner[3 * corner][at], list->corner[3 * corner + 1][at],
                  list->corner[3 * corner + 2][at]};
}

Vec3 corner_from_apex(const CandidateList *list, int at, int corner, const BeamSides *sides) {
    return subtract(candidate_corner(list, at, corner), sides->apex);
}

void candidate_copy(const CandidateList *from, int at, CandidateList *to) {
    int next = to->count++;
    if (to == from && next == at)
        return;
    for (int component = 0; component < 9; component++)
        to->corner[component][next] = from->corner[component][at];
    to->radius[next] = from->radius[at];
    to->reach[next] = from->reach[at];
    to->id[next] = from->id[at];
}

/* Rounding errors of boxes, normals and sums of products, relative to the coordinates. */
#define BOX_ROUNDING 2e-6f
#define VIEWPOINT_ROUNDING 0x1p-24f
/* A node is one sphere if it is seen smaller than so many tiles: with larger ones more tiles beside
 * things are traced, with smaller ones lists are longer. */
#define CLUSTER_TILES 2.5f

/* The viewpoint in the coordinates of the scene's boxes. */
static Vec3 scene_viewpoint(const FrameState *state) {
    const double *origin = state->frame->origin;
    const float *at = state->camera.translation;
    return (Vec3){(float)(origin[0] + (double)at[0]), (float)(origin[1] + (double)at[1]),
                  (float)(origin[2] + (double)at[2])};
}

/* The children of a node as bit masks: those that may reach into a beam, and those seen small. */
typedef struct {
    uint32_t inside, small;
} Children;

static Children find_children(const FrameState *state, const BvhNode *node,
                              const BeamSides *sides) {
    const Vec3 apex = sides->apex, at = scene_viewpoint(state);
    const float viewpoint[3] = {at.x, at.y, at.z};
    Floats8 least[3], most[3], distance = {0}, diagonal = {0};
    Floats8 extent = splat8(fabsf(apex.x) + fabsf(apex.y) + fabsf(apex.z));
    for (int axis = 0; axis < 3; axis++) {
        least[axis] = node->bounds[axis] - viewpoint[axis];
        most[axis] = node->bounds[3 + axis] - viewpoint[axis];
        Floats8 twice = least[axis] + most[axis], side = most[axis] - least[axis];
        distance += twice * twice;
        diagonal += side * side;
        extent += most8(absolute8(least[axis]), absolute8(most[axis]));
    }
    /* The viewpoint moves, and turns: points by so much at their distance. */
    Floats8 reach = (BOX_ROUNDING + state->turn) * extent + state->shift;
    /* Boxes have a reserve for places within the scene; one far from it is rounded by more. */
    reach += VIEWPOINT_ROUNDING * max_abs(at);
    Ints8 is_outside = {0};
    for (int i = 0; i < 4; i++) {
        Vec3 n = sides->normal[i];
        Floats8 nearest = n.x * (n.x > 0.0f ? most[0] : least[0]) +
                          n.y * (n.y > 0.0f ? most[1] : least[1]) +
                          n.z * (n.z > 0.0f ? most[2] : least[2]);
        is_outside |= nearest < dot(n, apex) - reach;
    }
    float size = 0.5f * CLUSTER_TILES * sides->tile;
    return (Children){~bits8(is_outside) & ((1u << LANES) - 1),
                      bits8(diagonal < size * size * distance)};
}

static void append_cluster(const FrameState *state, const BvhNode *node, int child,
                           CandidateList *list) {
    Vec3 at = scene_viewpoint(state);
    float viewpoint[3] = {at.x, at.y, at.z}, centre[3], squared = 0.0f, extent = 0.0f;
    for (int axis = 0; axis < 3; axis++) {
        float least = node->bounds[axis][child], most = node->bounds[3 + axis][child];
        centre[axis] = 0.5f * (least + most) - viewpoint[axis];
        squared += (most - least) * (most - least);
        extent += fabsf(least) + fabsf(most);
    }
    Vec3 corner = vec3(centre);
    append(state, list, (Vec3[3]){corner, corner, corner},
           0.5f * sqrtf(squared) + BOX_ROUNDING * extent, CLUSTER);
}

/* Corners of a triangle of the static scene, relative to the viewpoint. */
static void append_triangle(const FrameState *state, int32_t triangle, CandidateList *list) {
    Vec3 viewpoint = vec3(state->camera.translation), relative[3];
    for (int corner = 0; corner < 3; corner++)
        relative[corner] = subtract(scene_corner(state, triangle, corner), viewpoint);
    append(state, list, relative, 0.0f, triangle);
}

static void append_leaf(const FrameState *state, const int32_t triangles[LEAF_TRIANGLES],
                        CandidateList *list) {
    for (int lane = 0; lane < LEAF_TRIANGLES; lane++)
        if (triangles[lane] != NO_TRIANGLE)
            append_triangle(state, triangles[lane], list);
}

int add_scene(const FrameState *state, const BeamSides *sides, int max_count,
              CandidateList *list) {
    const Bvh *bvh = &state->scene->mesh->bvh;
    int32_t stack[MAX_STACK] = {0};
    int height = bvh->num_nodes > 0, num_visited = 0;
    while (height) {
        const BvhNode *node = bvh->nodes + stack[--height];
        Children children = find_children(state, node, sides);
        /* All of a node's children fit, or none is looked at. */
        if (list->count + LANES * LEAF_TRIANGLES > max_count || ++num_visited > max_count)
            return 0;
        for (uint32_t left = children.inside; left; left &= left - 1) {
            int slot = __builtin_ctz(left);
            int32_t child = node->child[slot];
            if (child == NO_CHILD)
                continue;
            if (children.small >> slot & 1)
                append_cluster(state, node, slot, list);
            else if (child >= 0)
                stack[height++] = child;
            else
                append_leaf(state, leaf_triangles(bvh, ~child), list);
        }
    }
    return 1;
}

/* Corners of a box, numbered by their signs in x (4), y (2) and z (1). */
static void find_box_corners(const Pose *pose, const float *box, Vec3 viewpoint, Vec3 corners[8]) {
    for (int i = 0; i < 8; i++) {
        Vec3 sign = {i & 4 ? 1.0f : -1.0f, i & 2 ? 1.0f : -1.0f, i & 1 ? 1.0f : -1.0f};
        Vec3 local = add(vec3(box), multiply(sign, vec3(box + 3)));
        Vec3 placed = add(rotate(pose->rotation, local), vec3(pose->translation));
        corners[i] = subtract(placed, viewpoint);
    }
}

/* Bit mask of the sides that face a point within `radius` of the viewpoint: -x, +x, -y, +y, -z, +z.
 * All, if one is within. */
static uint32_t find_facing_sides(const Pose *pose, const float *box, Vec3 viewpoint,
                                  float radius) {
    Vec3 seen_from = rotate_back(pose->rotation, subtract(viewpoint, vec3(pose->translation)));
    Vec3 offset = subtract(seen_from, vec3(box));
    Vec3 from_centre = absolute(offset), half = vec3(box + 3), r = {radius, radius, radius};
    Vec3 outside = subtract(from_centre, add(half, r));
    if (!(outside.x > 0.0f || outside.y > 0.0f || outside.z > 0.0f))
        return 0x3f;
    half = subtract(half, r);
    return (uint32_t)(offset.x < -half.x) | (uint32_t)(offset.x > half.x) << 1 |
           (uint32_t)(offset.y < -half.y) << 2 | (uint32_t)(offset.y > half.y) << 3 |
           (uint32_t)(offset.z < -half.z) << 4 | (uint32_t)(offset.z > half.z) << 5;
}

/* Largest displacement of a box's corners in the world while a proof has to hold: at all poses of
 * the exposure, of which a proof's time is a part. */
static float find_box_displacement(const FrameState *state, int box, const Vec3 corners[8]) {
    const Frame *frame = state->frame;
    float displacement = 0.0f;
    for (int step = 0; step < frame->num_poses; step++) {
        Vec3 moved[8];
        const Pose *poses = frame->object_poses + step * frame->num_objects;
        find_box_corners(poses + frame->box_object[box], frame->boxes + 6 * box,
                         vec3(state->camera.translation), moved);
        for (int i = 0; i < 8; i++)
            displacement = fmaxf(displacement, length_of(subtract(moved[i], corners[i])));
    }
    return displacement;
}

/* An object reaches into a beam only through those sides of its boxes that face the viewpoint. */
static void append_box(const FrameState *state, CandidateList *list, int box) {
    static const uint8_t sides[6][4] = {
        {0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5},
    };
    const Frame *frame = state->frame;
    const float *shape = frame->boxes + 6 * box;
    Vec3 viewpoint = vec3(state->camera.translation), corners[8];
    int32_t id = OBJECT_BOX - frame->box_object[box];
    Pose pose;
    object_pose(state, frame->box_object[box], &pose);
    find_box_corners(&pose, shape, viewpoint, corners);
    /* A side that turns towards the viewpoint later faces it, too. */
    int is_moving = state->shift > 0.0f || state->turn > 0.0f;
    uint32_t facing = is_moving ? 0x3f : find_facing_sides(&pose, shape, viewpoint,
                                                          state->view->max_origin_m);
    float radius = is_moving ? find_box_displacement(state, box, corners) : 0.0f;
    for (int side = 0; side < 6; side++) {
        if (!(facing >> side & 1))
            continue;
        const uint8_t *corner = sides[side];
        Vec3 first = corners[corner[0]], opposite = corners[corner[2]];
        append(state, list, (Vec3[3]){first, corners[corner[1]], opposite}, radius, id);
        append(state, list, (Vec3[3]){first, opposite, corners[corner[3]]}, radius, id);
    }
}

int candidates_collect(CandidateList *list, const FrameState *state) {
    const Frame *frame = state->frame;
    if (!candidates_allocate(list, BOX_TRIANGLES * frame->num_boxes))
        return 0;
    for (int box = 0; box < frame->num_boxes; box++)
        append_box(state, list, box);
    return 1;
}

static Vec3 inward(const float *rotation, Vec3 side, float tangent, float sign, Vec3 axis) {
    Vec3 normal = scale(sign, subtract(side, scale(tangent, axis)));
    return rotate(rotation, scale(1.0f / sqrtf(dot(normal, normal)), normal));
}

static void find_origin(const float *rotation, const BeamOrigin *origin, BeamSides *sides) {
    sides->apex = rotate(rotation, origin->apex);
    sides->centre = rotate(rotation, origin->centre);
    sides->radius = origin->radius;
}

void find_sides(const FrameState *state, const BeamLevel *parts, int part, BeamSides *sides) {
    const float *rotation = state->camera.rotation;
    const Beam *beam = &parts->beams[part];
    sides->apex = sides->centre = (Vec3){0, 0, 0};
    sides->radius = 0.0f;
    if (parts->origins)
        find_origin(rotation, &parts->origins[part], sides);
    sides->normal[0] = inward(rotation, beam->a, beam->a_min, 1.0f, beam->axis);
    sides->normal[1] = inward(rotation, beam->a, beam->a_max, -1.0f, beam->axis);
    sides->normal[2] = inward(rotation, beam->b, beam->b_min, 1.0f, beam->axis);
    sides->normal[3] = inward(rotation, beam->b, beam->b_max, -1.0f, beam->axis);
    sides->axis = rotate(rotation, beam->axis);
    int level = (int)(parts - state->view->levels);
    sides->tile = fminf(beam->a_max - beam->a_min, beam->b_max - beam->b_min) / (float)(1 << level);
    for (int i = 0; i < 4; i++) {
        Vec3 edge = cross(sides->normal[i / 2], sides->normal[2 + i % 2]);
        sides->edge[i] = dot(edge, sides->axis) < 0.0f ? scale(-1.0f, edge) : edge;
    }
}

/* Mark the candidates that lie on the outer side of one of the beam's sides. */
static inline __attribute__((always_inline)) void
mark_outside(const CandidateList *list, const BeamSides *sides, int has_apex,
             uint8_t *restrict marks) {
    const float *restrict x0 = list->corner[0], *restrict y0 = list->corner[1];
    const float *restrict z0 = list->corner[2], *restrict x1 = list->corner[3];
    const float *restrict y1 = list->corner[4], *restrict z1 = list->corner[5];
    const float *restrict x2 = list->corner[6], *restrict y2 = list->corner[7];
    const float *restrict z2 = list->corner[8], *restrict reach = list->reach;
    const Vec3 n[4] = {sides->normal[0], sides->normal[1], sides->normal[2], sides->normal[3]};
    const float at_apex[4] = {
        has_apex ? dot(n[0], sides->apex) : 0.0f, has_apex ? dot(n[1], sides->apex) : 0.0f,
        has_apex ? dot(n[2], sides->apex) : 0.0f, has_apex ? dot(n[3], sides->apex) : 0.0f};
    FOR_BLOCKS(i, list->count) {
        int is_outside = 0;
        /* All sides in one pass: the coordinates are loaded once. */
        for (int side = 0; side < 4; side++) {
            float first = n[side].x * x0[i] + n[side].y * y0[i] + n[side].z * z0[i];
            float second = n[side].x * x1[i] + n[side].y * y1[i] + n[side].z * z1[i];
            float third = n[side].x * x2[i] + n[side].y * y2[i] + n[side].z * z2[i];
            float nearer = first > second ? first : second;
            float nearest = nearer > third ? nearer : third;
            is_outside |= nearest < at_apex[side] - reach[i];
        }
        marks[i] = (uint8_t)is_outside;
    }
}

/* Largest error of a cross product's components, relative to the product of the lengths: a few
 * times 2^-24. It is all that is left of the product of corners on either side of the viewpoint. */
#define CROSS_ERROR 3e-7f

/* Mark the triangles that a plane through the viewpoint and one of their sides separates from the
 * beam: with the beam's own sides, all planes that can separate two pyramids of one apex. */
static inline __attribute__((always_inline)) void
mark_beside(const CandidateList *list, const BeamSides *sides, int has_apex, int side,
            uint8_t *restrict marks) {
    int next = (side + 1) % 3, opposite = (side + 2) % 3;
    const float *restrict ax = list->corner[3 * side], *restrict ay = list->corner[3 * side + 1];
    const float *restrict az = list->corner[3 * side + 2], *restrict bx = list->corner[3 * next];
    const float *restrict by = list->corner[3 * next + 1];
    const float *restrict bz = list->corner[3 * next + 2];
    const float *restrict cx = list->corner[3 * opposite];
    const float *restrict cy = list->corner[3 * opposite + 1];
    const float *restrict cz = list->corner[3 * opposite + 2], *restrict reach = list->reach;
    const Vec3 apex = has_apex ? sides->apex : (Vec3){0, 0, 0};
    const Vec3 e0 = sides->edge[0], e1 = sides->edge[1], e2 = sides->edge[2], e3 = sides->edge[3];
    FOR_BLOCKS(i, list->count) {
        float px = ax[i] - apex.x, py = ay[i] - apex.y, pz = az[i] - apex.z;
        float qx = bx[i] - apex.x, qy = by[i] - apex.y, qz = bz[i] - apex.z;
        float ox = cx[i] - apex.x, oy = cy[i] - apex.y, oz = cz[i] - apex.z;
        float x = py * qz - pz * qy;
        float y = pz * qx - px * qz;
        float z = px * qy - py * qx;
        float height = x * ox + y * oy + z * oz;
        float p0 = height * (x * e0.x + y * e0.y + z * e0.z);
        float p1 = height * (x * e1.x + y * e1.y + z * e1.z);
        float p2 = height * (x * e2.x + y * e2.y + z * e2.z);
        float p3 = height * (x * e3.x + y * e3.y + z * e3.z);
        float aa = px * px + py * py + pz * pz;
        float bb = qx * qx + qy * qy + qz * qz;
        float cc = ox * ox + oy * oy + oz * oz;
        /* Corners that move by their reach change the normal by that times the other's length. */
        float a = sqrtf(aa), b = sqrtf(bb), c = sqrtf(cc), r = reach[i];
        float error = CROSS_ERROR * a * b + r * (a + b + r), square = height * height;
        float turned = error * c + r * (a + r) * (b + r);
        /* A triangle whose plane holds the viewpoint is seen as a line, which has no sides; nor has
         * a sphere, whose corners are one point. */
        float limit = -error * fabsf(height);
        marks[i] |= (square > turned * turned) & (p0 < limit) & (p1 < limit) & (p2 < limit) &
                    (p3 < limit);
    }
}

int is_beam_beside(const BeamSides *sides, Vec3 from, Vec3 to, float reach) {
    Vec3 normal = cross(from, to);
    float error = CROSS_ERROR * sqrtf(dot(from, from) * dot(to, to));
    if (reach > 0.0f)
        error += reach * (length_of(from) + length_of(to) + reach);
    int is_below = 1, is_above = 1;
    for (int i = 0; i < 4; i++) {
        float height = dot(normal, sides->edge[i]);
        is_below &= height < -error;
        is_above &= height > error;
    }
    return is_below | is_above;
}

static void copy_unmarked(const CandidateList *from, const uint8_t *marks, CandidateList *to) {
    static const uint8_t all_marked[8] = {1, 1, 1, 1, 1, 1, 1, 1};
    int count = from->count;
    to->count = 0;
    for (int i = 0; i < count; i++) {
        /* Most candidates are outside: eight at a time. */
        if (i % 8 == 0 && i + 8 <= count && !memcmp(marks + i, all_marked, 8)) {
            i += 7;
            continue;
        }
        if (!marks[i])
            candidate_copy(from, i, to);
    }
}

static inline __attribute__((always_inline)) void
keep_inside_from(const CandidateList *from, const BeamSides *sides, int has_apex, uint8_t *marks,
                 CandidateList *kept) {
    mark_outside(from, sides, has_apex, marks);
    copy_unmarked(from, marks, kept);
    memset(marks, 0, (size_t)kept->count);
    for (int side = 0; side < 3; side++)
        mark_beside(kept, sides, has_apex, side, marks);
    copy_unmarked(kept, marks, kept);
}

void keep_inside(const CandidateList *from, const BeamSides *sides, uint8_t *marks,
                 CandidateList *kept) {
    /* Two loops each: beams from the viewpoint, which most cameras have, subtract nothing. */
    if (sides->radius > 0.0f)
        keep_inside_from(from, sides, 1, marks, kept);
    else
        keep_inside_from(from, sides, 0, marks, kept);
}

/* Moeller and Trumbore 1997, from the apex. */
void measure_distances(const CandidateList *list, const BeamSides *sides,
                       float *restrict distances) {
    const Vec3 d = sides->axis, apex = sides->apex;
    const float *restrict x0 = list->corner[0], *restrict y0 = list->corner[1];
    const float *restrict z0 = list->corner[2], *restrict x1 = list->corner[3];
    const float *restrict y1 = list->corner[4], *restrict z1 = list->corner[5];
    const float *restrict x2 = list->corner[6], *restrict y2 = list->corner[7];
    const float *restrict z2 = list->corner[8];
    FOR_BLOCKS(i, list->count) {
        float ux = x1[i] - x0[i], uy = y1[i] - y0[i], uz = z1[i] - z0[i];
        float vx = x2[i] - x0[i], vy = y2[i] - y0[i], vz = z2[i] - z0[i];
        float px = d.y * vz - d.z * vy, py = d.z * vx - d.x * vz, pz = d.x * vy - d.y * vx;
        float sx = x0[i] - apex.x, sy = y0[i] - apex.y, sz = z0[i] - apex.z;
        float qx = uy * sz - uz * sy, qy = uz * sx - ux * sz;
        float qz = ux * sy - uy * sx;
        /* A triangle without area, or seen as a line: divided by zero, and no comparison holds. */
        float inverse = 1.0f / (ux * px + uy * py + uz * pz);
        float u = -(sx * px + sy * py + sz * pz) * inverse;
        float v = (d.x * qx + d.y * qy + d.z * qz) * inverse;
        float distance = (vx * qx + vy * qy + vz * qz) * inverse;
        int is_met = (u >= 0.0f) & (v >= 0.0f) & (u + v <= 1.0f) & (distance > 0.0f);
        distances[i] = is_met ? distance : INFINITY;
    }
}
