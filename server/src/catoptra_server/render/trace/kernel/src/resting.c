/* Provides catoptra_settle and catoptra_separate: how a rigid body comes to rest on what is below,
 * and what separates it from triangles.
 * Float64 twin: simulation/resting.py, formula by formula. Owns nothing beyond a call.
 * Threads: any threads at once: no pool, no state. */
#include "device.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* As in the twin. */
#define TOUCH 2e-5
#define LIFT 0.005
#define MARGIN 0.25
#define PAINT 0.00102
#define EDGE_REACH 0.005
#define NO_WEIGHT 1e-6
enum { MAX_ITERATIONS = 12, MAX_PIVOTS = 60, BATCH = 256 };

typedef struct {
    double rotation[9], translation[3];
} RigidPose;

static void transform_point(const RigidPose *pose, const double point[3], double moved[3]) {
    for (int row = 0; row < 3; row++) {
        const double *axis = pose->rotation + 3 * row;
        moved[row] = point[0] * axis[0] + point[1] * axis[1] + point[2] * axis[2] +
                     pose->translation[row];
    }
}

static double clip_zero(double value) { return fabs(value) < 1e-6 ? 0.0 : value; }

static RigidPose pose_stance(const Stance *stance) {
    double c = stance->cosine, s = stance->sine;
    RigidPose pose = {{c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0}, {stance->x, stance->y, stance->z}};
    if (stance->slope_x == 0.0 && stance->slope_y == 0.0)
        return pose;
    double rise = stance->slope_x * c + stance->slope_y * s, length = sqrt(1.0 + rise * rise);
    double fx = c / length, fy = s / length, fz = rise / length;
    length = sqrt(1.0 + stance->slope_x * stance->slope_x + stance->slope_y * stance->slope_y);
    double dx = -stance->slope_x / length, dy = -stance->slope_y / length, dz = 1.0 / length;
    double rotation[9] = {fx, dy * fz - dz * fy, dx, fy, dz * fx - dx * fz, dy,
                          fz, dx * fy - dy * fx, dz};
    memcpy(pose.rotation, rotation, sizeof rotation);
    return pose;
}

/* Points of the underside, as columns that grow. */
typedef struct {
    double *column[5]; /* x, y, z, gap, limit */
    int32_t count, capacity;
} Points;

static int add_point(Points *points, const double at[3], double gap) {
    if (points->count == points->capacity) {
        int32_t capacity = points->capacity ? 2 * points->capacity : 512;
        for (int n = 0; n < 5; n++) {
            double *grown = realloc(points->column[n], sizeof(double) * (size_t)capacity);
            if (!grown)
                return 0;
            points->column[n] = grown;
        }
        points->capacity = capacity;
    }
    for (int axis = 0; axis < 3; axis++)
        points->column[axis][points->count] = at[axis];
    points->column[3][points->count++] = gap;
    return 1;
}

static void free_points(Points *points) {
    for (int n = 0; n < 5; n++)
        free(points->column[n]);
}

/* Distances straight down from (count, 3) points of the world. */
static void cast_down(const Sinking *job, int count, const double *origins, float *ranges) {
    double starts[3 * BATCH];
    float down[3 * BATCH];
    int32_t triangles[BATCH];
    for (int n = 0; n < 3 * count; n++) {
        starts[n] = origins[n] - job->centre[n % 3];
        down[n] = n % 3 == 2 ? 1.0f : 0.0f;
    }
    if (job->mesh)
        catoptra_cast(job->mesh, count, starts, down, ranges, triangles);
    else
        for (int n = 0; n < count; n++)
            ranges[n] = INFINITY;
}

/* Raised points, whose gaps are measured to what lies below thin layers. */
typedef struct {
    int count;
    int32_t point[BATCH];
    double hits[3 * BATCH];
} Raised;

