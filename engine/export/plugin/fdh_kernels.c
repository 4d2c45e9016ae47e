#include "fdh_kernels.h"

#include <stddef.h>

#include "fdh_numbers.h" /* FDH_KERNEL_LEVELS: LEVEL(n) for each */

#define DECLARE(n) \
    int64_t fd##n##_play_into(void *, int64_t, int64_t), fd##n##_take_events(void *); \
    void fd##n##_render_block(void), fd##n##_insert_event_at(void), fd##n##_render_block_stages(void), \
        fd##n##_insert_event_at_stages(void); \
    static const fdh_kernels KERNELS_##n = {fd##n##_play_into, \
                                            fd##n##_take_events, \
                                            {fd##n##_render_block, fd##n##_render_block_stages}, \
                                            {fd##n##_insert_event_at, fd##n##_insert_event_at_stages}};
FDH_KERNEL_LEVELS(DECLARE)

#if defined __x86_64__
#include <cpuid.h>

static int level_of_processor(void) { /* 4: AVX-512, 3: AVX2 and multiply-add, else 0 */
    unsigned a, b, c, d, saved = 0, high;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 0;
    unsigned features = b;
    __get_cpuid(1, &a, &b, &c, &d);
    int has_system = c >> 27 & 1;
    if (has_system) __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0)); /* registers that the system saves */
    int has_3 = (saved & 6) == 6 && (c >> 12 & 1) && (c >> 22 & 1) && (c >> 29 & 1) && (features >> 3 & 1) && (features >> 5 & 1) &&
                (features >> 8 & 1);
    unsigned wanted = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31; /* F, DQ, CD, BW, VL */
    int has_4 = has_3 && (saved & 0xe0) == 0xe0 && (features & wanted) == wanted;
    return has_4 ? 4 : has_3 ? 3 : 0;
}
#else
static int level_of_processor(void) { return 1; }
#endif

const fdh_kernels *fdh_find_kernels(void) {
    int level = level_of_processor();
#define CHOOSE(n) \
    if (level >= n) return &KERNELS_##n;
    FDH_KERNEL_LEVELS(CHOOSE)
    return NULL;
}
