/* Deflated data as RFC 1951 has them. */
#include <string.h>

#include "fdh_file.h"

enum { MAX_BITS = 15, FAST = 10, LITERALS = 288, DISTANCES = 30, END = 256 };

typedef struct {
    const unsigned char *at, *end;
    uint64_t bits;
    int count; /* bits that are there */
    int beyond; /* zero bytes that were read beyond the end */
} source;

typedef struct { /* canonical: codes of a length follow each other */
    uint16_t fast[1 << FAST]; /* symbols of short codes, by the next bits … */
    uint8_t fast_length[1 << FAST]; /* … and how long these are; 0: longer than FAST */
    uint16_t count[MAX_BITS + 1], symbols[LITERALS];
} code;

static void fill(source *s) {
    while (s->count <= 56) {
        s->bits |= (uint64_t)(s->at < s->end ? *s->at : 0) << s->count;
        s->at < s->end ? (void)s->at++ : (void)s->beyond++;
        s->count += 8;
    }
}

static unsigned take(source *s, int count) {
    unsigned value = (unsigned)(s->bits & ((1u << count) - 1));
    s->bits >>= count, s->count -= count;
    return value;
}

static int make_code(code *c, const uint8_t *lengths, int size) {
    uint16_t offset[MAX_BITS + 2] = {0}, next[MAX_BITS + 2] = {0};
    int left = 1;
    memset(c, 0, sizeof *c);
    for (int n = 0; n < size; n++) c->count[lengths[n]]++;
    c->count[0] = 0;
    for (int length = 1; length <= MAX_BITS; length++) {
        if ((left = 2 * left - c->count[length]) < 0) return -1; /* more codes than there are */
        offset[length + 1] = (uint16_t)(offset[length] + c->count[length]);
        next[length + 1] = (uint16_t)((next[length] + c->count[length]) << 1);
    }
    for (int n = 0; n < size; n++) {
        int length = lengths[n], value, reversed = 0;
        if (!length) continue;
        c->symbols[offset[length]++] = (uint16_t)n;
        value = next[length]++;
        if (length > FAST) continue;
        for (int k = 0; k < length; k++) reversed |= (value >> k & 1) << (length - 1 - k);
        for (; reversed < 1 << FAST; reversed += 1 << length) {
            c->fast[reversed] = (uint16_t)n;
            c->fast_length[reversed] = (uint8_t)length;
        }
    }
    return 0;
}

static int take_symbol(source *s, const code *c) {
    int length = c->fast_length[s->bits & ((1 << FAST) - 1)], value = 0, first = 0, index = 0;
    if (length) {
        int symbol = c->fast[s->bits & ((1 << FAST) - 1)];
        take(s, length);
        return symbol;
    }
    for (length = 1; length <= MAX_BITS; length++) {
        int count = c->count[length];
        value |= (int)take(s, 1);
        if (value - count < first) return c->symbols[index + (value - first)];
        index += count, first = (first + count) << 1, value <<= 1;
    }
    return -1;
}

static int take_codes(source *s, code *literals, code *distances) {
    static const uint8_t ORDER[19] = {16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15};
    uint8_t lengths[LITERALS + 32 + 138] = {0};
    int literal_count = (int)take(s, 5) + 257, distance_count = (int)take(s, 5) + 1, order_count = (int)take(s, 4) + 4;
    for (int n = 0; n < order_count; n++) fill(s), lengths[ORDER[n]] = (uint8_t)take(s, 3);
    if (literal_count > LITERALS || distance_count > DISTANCES || make_code(literals, lengths, 19)) return -1;
    memset(lengths, 0, 19);
    for (int n = 0; n < literal_count + distance_count;) {
        fill(s);
        int symbol = take_symbol(s, literals), repeated = 0, times = 1;
        if (symbol < 0 || (symbol == 16 && n == 0)) return -1;
        if (symbol < 16) repeated = symbol;
        else if (symbol == 16) repeated = lengths[n - 1], times = (int)take(s, 2) + 3;
        else times = symbol == 17 ? (int)take(s, 3) + 3 : (int)take(s, 7) + 11;
        while (times--) lengths[n++] = (uint8_t)repeated;
        if (n > literal_count + distance_count) return -1;
    }
    return make_code(literals, lengths, literal_count) || make_code(distances, lengths + literal_count, distance_count);
}

static int fixed_codes(code *literals, code *distances) {
    uint8_t lengths[LITERALS];
    for (int n = 0; n < LITERALS; n++) lengths[n] = n < 144 ? 8 : n < 256 ? 9 : n < 280 ? 7 : 8;
    make_code(literals, lengths, LITERALS);
    memset(lengths, 5, DISTANCES);
    return make_code(distances, lengths, DISTANCES);
}

int fdh_inflate(const unsigned char *from, int64_t count, unsigned char *to, int64_t size) {
    static const uint16_t LENGTH[29] = {3,  4,  5,  6,  7,  8,  9,  10, 11,  13,  15,  17,  19,  23, 27,
                                        31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163, 195, 227, 258};
    static const uint8_t LENGTH_BITS[29] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 0};
    source s = {from, from + count, 0, 0, 0};
    code literals, distances;
    int64_t done = 0;
    for (int is_last = 0; !is_last;) {
        fill(&s);
        is_last = (int)take(&s, 1);
        int kind = (int)take(&s, 2);
        if (kind == 0) {
            take(&s, s.count & 7);
            fill(&s);
            int64_t length = take(&s, 16);
            if ((take(&s, 16) ^ length) != 0xffff) return -1;
            while (s.count >= 8) s.count -= 8, s.beyond ? (void)s.beyond-- : (void)s.at--; /* back to whole bytes */
            s.bits = 0, s.count = 0;
            if (s.beyond || length > s.end - s.at || length > size - done) return -1;
            memcpy(to + done, s.at, (size_t)length);
            done += length, s.at += length;
            continue;
        }
        if (kind == 3) return -1;
        if (kind == 1 ? fixed_codes(&literals, &distances) : take_codes(&s, &literals, &distances)) return -1;
        for (;;) {
            fill(&s);
            if (s.beyond > 8) return -1;
            int symbol = take_symbol(&s, &literals);
            if (symbol == END) break;
            if (symbol < 0 || symbol > END + 29) return -1;
            if (symbol < END) {
                if (done == size) return -1;
                to[done++] = (unsigned char)symbol;
                continue;
            }
            symbol -= END + 1;
            int64_t length = LENGTH[symbol] + take(&s, LENGTH_BITS[symbol]);
            fill(&s);
            int d = take_symbol(&s, &distances);
            if (d < 0 || d >= DISTANCES) return -1;
            int extra = d < 2 ? 0 : d / 2 - 1;
            int64_t distance = d < 2 ? d + 1 : ((int64_t)(2 + d % 2) << extra) + 1 + take(&s, extra);
            if (distance > done || length > size - done) return -1;
            for (unsigned char *p = to + done, *q = p - distance, *end = p + length; p < end;) *p++ = *q++;
            done += length;
        }
    }
    return done == size ? 0 : -1;
}