static void sink_batch(const Sinking *job, Points *points, Raised *raised) {
    float depths[BATCH];
    cast_down(job, raised->count, raised->hits, depths);
    for (int n = 0; n < raised->count; n++) {
        double depth = (double)depths[n] + 1e-5;
        points->column[3][raised->point[n]] += depth <= PAINT ? depth : 0.0;
    }
    raised->count = 0;
}

static void sink_through_paint(const Sinking *job, Points *points, int32_t first) {
    Raised raised;
    raised.count = 0;
    for (int32_t n = first; n < points->count; n++) {
        if (!(points->column[3][n] < -TOUCH))
            continue;
        double *hit = raised.hits + 3 * raised.count;
        hit[0] = points->column[0][n];
        hit[1] = points->column[1][n];
        hit[2] = points->column[2][n] + points->column[3][n] + 1e-5;
        raised.point[raised.count++] = n;
        if (raised.count == BATCH)
            sink_batch(job, points, &raised);
    }
    if (raised.count)
        sink_batch(job, points, &raised);
}

/* Distance straight down to a box, rotation, middle and half sides; 0 inside, INFINITY beside. */
static double drop_on_box(const double box[15], const double origin[3]) {
    double enter = -INFINITY, leave = INFINITY, away[3];
    for (int axis = 0; axis < 3; axis++)
        away[axis] = origin[axis] - box[9 + axis];
    for (int axis = 0; axis < 3; axis++) {
        double start = away[0] * box[axis] + away[1] * box[3 + axis] + away[2] * box[6 + axis];
        double way = box[6 + axis], half = box[12 + axis];
        if (way == 0.0)
            way = 1e-200;
        double first = (-half - start) / way, second = (half - start) / way;
        enter = fmax(enter, fmin(first, second));
        leave = fmin(leave, fmax(first, second));
    }
    return leave < fmax(enter, 0.0) ? INFINITY : fmax(enter, 0.0);
}

/* Heights of the points of the side above what is below; bits of those above robots. */
static int measure_gaps(const Sinking *job, const RigidPose *pose, const double *goal_z,
                        Points *points, uint8_t *is_robot) {
    const RestingSide *side = job->side;
    double origins[3 * BATCH], lifts[BATCH];
    float ranges[BATCH];
    for (int32_t first = 0; first < side->num_points; first += BATCH) {
        int count = side->num_points - first < BATCH ? side->num_points - first : BATCH;
        for (int n = 0; n < count; n++) {
            double *origin = origins + 3 * n;
            transform_point(pose, side->points + 3 * (first + n), origin);
            if (!add_point(points, origin, 0.0))
                return 0;
            /* Rays begin where a point came from that the search took below the floor. */
            lifts[n] = side->lifts[first + n] + fmax(origin[2] - goal_z[first + n], 0.0);
            origin[2] -= lifts[n];
        }
        cast_down(job, count, origins, ranges);
        for (int n = 0; n < count; n++)
            points->column[3][first + n] = (double)ranges[n] - lifts[n];
        sink_through_paint(job, points, first);
        for (int n = 0; n < count; n++) {
            double *gap = points->column[3] + first + n, nearest = INFINITY;
            *gap = fmin(*gap, job->floor_z - points->column[2][first + n]);
            for (int box = 0; box < job->num_boxes; box++)
                nearest = fmin(nearest, drop_on_box(job->boxes + 15 * box, origins + 3 * n));
            /* What a ray begins in is beside the body, not below. */
            nearest = nearest > 0.0 ? nearest - lifts[n] : INFINITY;
            is_robot[first + n] = nearest < *gap;
            *gap = fmin(*gap, nearest);
        }
    }
    return 1;
}

/* A point of the side's plane above a point of a surface in the frame of the side. */
static int add_edge_point(const Sinking *job, const RigidPose *pose, double x, double y, double z,
                          double surface_z, Points *points) {
    double gap = (surface_z - z) / pose->rotation[8], at[3], point[3] = {x, y, z};
    if (!(surface_z > -job->side->rise - LIFT) || !(gap < job->sink + EDGE_REACH))
        return 1;
    transform_point(pose, point, at);
    return add_point(points, at, gap);
}

