/* Provides body_shade.h: form factors of boxes by Lambert's formula, each face cut off at the
 * horizon.
 * Float64 twin: world/shading.py:box_form_factors. Owns nothing.
 * Threads: any thread of the pool. */
#include "body_shade.h"

#include "lanes.h"

#include <math.h>
#include <string.h>

/* From where shade fades, and where it ends; twins: world/shading.py. */
#define FADE_M 0.6f
#define REACH_M 0.8f
/* What a body moves by during an exposure. */
#define MOTION_M 0.2f
#define HALF_PI 1.57079633f

/* A box in the frame of its body. */
typedef struct {
    Pose pose;
    Vec3 centre, half;
} Body;

typedef struct {
    Floats16 x, y, z;
} Vectors;

static int find_body(const FrameState *state, int object, Body *body) {
    const float *box = state->frame->shades + 6 * (size_t)object;
    object_pose(state, object, &body->pose);
    body->centre = vec3(box);
    body->half = vec3(box + 3);
    return box[3] > 0.0f;
}

/* Centre of a body's box in the frame's coordinates. */
static Vec3 middle_of(const Body *body) {
    return add(rotate(body->pose.rotation, body->centre), vec3(body->pose.translation));
}

int may_be_shaded(const FrameState *state, const Vec3 corners[4]) {
    for (int object = 0; state->frame->shades && object < state->frame->num_objects; object++) {
        Body body;
        if (!find_body(state, object, &body))
            continue;
        float middle[3], squared = 0.0f, reach = REACH_M + sqrtf(dot(body.half, body.half));
        memcpy(middle, (Vec3[]){middle_of(&body)}, sizeof middle);
        for (int axis = 0; axis < 3; axis++) {
            float low = INFINITY, high = -INFINITY;
            for (int i = 0; i < 4; i++) {
                float at = (&corners[i].x)[axis];
                low = fminf(low, at);
                high = fmaxf(high, at);
            }
            float outside = fmaxf(fmaxf(low - middle[axis], middle[axis] - high), 0.0f);
            squared += outside * outside;
        }
        reach += state->plan ? MOTION_M : 0.0f;
        /* Not a number, too. */
        if (!(squared > reach * reach))
            return 1;
    }
    return 0;
}

static Floats16 root16(Floats16 values) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        values[lane] = __builtin_sqrtf(values[lane]);
    return values;
}

/* Angle of a point from the x axis, 0 to pi, by its sine and cosine of any length; to 1e-5.
 * Source: Abramowitz & Stegun 1964, 4.4.49, of fewer terms. */
static Floats16 angle16(Floats16 sine, Floats16 cosine) {
    Floats16 along = absolute16(cosine), larger = most16(sine, along);
    Floats16 x = least16(sine, along) / select16(larger > 0.0f, larger, splat16(1.0f)), xx = x * x;
    Floats16 angle = x * (0.99997726f + xx * (-0.33262347f + xx * (0.19354346f +
                     xx * (-0.11643287f + xx * (0.05265332f - xx * 0.01172120f)))));
    angle = select16(sine > along, HALF_PI - angle, angle);
    return select16(cosine < 0.0f, 2.0f * HALF_PI - angle, angle);
}

static Floats16 dot_vectors(const Vectors *a, const Vectors *b) {
    return a->x * b->x + a->y * b->y + a->z * b->z;
}

/* Angle between two directions times the cosine of the normal of their plane. */
static Floats16 edge_term(const Vectors *a, const Vectors *b, Vec3 normal) {
    Vectors product = {a->y * b->z - a->z * b->y, a->z * b->x - a->x * b->z,
                       a->x * b->y - a->y * b->x};
    Floats16 sine = root16(dot_vectors(&product, &product));
    Floats16 along = product.x * normal.x + product.y * normal.y + product.z * normal.z;
    Floats16 term = along / select16(sine > 0.0f, sine, splat16(1.0f));
    return term * angle16(sine, dot_vectors(a, b));
}

static Vectors blend(Ints16 mask, const Vectors *yes, const Vectors *no) {
    return (Vectors){select16(mask, yes->x, no->x), select16(mask, yes->y, no->y),
                     select16(mask, yes->z, no->z)};
}

