/* A fixed pool of threads that run one job at a time, beside the thread that asks for it. */
#ifndef CATOPTRA_WORKERS_H
#define CATOPTRA_WORKERS_H

typedef struct Workers Workers;

/* Pool of `threads` - 1 threads, NULL if none can be created. */
Workers *workers_create(int threads);

/* Run `job(argument)` once on every thread, the calling one included; returns when all are done.
 * Calls from several threads follow one another. */
void workers_run(Workers *workers, void (*job)(void *argument), void *argument);

/* The same on the calling thread alone, which wakes no other. */
void workers_run_alone(void (*job)(void *argument), void *argument);

void workers_destroy(Workers *workers);

#endif