static int is_within(const RestingSide *side, double x, double y) {
    return fabs(x) <= side->half[0] + 1e-9 && fabs(y) <= side->half[1] + 1e-9;
}

/* Where an edge passes a plane across an axis. */
static int cut_edge(const double *begin, const double *end, int axis, double plane, double at[3]) {
    double start = begin[axis] - plane, stop = end[axis] - plane;
    if ((start < 0.0) == (stop < 0.0))
        return 0;
    double share = start / (start - stop);
    for (int n = 0; n < 3; n++)
        at[n] = begin[n] + share * (end[n] - begin[n]);
    return 1;
}

static int add_triangle_points(const Sinking *job, const RigidPose *pose, const double local[9],
                               Points *points) {
    const RestingSide *side = job->side;
    double at[3];
    for (int corner = 0; corner < 3; corner++) {
        const double *begin = local + 3 * corner, *end = local + 3 * ((corner + 1) % 3);
        if (is_within(side, begin[0], begin[1]) &&
            !add_edge_point(job, pose, begin[0], begin[1], -side->rise, begin[2], points))
            return 0;
        for (int plane = 0; plane < 4; plane++) {
            double limit = side->half[plane / 2] * (plane % 2 ? 1.0 : -1.0);
            if (cut_edge(begin, end, plane / 2, limit, at) && is_within(side, at[0], at[1]) &&
                !add_edge_point(job, pose, at[0], at[1], -side->rise, at[2], points))
                return 0;
        }
        for (int32_t wheel = 0; wheel < side->num_wheels; wheel++) {
            const double *place = side->wheels + 2 * wheel;
            if (!cut_edge(begin, end, 1, place[1], at))
                continue;
            double along = at[0] - place[0], radius = side->radius;
            if (!(fabs(along) < radius))
                continue;
            double rise = radius - sqrt(radius * radius - along * along);
            if (rise < side->rise && !add_edge_point(job, pose, at[0], at[1], -rise, at[2], points))
                return 0;
        }
    }
    return 1;
}

/* Points above edges and corners of surfaces. `calm` receives how far away the nearest thing is
 * that rises above the plane of the side. -1 if memory is short, else their number. */
static int find_edges(const Sinking *job, const RigidPose *pose, Points *points, double *calm) {
    const RestingSide *side = job->side;
    double top = -side->rise - LIFT, bottom = job->sink + EDGE_REACH, reach[2];
    int32_t first = points->count, met = 0;
    for (int axis = 0; axis < 2; axis++)
        reach[axis] = side->half[axis] + side->radius;
    *calm = MARGIN;
    for (int32_t n = 0; n < job->num_triangles; n++) {
        const double *triangle = job->triangles + 9 * n, *m = pose->rotation;
        double local[9], least[3], most[3];
        for (int corner = 0; corner < 3; corner++) {
            double dx = triangle[3 * corner] - pose->translation[0];
            double dy = triangle[3 * corner + 1] - pose->translation[1];
            double dz = triangle[3 * corner + 2] - pose->translation[2];
            for (int axis = 0; axis < 3; axis++)
                local[3 * corner + axis] = dx * m[axis] + dy * m[3 + axis] + dz * m[6 + axis];
        }
        for (int axis = 0; axis < 3; axis++) {
            least[axis] = fmin(fmin(local[axis], local[3 + axis]), local[6 + axis]);
            most[axis] = fmax(fmax(local[axis], local[3 + axis]), local[6 + axis]);
        }
        if (!(least[2] < bottom) || !(most[2] > top))
            continue;
        met++;
        if (least[2] < -2.0 * TOUCH) {
            double away = fmax(fmax(least[0], -most[0]) - reach[0],
                               fmax(least[1], -most[1]) - reach[1]);
            *calm = fmin(*calm, away);
        }
        if (!add_triangle_points(job, pose, local, points))
            return -1;
    }
    *calm = met ? fmin(MARGIN - side->radius, *calm) : MARGIN;
    sink_through_paint(job, points, first);
    return points->count - first;
}

