/* The kernels of the engine, of the best level that the processor has. */
#ifndef FDH_KERNELS_H
#define FDH_KERNELS_H

#include <stdint.h>

typedef struct {
    int64_t (*play)(void *memory, int64_t output, int64_t frames);
    int64_t (*take)(void *memory);
    void (*render[2])(void), (*insert[2])(void); /* of scenes with one step a sample, and with stages */
} fdh_kernels;

const fdh_kernels *fdh_find_kernels(void); /* NULL: the processor is too old */
#endif
