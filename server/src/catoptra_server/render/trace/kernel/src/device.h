/* The pool of threads, and the meshes whose hierarchies it built. */
#ifndef CATOPTRA_DEVICE_H
#define CATOPTRA_DEVICE_H

#include "bvh.h"
#include "kernel.h"
#include "workers.h"

#include <stddef.h>

enum { ERROR_SIZE = 256 };

struct Device {
    Workers *workers;
};

struct Mesh {
    MeshArrays arrays;
    Bvh bvh;
};

#endif
