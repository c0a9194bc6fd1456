/* Vectors of three floats. All sums are written out from left to right: with contraction off, the
 * compiler keeps that order, and every processor gives the same bits. */
#ifndef CATOPTRA_VECTORS_H
#define CATOPTRA_VECTORS_H

typedef struct {
    float x, y, z;
} Vec3;

static inline Vec3 vec3(const float *values) { return (Vec3){values[0], values[1], values[2]}; }

static inline Vec3 add(Vec3 a, Vec3 b) { return (Vec3){a.x + b.x, a.y + b.y, a.z + b.z}; }

static inline Vec3 subtract(Vec3 a, Vec3 b) { return (Vec3){a.x - b.x, a.y - b.y, a.z - b.z}; }

static inline Vec3 scale(float factor, Vec3 a) {
    return (Vec3){factor * a.x, factor * a.y, factor * a.z};
}

static inline Vec3 multiply(Vec3 a, Vec3 b) { return (Vec3){a.x * b.x, a.y * b.y, a.z * b.z}; }

static inline float dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline Vec3 cross(Vec3 a, Vec3 b) {
    return (Vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/* Rotation and its inverse; `rotation` is row by row. */
static inline Vec3 rotate(const float *rotation, Vec3 a) {
    return (Vec3){dot(vec3(rotation), a), dot(vec3(rotation + 3), a), dot(vec3(rotation + 6), a)};
}

static inline Vec3 rotate_back(const float *rotation, Vec3 a) {
    return add(add(scale(a.x, vec3(rotation)), scale(a.y, vec3(rotation + 3))),
               scale(a.z, vec3(rotation + 6)));
}

/* Inverse of a matrix, row by row, transposed: what normals are multiplied by. */
static inline void invert_transposed(const float *matrix, float *inverse_transposed) {
    Vec3 row0 = vec3(matrix), row1 = vec3(matrix + 3), row2 = vec3(matrix + 6);
    Vec3 cofactors[3] = {cross(row1, row2), cross(row2, row0), cross(row0, row1)};
    float factor = 1.0f / dot(row0, cofactors[0]);
    for (int row = 0; row < 3; row++) {
        inverse_transposed[3 * row] = factor * cofactors[row].x;
        inverse_transposed[3 * row + 1] = factor * cofactors[row].y;
        inverse_transposed[3 * row + 2] = factor * cofactors[row].z;
    }
}

static inline Vec3 absolute(Vec3 a) {
    return (Vec3){a.x < 0 ? -a.x : a.x, a.y < 0 ? -a.y : a.y, a.z < 0 ? -a.z : a.z};
}

static inline float max_abs(Vec3 a) {
    float x = a.x < 0 ? -a.x : a.x, y = a.y < 0 ? -a.y : a.y, z = a.z < 0 ? -a.z : a.z;
    float xy = x > y ? x : y;
    return xy > z ? xy : z;
}

/* The same in double precision, for what floats are too coarse for. */
static inline double dot3(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Edges of a triangle from its first corner to the two others. */
static inline void edge_vectors(const double corners[9], double first[3], double second[3]) {
    for (int axis = 0; axis < 3; axis++) {
        first[axis] = corners[3 + axis] - corners[axis];
        second[axis] = corners[6 + axis] - corners[axis];
    }
}

/* Barycentric weights of corners 1 and 2 in a point of a triangle's plane; not numbers without
 * area. */
static inline void find_weights(const double corners[9], const double point[3], double weight[2]) {
    double first[3], second[3], offset[3];
    edge_vectors(corners, first, second);
    for (int axis = 0; axis < 3; axis++)
        offset[axis] = point[axis] - corners[axis];
    double aa = dot3(first, first), ab = dot3(first, second), bb = dot3(second, second);
    double x = dot3(first, offset), y = dot3(second, offset), area = aa * bb - ab * ab;
    weight[0] = (bb * x - ab * y) / area;
    weight[1] = (aa * y - ab * x) / area;
}

#endif