typedef struct {
    double a, b, c;
} Plane;

/* Shares of the weight that three contacts carry. */
static double weigh(const double *x, const double *y, const int32_t p[3], double weights[3]) {
    double a = x[p[0]], b = y[p[0]], c = x[p[1]], d = y[p[1]], e = x[p[2]], f = y[p[2]];
    double parts[3] = {c * f - e * d, e * b - a * f, a * d - c * b};
    double total = parts[0] + parts[1] + parts[2];
    for (int n = 0; n < 3; n++)
        weights[n] = fabs(total) < 1e-12 ? -1.0 : parts[n] / total;
    return fmin(fmin(weights[0], weights[1]), weights[2]);
}

static Plane fit_plane(const double *x, const double *y, const double *gaps, const int32_t p[3]) {
    double dx = x[p[1]] - x[p[0]], dy = y[p[1]] - y[p[0]], dg = gaps[p[1]] - gaps[p[0]];
    double ex = x[p[2]] - x[p[0]], ey = y[p[2]] - y[p[0]], eg = gaps[p[2]] - gaps[p[0]];
    double area = dx * ey - ex * dy;
    Plane plane = {.b = (dg * ey - eg * dy) / area, .c = (dx * eg - ex * dg) / area};
    plane.a = gaps[p[0]] - plane.b * x[p[0]] - plane.c * y[p[0]];
    return plane;
}

/* Three points around the origin; 0 for none. */
static int surround(const double *x, const double *y, int32_t count, int32_t contacts[3]) {
    static const int ways[8][2] = {{1, 0}, {-1, 0}, {0, 1},  {0, -1},
                                   {1, 1}, {1, -1}, {-1, 1}, {-1, -1}};
    int32_t corners[8];
    int found = 0, number = 0;
    for (int way = 0; way < 8; way++) {
        int32_t best = 0;
        for (int32_t n = 1; n < count; n++)
            if (ways[way][0] * x[n] + ways[way][1] * y[n] >
                ways[way][0] * x[best] + ways[way][1] * y[best])
                best = n;
        int is_new = 1;
        for (int n = 0; n < number; n++)
            is_new &= corners[n] != best;
        if (is_new)
            corners[number++] = best;
    }
    double most = -NO_WEIGHT, weights[3];
    for (int i = 0; i < number; i++)
        for (int j = i + 1; j < number; j++)
            for (int k = j + 1; k < number; k++) {
                int32_t one[3] = {corners[i], corners[j], corners[k]};
                double least = weigh(x, y, one, weights);
                if (least > most) {
                    found = 1;
                    most = least;
                    memcpy(contacts, one, sizeof one);
                }
            }
    return found;
}

/* Most level rotation about the two contacts that carry all, which is added to a plane whose
 * (count,) points lie `above` it; the third contact replaces the free one. 0 without any. */
static int rock(const double *x, const double *y, const double *above, int32_t count,
                const double weights[3], const double slopes[2], int32_t contacts[3],
                Plane *plane) {
    int free_one = 0;
    for (int n = 1; n < 3; n++)
        free_one = weights[n] < weights[free_one] ? n : free_one;
    int32_t i = contacts[free_one == 0], j = contacts[free_one == 2 ? 1 : 2];
    double dx = x[j] - x[i], dy = y[j] - y[i], length = sqrt(dx * dx + dy * dy);
    double across[2] = {-dy / length, dx / length}, highest = INFINITY, lowest = -INFINITY;
    for (int32_t n = 0; n < count; n++) {
        double lever = across[0] * (x[n] - x[i]) + across[1] * (y[n] - y[i]);
        if (lever > 1e-6)
            highest = fmin(highest, above[n] / lever);
        else if (lever < -1e-6)
            lowest = fmax(lowest, above[n] / lever);
    }
    if (highest < lowest - 1e-9)
        return 0;
    double slope = fmin(fmax(-(slopes[0] * across[0] + slopes[1] * across[1]), lowest), highest);
    if (!isfinite(slope))
        return 0;
    int32_t third = 0;
    double least = INFINITY;
    for (int32_t n = 0; n < count; n++) {
        double lever = across[0] * (x[n] - x[i]) + across[1] * (y[n] - y[i]);
        if (fabs(lever) > 1e-6 && fabs(above[n] / lever - slope) < least) {
            least = fabs(above[n] / lever - slope);
            third = n;
        }
    }
    plane->a += -(across[0] * x[i] + across[1] * y[i]) * slope;
    plane->b += slope * across[0];
    plane->c += slope * across[1];
    contacts[0] = i;
    contacts[1] = j;
    contacts[2] = third;
    return 1;
}