/* Twice pi times the form factor of a quadrilateral from 16 points, seen from inside. */
static Floats16 face_term(const Vectors corners[4], Vec3 normal) {
    Vectors none = {splat16(0.0f), splat16(0.0f), splat16(0.0f)}, in = none, out = none;
    Floats16 total = splat16(0.0f);
    for (int i = 0; i < 4; i++) {
        const Vectors *a = &corners[i], *b = &corners[(i + 1) & 3];
        Floats16 first = a->x * normal.x + a->y * normal.y + a->z * normal.z;
        Floats16 second = b->x * normal.x + b->y * normal.y + b->z * normal.z;
        Ints16 rises = (first < 0.0f) & (second >= 0.0f), sinks = (first >= 0.0f) & (second < 0.0f);
        Floats16 share = first / select16(rises | sinks, first - second, splat16(1.0f));
        Vectors cut = {a->x + share * (b->x - a->x), a->y + share * (b->y - a->y),
                       a->z + share * (b->z - a->z)};
        in = blend(rises, &cut, &in);
        out = blend(sinks, &cut, &out);
        Vectors begin = blend(rises, &cut, a), end = blend(sinks, &cut, b);
        Floats16 term = edge_term(&begin, &end, normal);
        total += select16((first < 0.0f) & (second < 0.0f), splat16(0.0f), term);
    }
    /* Along the horizon. */
    return total + edge_term(&out, &in, normal);
}

/* Form factors of a box of (3,) half sides from (3, 16) points in its frame, and distances of
 * these. */
static Floats16 box_term(const float half[3], const float points[3][BLOCK_RAYS], Vec3 normal,
                         Floats16 *squared) {
    Floats16 total = splat16(0.0f);
    *squared = splat16(0.0f);
    for (int axis = 0; axis < 3; axis++) {
        int b = (axis + 1) % 3, c = (axis + 2) % 3;
        Floats16 at = load16(points[axis]);
        Ints16 is_before = absolute16(at) > splat16(half[axis]);
        Floats16 side = select16(at > 0.0f, splat16(1.0f), splat16(-1.0f));
        Floats16 outside = select16(is_before, absolute16(at) - half[axis], splat16(0.0f));
        *squared += outside * outside;
        if (!bits16(is_before))
            continue;
        Vectors corners[4];
        for (int i = 0; i < 4; i++) {
            float sign_b = i == 0 || i == 3 ? 1.0f : -1.0f, sign_c = i < 2 ? 1.0f : -1.0f;
            Floats16 *corner = &corners[i].x;
            corner[axis] = side * half[axis] - at;
            corner[b] = sign_b * half[b] - load16(points[b]);
            corner[c] = sign_c * half[c] - load16(points[c]);
        }
        total -= select16(is_before, side * face_term(corners, normal), splat16(0.0f));
    }
    return total * (0.25f / HALF_PI);
}

int find_open_parts(const FrameState *state, uint32_t mask, const float ends[3][BLOCK_RAYS],
                    Vec3 normal, float parts[BLOCK_RAYS]) {
    int is_any = 0;
    store16(splat16(1.0f), parts);
    for (int object = 0; state->frame->shades && object < state->frame->num_objects; object++) {
        Body body;
        if (!find_body(state, object, &body))
            continue;
        float reach = REACH_M + sqrtf(dot(body.half, body.half));
        Vec3 middle = middle_of(&body);
        Floats16 offset[3] = {load16(ends[0]) - middle.x, load16(ends[1]) - middle.y,
                              load16(ends[2]) - middle.z};
        Floats16 squared = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
        if (!(bits16(squared < splat16(reach * reach)) & mask))
            continue;
        const float *rows = body.pose.rotation;
        float points[3][BLOCK_RAYS], half[3] = {body.half.x, body.half.y, body.half.z};
        for (int axis = 0; axis < 3; axis++)
            store16(offset[0] * rows[axis] + offset[1] * rows[3 + axis] + offset[2] * rows[6 + axis],
                    points[axis]);
        Vec3 turned = rotate_back(rows, normal);
        Floats16 shade = box_term(half, (const float(*)[BLOCK_RAYS])points, turned, &squared);
        Floats16 fade = (REACH_M - root16(squared)) * (1.0f / (REACH_M - FADE_M));
        fade = least16(most16(fade, splat16(0.0f)), splat16(1.0f));
        shade = fade * least16(most16(shade, splat16(0.0f)), splat16(1.0f));
        store16(load16(parts) * (1.0f - shade), parts);
        is_any |= (bits16(shade > 0.0f) & mask) != 0;
    }
    return is_any;
}
