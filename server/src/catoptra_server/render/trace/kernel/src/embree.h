/* The part of Embree 4's interface that the kernel uses, looked up at run time.
 *
 * The library comes with the Python package embreex, without headers; these declarations follow
 * Embree's embree4/rtcore*.h (Apache-2.0). Structures that Embree writes are declared with spare
 * room at the end: builds differ in whether hits carry the primitive of an instance array.
 */
#ifndef CATOPTRA_EMBREE_H
#define CATOPTRA_EMBREE_H

#include <stddef.h>
#include <stdint.h>

typedef struct RTCDeviceTy *RTCDevice;
typedef struct RTCSceneTy *RTCScene;
typedef struct RTCGeometryTy *RTCGeometry;

#define RTC_INVALID_GEOMETRY_ID 0xffffffffu

enum { RTC_GEOMETRY_TYPE_TRIANGLE = 0, RTC_GEOMETRY_TYPE_INSTANCE = 121 };
enum { RTC_BUFFER_TYPE_INDEX = 0, RTC_BUFFER_TYPE_VERTEX = 1 };
enum { RTC_FORMAT_UINT3 = 0x5003, RTC_FORMAT_FLOAT3 = 0x9003, RTC_FORMAT_FLOAT3X4_COLUMN = 0x9234 };
enum { RTC_RAY_QUERY_FLAG_COHERENT = 1 << 16 };
enum { RTC_FEATURE_FLAG_ALL = -1 };
enum { RTC_SCENE_FLAG_NONE = 0, RTC_SCENE_FLAG_ROBUST = 1 << 2 };
enum { RTC_BUILD_QUALITY_LOW = 0, RTC_BUILD_QUALITY_MEDIUM = 1 };
enum { RTC_DEVICE_PROPERTY_NATIVE_RAY8 = 33, RTC_DEVICE_PROPERTY_NATIVE_RAY16 = 34 };

/* RTCIntersectArguments and RTCOccludedArguments have the same members. */
typedef struct {
    int32_t flags;
    int32_t feature_mask;
    void *context;
    void *filter;
    void *callback;
    float min_width_distance_factor;
    float spare[7];
} RTCQueryArguments;

#define RTC_DECLARE_PACKET(WIDTH, ALIGNMENT)                                                       \
    typedef struct {                                                                               \
        _Alignas(ALIGNMENT) float origin[3][WIDTH];                                                \
        float tnear[WIDTH];                                                                        \
        float direction[3][WIDTH];                                                                 \
        float time[WIDTH];                                                                         \
        float tfar[WIDTH];                                                                         \
        uint32_t mask[WIDTH];                                                                      \
        uint32_t id[WIDTH];                                                                        \
        uint32_t flags[WIDTH];                                                                     \
    } RTCRay##WIDTH;                                                                               \
    typedef struct {                                                                               \
        RTCRay##WIDTH ray;                                                                         \
        float normal[3][WIDTH];                                                                    \
        float u[WIDTH];                                                                            \
        float v[WIDTH];                                                                            \
        uint32_t triangle[WIDTH];                                                                  \
        uint32_t geometry[WIDTH];                                                                  \
        uint32_t instance[WIDTH];                                                                  \
        uint32_t spare[WIDTH];                                                                     \
    } RTCRayHit##WIDTH;

RTC_DECLARE_PACKET(4, 16)
RTC_DECLARE_PACKET(8, 32)
RTC_DECLARE_PACKET(16, 64)

/* Single rays interleave their members in another order than packets do. */
typedef struct {
    _Alignas(16) float origin[3];
    float tnear;
    float direction[3];
    float time;
    float tfar;
    uint32_t mask;
    uint32_t id;
    uint32_t flags;
} RTCRay1;

typedef struct {
    RTCRay1 ray;
    float normal[3];
    float u;
    float v;
    uint32_t triangle;
    uint32_t geometry;
    uint32_t instance;
    uint32_t spare[4];
} RTCRayHit1;

typedef struct {
    RTCDevice (*new_device)(const char *config);
    void (*release_device)(RTCDevice);
    int (*get_device_error)(RTCDevice);
    ptrdiff_t (*get_device_property)(RTCDevice, int property);
    RTCScene (*new_scene)(RTCDevice);
    void (*release_scene)(RTCScene);
    void (*commit_scene)(RTCScene);
    void (*set_scene_build_quality)(RTCScene, int quality);
    void (*set_scene_flags)(RTCScene, int flags);
    void (*attach_geometry_by_id)(RTCScene, RTCGeometry, unsigned id);
    RTCGeometry (*new_geometry)(RTCDevice, int type);
    void (*release_geometry)(RTCGeometry);
    void (*commit_geometry)(RTCGeometry);
    void (*set_shared_buffer)(RTCGeometry, int type, unsigned slot, int format, const void *data,
                              size_t offset, size_t stride, size_t count);
    void *(*set_new_buffer)(RTCGeometry, int type, unsigned slot, int format, size_t stride,
                            size_t count);
    void (*set_instanced_scene)(RTCGeometry, RTCScene);
    void (*set_time_step_count)(RTCGeometry, unsigned count);
    void (*set_transform)(RTCGeometry, unsigned step, int format, const void *matrix);
    void (*intersect1)(RTCScene, RTCRayHit1 *, RTCQueryArguments *);
    void (*intersect4)(const int *valid, RTCScene, RTCRayHit4 *, RTCQueryArguments *);
    void (*intersect8)(const int *valid, RTCScene, RTCRayHit8 *, RTCQueryArguments *);
    void (*intersect16)(const int *valid, RTCScene, RTCRayHit16 *, RTCQueryArguments *);
    void (*occluded1)(RTCScene, RTCRay1 *, RTCQueryArguments *);
    void (*occluded4)(const int *valid, RTCScene, RTCRay4 *, RTCQueryArguments *);
    void (*occluded8)(const int *valid, RTCScene, RTCRay8 *, RTCQueryArguments *);
    void (*occluded16)(const int *valid, RTCScene, RTCRay16 *, RTCQueryArguments *);
} Embree;

/* Open the library and look up every function; on failure 0, and `error` says which is missing. */
int embree_open(Embree *embree, const char *path, char *error, size_t error_size);

#endif
