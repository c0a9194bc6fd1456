/* Provides workers.h: the pool of threads.
 * No twin. The pool owns its threads, from workers_create to workers_destroy.
 * Threads: jobs of several calling threads follow one another. */
#define _GNU_SOURCE
#include "workers.h"

#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

struct Workers {
    pthread_mutex_t job_lock; /* held for a whole job */
    pthread_mutex_t lock;     /* guards all below */
    pthread_cond_t started;
    pthread_cond_t finished;
    void (*job)(void *);
    void *argument;
    unsigned generation; /* number of the current job */
    int running;         /* threads that have not finished it */
    int ending;
    int count; /* threads of the pool, without the calling one */
    pthread_t threads[];
};

/* Denormals, which are slow, are zero within a job: the same arithmetic in every thread, whatever
 * the calling thread had set. */
#if defined(__x86_64__)
void workers_run_alone(void (*job)(void *), void *argument) {
    unsigned saved = _mm_getcsr();
    _mm_setcsr(saved | 0x8040u);
    job(argument);
    _mm_setcsr(saved);
}
#else
void workers_run_alone(void (*job)(void *), void *argument) {
    uint64_t saved;
    __asm__ volatile("mrs %0, fpcr" : "=r"(saved));
    __asm__ volatile("msr fpcr, %0" : : "r"(saved | 1u << 24));
    job(argument);
    __asm__ volatile("msr fpcr, %0" : : "r"(saved));
}
#endif

static void *serve(void *pool) {
    Workers *workers = pool;
    unsigned seen = 0;
    pthread_mutex_lock(&workers->lock);
    for (;;) {
        while (workers->generation == seen && !workers->ending)
            pthread_cond_wait(&workers->started, &workers->lock);
        if (workers->ending)
            break;
        seen = workers->generation;
        pthread_mutex_unlock(&workers->lock);
        workers_run_alone(workers->job, workers->argument);
        pthread_mutex_lock(&workers->lock);
        if (--workers->running == 0)
            pthread_cond_signal(&workers->finished);
    }
    pthread_mutex_unlock(&workers->lock);
    return NULL;
}

Workers *workers_create(int threads) {
    int count = threads > 1 ? threads - 1 : 0;
    Workers *workers = calloc(1, sizeof *workers + (size_t)count * sizeof(pthread_t));
    if (!workers)
        return NULL;
    pthread_mutex_init(&workers->job_lock, NULL);
    pthread_mutex_init(&workers->lock, NULL);
    pthread_cond_init(&workers->started, NULL);
    pthread_cond_init(&workers->finished, NULL);
    for (; workers->count < count; workers->count++)
        /* A machine at its limit of threads renders with those that it has. */
        if (pthread_create(&workers->threads[workers->count], NULL, serve, workers))
            break;
    return workers;
}

void workers_run(Workers *workers, void (*job)(void *), void *argument) {
    pthread_mutex_lock(&workers->job_lock);
    pthread_mutex_lock(&workers->lock);
    workers->job = job;
    workers->argument = argument;
    workers->running = workers->count;
    workers->generation++;
    pthread_cond_broadcast(&workers->started);
    pthread_mutex_unlock(&workers->lock);
    workers_run_alone(job, argument);
    pthread_mutex_lock(&workers->lock);
    while (workers->running)
        pthread_cond_wait(&workers->finished, &workers->lock);
    pthread_mutex_unlock(&workers->lock);
    pthread_mutex_unlock(&workers->job_lock);
}

void workers_destroy(Workers *workers) {
    pthread_mutex_lock(&workers->lock);
    workers->ending = 1;
    pthread_cond_broadcast(&workers->started);
    pthread_mutex_unlock(&workers->lock);
    for (int i = 0; i < workers->count; i++)
        pthread_join(workers->threads[i], NULL);
    pthread_cond_destroy(&workers->started);
    pthread_cond_destroy(&workers->finished);
    pthread_mutex_destroy(&workers->lock);
    pthread_mutex_destroy(&workers->job_lock);
    free(workers);
}