/* Puts a point in place of one of three contacts, so that the centre stays among them. */
static int exchange(const double *x, const double *y, const double *gaps, int32_t point,
                    int32_t contacts[3]) {
    int32_t best[3];
    double least = INFINITY, weights[3];
    for (int n = 0; n < 3; n++) {
        int32_t one[3] = {contacts[0], contacts[1], contacts[2]};
        one[n] = point;
        if (!(weigh(x, y, one, weights) > -NO_WEIGHT))
            continue;
        /* Of two triangles with the centre on a side only one takes the plane below the point. */
        double sink = fit_plane(x, y, gaps, one).a;
        if (sink < least) {
            least = sink;
            memcpy(best, one, sizeof best);
        }
    }
    if (least < INFINITY)
        memcpy(contacts, best, sizeof best);
    return least < INFINITY;
}

/* Facet of the lower hull of the limits below the centre; 0 where no points lie around it. */
static int find_facet(const double *x, const double *y, const double *gaps, double *above,
                      int32_t count, const double slopes[2], int32_t contacts[3], Plane *plane) {
    double weights[3];
    if ((contacts[0] == contacts[1] || weigh(x, y, contacts, weights) < -NO_WEIGHT) &&
        !surround(x, y, count, contacts))
        return 0;
    for (int pivot = 0; pivot < MAX_PIVOTS; pivot++) {
        *plane = fit_plane(x, y, gaps, contacts);
        int32_t lowest = 0;
        for (int32_t n = 0; n < count; n++) {
            above[n] = gaps[n] - plane->a - plane->b * x[n] - plane->c * y[n];
            lowest = above[n] < above[lowest] ? n : lowest;
        }
        double tilted[2] = {slopes[0] + plane->b, slopes[1] + plane->c};
        double least = weigh(x, y, contacts, weights);
        int on_line = (weights[0] > least) + (weights[1] > least) + (weights[2] > least) == 2;
        if (least < NO_WEIGHT && on_line &&
            rock(x, y, above, count, weights, tilted, contacts, plane))
            return 1;
        int is_contact = lowest == contacts[0] || lowest == contacts[1] || lowest == contacts[2];
        if (above[lowest] >= -1e-9 || is_contact || !exchange(x, y, gaps, lowest, contacts))
            break;
    }
    return 1;
}

/* Whether no point is raised, and each contact is as low as it may sink. */
static int is_at_rest(const Points *points, const int32_t contacts[3]) {
    double lowest = INFINITY, highest = -INFINITY;
    for (int32_t n = 0; n < points->count; n++)
        lowest = fmin(lowest, points->column[3][n]);
    for (int n = 0; n < 3; n++)
        highest = fmax(highest, points->column[4][contacts[n]]);
    return lowest >= -TOUCH && contacts[0] != contacts[1] && highest <= TOUCH;
}

static double least_of(const double *values, int32_t count) {
    double least = INFINITY;
    for (int32_t n = 0; n < count; n++)
        least = fmin(least, values[n]);
    return least;
}

