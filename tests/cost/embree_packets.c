/* The yardstick of the kernel's rays: coherent packets of Embree, as wide as its registers, in
 * threads of their own. A frame turns the rays of a camera and finds which triangle each meets.
 *
 * Embree 4 comes with the Python package embreex, without headers; the declarations follow its
 * embree4/rtcore*.h (Apache-2.0).
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { TRIANGLES = 0, INDEX = 0, VERTEX = 1, UINT3 = 0x5003, FLOAT3 = 0x9003, COHERENT = 1 << 16 };
enum { ROBUST = 1 << 2, NATIVE_RAY16 = 34, BLOCK = 16, BLOCKS_AT_ONCE = 32, MAX_THREADS = 64 };

typedef struct {
    int32_t flags, features;
    void *context, *filter, *callback;
    float spare[8];
} Arguments;

#define DECLARE_PACKET(N)                                                                          \
    typedef struct {                                                                               \
        _Alignas(4 * N) float origin[3][N];                                                        \
        float tnear[N], direction[3][N], time[N], tfar[N];                                         \
        uint32_t mask[N], id[N], flags[N];                                                         \
        float normal[3][N], u[N], v[N];                                                            \
        uint32_t triangle[N], geometry[N], instance[N], spare[N];                                  \
    } Packet##N;

DECLARE_PACKET(8)
DECLARE_PACKET(16)

static struct {
    void *(*new_device)(const char *);
    long (*get_property)(void *, int);
    void *(*new_scene)(void *);
    void (*set_flags)(void *, int);
    void *(*new_geometry)(void *, int);
    void (*set_shared)(void *, int, unsigned, int, const void *, size_t, size_t, size_t);
    void *(*set_new)(void *, int, unsigned, int, size_t, size_t);
    void (*commit_geometry)(void *);
    unsigned (*attach)(void *, void *);
    void (*commit_scene)(void *);
    void (*intersect8)(const int *, void *, Packet8 *, Arguments *);
    void (*intersect16)(const int *, void *, Packet16 *, Arguments *);
} rtc;

static const char *const NAMES[] = {
    "rtcNewDevice", "rtcGetDeviceProperty", "rtcNewScene", "rtcSetSceneFlags", "rtcNewGeometry",
    "rtcSetSharedGeometryBuffer", "rtcSetNewGeometryBuffer", "rtcCommitGeometry",
    "rtcAttachGeometry", "rtcCommitScene", "rtcIntersect8", "rtcIntersect16",
};

typedef struct {
    void *device, *scene;
    int threads, width;
    pthread_t pool[MAX_THREADS];
    pthread_barrier_t begin, end;
    const float *directions, *pose; /* (blocks, 3, 16), and (3, 4) */
    const uint16_t *valid;          /* (blocks,) */
    int blocks;
    atomic_int next;
    atomic_llong hits;
} Yardstick;

#define DEFINE_TRACE(N)                                                                            \
    static int trace##N(const Yardstick *y, int block, int first) {                                \
        Packet##N p;                                                                               \
        _Alignas(64) int valid[N];                                                                 \
        Arguments arguments = {.flags = COHERENT, .features = -1};                                 \
        const float *from = y->directions + 3 * BLOCK * (size_t)block + first, *m = y->pose;       \
        int hits = 0;                                                                              \
        for (int axis = 0; axis < 3; axis++)                                                       \
            for (int i = 0; i < N; i++) {                                                          \
                p.origin[axis][i] = m[4 * axis + 3];                                               \
                p.direction[axis][i] = m[4 * axis] * from[i] + m[4 * axis + 1] * from[BLOCK + i] + \
                                       m[4 * axis + 2] * from[2 * BLOCK + i];                      \
            }                                                                                      \
        for (int i = 0; i < N; i++) {                                                              \
            p.tnear[i] = p.time[i] = 0.0f;                                                         \
            p.tfar[i] = INFINITY;                                                                  \
            p.mask[i] = p.geometry[i] = ~0u;                                                       \
            p.flags[i] = 0;                                                                        \
            valid[i] = y->valid[block] >> (first + i) & 1 ? -1 : 0;                                \
        }                                                                                          \
        rtc.intersect##N(valid, y->scene, &p, &arguments);                                         \
        for (int i = 0; i < N; i++)                                                                \
            hits += valid[i] && p.geometry[i] != ~0u;                                              \
        return hits;                                                                               \
    }

DEFINE_TRACE(8)
DEFINE_TRACE(16)

static void trace_part(Yardstick *y) {
    int first;
    long long hits = 0;
    while ((first = atomic_fetch_add(&y->next, BLOCKS_AT_ONCE)) < y->blocks)
        for (int block = first; block < first + BLOCKS_AT_ONCE && block < y->blocks; block++)
            hits += y->width == 16 ? trace16(y, block, 0)
                                   : trace8(y, block, 0) + trace8(y, block, 8);
    atomic_fetch_add(&y->hits, hits);
}

static void *serve(void *yardstick) {
    Yardstick *y = yardstick;
    for (;;) {
        pthread_barrier_wait(&y->begin);
        trace_part(y);
        pthread_barrier_wait(&y->end);
    }
    return NULL;
}

/* Triangles of (count, 3, 3) corners, which stay and are followed by 4 floats; NULL if the library
 * lacks a function. Threads end with the process. */
__attribute__((visibility("default"))) Yardstick *
open_yardstick(const char *path, const char *config, int threads, const float *corners, int count) {
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL), **functions = (void **)&rtc;
    for (size_t i = 0; i < sizeof NAMES / sizeof *NAMES; i++)
        if (!library || !(functions[i] = dlsym(library, NAMES[i])))
            return NULL;
    Yardstick *y = calloc(1, sizeof *y);
    y->device = rtc.new_device(config);
    y->scene = rtc.new_scene(y->device);
    rtc.set_flags(y->scene, ROBUST);
    void *geometry = rtc.new_geometry(y->device, TRIANGLES);
    rtc.set_shared(geometry, VERTEX, 0, FLOAT3, corners, 0, 12, 3 * (size_t)count);
    uint32_t *index = rtc.set_new(geometry, INDEX, 0, UINT3, 12, (size_t)count);
    for (uint32_t i = 0; i < 3 * (uint32_t)count; i++)
        index[i] = i;
    rtc.commit_geometry(geometry);
    rtc.attach(y->scene, geometry);
    rtc.commit_scene(y->scene);
    y->width = rtc.get_property(y->device, NATIVE_RAY16) ? 16 : 8;
    y->threads = threads < MAX_THREADS ? threads : MAX_THREADS;
    pthread_barrier_init(&y->begin, NULL, (unsigned)y->threads);
    pthread_barrier_init(&y->end, NULL, (unsigned)y->threads);
    for (int i = 1; i < y->threads; i++)
        pthread_create(y->pool + i, NULL, serve, y);
    return y;
}

/* Rays that meet something. */
__attribute__((visibility("default"))) long long
trace_yardstick(Yardstick *y, const float *directions, const uint16_t *valid, int blocks,
                const float *pose) {
    y->directions = directions;
    y->valid = valid;
    y->blocks = blocks;
    y->pose = pose;
    atomic_store(&y->next, 0);
    atomic_store(&y->hits, 0);
    pthread_barrier_wait(&y->begin);
    trace_part(y);
    pthread_barrier_wait(&y->end);
    return atomic_load(&y->hits);
}