/* Whether triangles that were near a stance are all that is near another. */
static int is_near(const RestingSide *side, const Stance *a, const Stance *b) {
    double turned = fabs(a->slope_x - b->slope_x) + fabs(a->slope_y - b->slope_y);
    double reach = side->half[0] + side->half[1] + side->radius;
    return fabs(a->z - b->z) + reach * turned <= 0.5 * MARGIN;
}

/* One step of the search. */
static RestState settle_once(Sinking *job, const double *goal_z, const double *start_z,
                             Points *points, uint8_t *is_robot) {
    const RestingSide *side = job->side;
    Stance *stance = &job->stance;
    RigidPose pose = pose_stance(stance);
    int has_near = job->triangles && is_near(side, stance, &job->near);
    int wants_edges = job->calm <= 0.0 || job->num_boxes;
    points->count = 0;
    if (wants_edges && !has_near)
        return REST_NEEDS_TRIANGLES;
    for (int n = 0; n < 3; n++)
        if (job->contacts[n] >= side->num_points) /* an edge, which lies elsewhere now */
            memset(job->contacts, 0, sizeof job->contacts);
    if (!measure_gaps(job, &pose, goal_z, points, is_robot))
        return REST_NO_MEMORY;
    double farthest = 0.0;
    for (int32_t n = 0; n < side->num_points; n++) {
        double gap = points->column[3][n];
        points->column[4][n] = fmin(gap, job->sink - (points->column[2][n] - start_z[n]));
        farthest = fmax(farthest, fabs(gap * pose.rotation[8] + side->points[3 * n + 2]));
    }
    int edges = 0;
    if (wants_edges || farthest > 2.0 * TOUCH) {
        if (!has_near)
            return REST_NEEDS_TRIANGLES;
        edges = find_edges(job, &pose, points, &job->calm);
        if (edges < 0)
            return REST_NO_MEMORY;
        for (int32_t n = side->num_points; n < points->count; n++)
            points->column[4][n] = fmin(points->column[3][n], job->sink);
    }
    if (!edges && is_at_rest(points, job->contacts)) {
        job->is_even = !job->has_moved;
        return REST_FOUND;
    }
    double *gaps = points->column[3], *limits = points->column[4];
    if (job->num_steps == MAX_ITERATIONS - 1) {
        /* What does not end, between corners, ends above all of them. */
        double raised = fmin(least_of(gaps, points->count), 0.0);
        for (int32_t n = 0; n < points->count; n++)
            gaps[n] -= raised;
        stance->z += raised;
        job->has_moved = 1;
        return REST_FOUND;
    }
    if (!job->is_lifted && least_of(gaps, points->count) > job->sink + TOUCH) {
        stance->z += job->sink;
        return REST_ALOFT;
    }
    double centre[3];
    transform_point(&pose, side->origin, centre);
    for (int32_t n = 0; n < points->count; n++) {
        points->column[0][n] -= centre[0];
        points->column[1][n] -= centre[1];
    }
    double slopes[2] = {stance->slope_x, stance->slope_y};
    Plane plane;
    if (!find_facet(points->column[0], points->column[1], limits, points->column[2],
                    points->count, slopes, job->contacts, &plane)) {
        /* It falls as it is while it can, and then tips over to another side. */
        double room = least_of(limits, points->count);
        stance->z += room > TOUCH ? room : 0.0;
        return room > TOUCH ? REST_ALOFT : REST_OVER;
    }
    double dx = stance->x - centre[0], dy = stance->y - centre[1];
    double turned = fmax(fabs(plane.b), fabs(plane.c));
    job->has_moved = 1;
    job->calm = turned > TOUCH ? 0.0 : job->calm;
    stance->z = clip_zero(stance->z + plane.a + plane.b * dx + plane.c * dy);
    stance->slope_x = clip_zero(stance->slope_x + plane.b);
    stance->slope_y = clip_zero(stance->slope_y + plane.c);
    return edges && fmax(fabs(plane.a), turned) < TOUCH ? REST_FOUND : REST_MOVES;
}

RestState catoptra_settle(Sinking *job) {
    int32_t count = job->side->num_points;
    Points points = {.count = 0};
    double *goal_z = malloc(2 * sizeof(double) * (size_t)count);
    uint8_t *is_robot = malloc((size_t)count);
    RestState state = goal_z && is_robot ? REST_MOVES : REST_NO_MEMORY;
    if (state == REST_MOVES) {
        RigidPose goal = pose_stance(&job->goal), before = pose_stance(&job->before);
        for (int32_t n = 0; n < count; n++) {
            double at[3], was[3];
            transform_point(&goal, job->side->points + 3 * n, at);
            transform_point(&before, job->side->points + 3 * n, was);
            goal_z[n] = at[2];
            goal_z[count + n] = job->is_lifted ? fmax(at[2], was[2]) : at[2];
        }
        while (job->num_steps < MAX_ITERATIONS && state == REST_MOVES) {
            state = settle_once(job, goal_z, goal_z + count, &points, is_robot);
            job->num_steps += state != REST_NEEDS_TRIANGLES;
        }
    }
    if (state == REST_FOUND) {
        for (int n = 0; n < 3; n++) {
            int32_t one = job->contacts[n];
            job->touching += points.column[3][one] <= 2.0 * TOUCH;
            job->is_on_robot |= one < count ? is_robot[one] : job->num_boxes > 0;
        }
    }
    free_points(&points);
    free(goal_z);
    free(is_robot);
    return state;
}

/* Gap along one axis between a box around the origin and a triangle; -INFINITY without an axis. */
static double gap_along(const double axis[3], const double half[3], const double corners[9]) {
    double least = INFINITY, most = -INFINITY, reach = 0.0;
    double length = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    if (!(length > 1e-12))
        return -INFINITY;
    for (int corner = 0; corner < 3; corner++) {
        const double *at = corners + 3 * corner;
        double along = axis[0] * at[0] + axis[1] * at[1] + axis[2] * at[2];
        least = fmin(least, along);
        most = fmax(most, along);
    }
    for (int n = 0; n < 3; n++)
        reach += fabs(axis[n]) * half[n];
    return (fmax(least, -most) - reach) / length;
}

static double separate_one(const double half[3], const double corners[9]) {
    double gap = -INFINITY, edges[9];
    for (int axis = 0; axis < 3; axis++) {
        double least = fmin(fmin(corners[axis], corners[3 + axis]), corners[6 + axis]);
        double most = fmax(fmax(corners[axis], corners[3 + axis]), corners[6 + axis]);
        gap = fmax(gap, fmax(least, -most) - half[axis]);
    }
    if (gap >= MARGIN)
        return gap;
    for (int n = 0; n < 9; n++)
        edges[n] = corners[(n + 3) % 9] - corners[n];
    for (int corner = 0; corner < 3; corner++) {
        const double *e = edges + 3 * corner;
        double across[3][3] = {{0.0, e[2], -e[1]}, {-e[2], 0.0, e[0]}, {e[1], -e[0], 0.0}};
        for (int n = 0; n < 3; n++)
            gap = fmax(gap, gap_along(across[n], half, corners));
    }
    const double *a = edges, *b = edges + 3;
    double normal[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                        a[0] * b[1] - a[1] * b[0]};
    return fmax(gap, gap_along(normal, half, corners));
}

void catoptra_separate(const double box[15], int64_t count, const double *triangles, double *gaps) {
    for (int64_t n = 0; n < count; n++) {
        double corners[9];
        for (int corner = 0; corner < 3; corner++) {
            double away[3];
            for (int axis = 0; axis < 3; axis++)
                away[axis] = triangles[9 * n + 3 * corner + axis] - box[9 + axis];
            for (int axis = 0; axis < 3; axis++)
                corners[3 * corner + axis] = away[0] * box[axis] + away[1] * box[3 + axis] +
                                             away[2] * box[6 + axis];
        }
        gaps[n] = separate_one(box + 12, corners);
    }
}
